"""The parts of the campaign, each a module with a ``PART``."""

from importlib import import_module
from typing import Final

from part import Part

NAMES: Final = (
    "vectors",
    "fuzz",
    "files",
    "state_machines",
    "kills",
    "graphs",
    "soak",
    "wrong_and_confident",
)
"""Modules of the parts, in the order of the table."""


def part_of(name: str) -> Part:
    """Return a part by its name."""
    return import_module(name).PART
