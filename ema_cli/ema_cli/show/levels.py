"""Levels of health as they are shown: by word, shape and colour, so that none stands alone."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN

SHAPES: Final[Mapping[int, str]] = MappingProxyType({OK: "●", WARN: "▲", ERROR: "■", STALE: "○"})
COLOURS: Final[Mapping[int, str]] = MappingProxyType(
    {OK: "green", WARN: "yellow", ERROR: "bold red", STALE: "bright_black"}
)
"""On a terminal."""


def level_in_words(level: int) -> str:
    """Return shape and name of a level."""
    return f"{SHAPES[level]} {LEVEL_NAMES[level]}"
