# SPDX-License-Identifier: Apache-2.0
"""Parts of an explanation that a window cannot distinguish from each other.

The method is described in ``docs/identification.md``, M27.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

from ema_core.faults import FAULT_NAMES
from ema_monitor.reason_texts import AND, EQUAL_SHORTS, EQUAL_SHORTS_LABEL, LABELS

Part = tuple[str, ...]
"""Part of an explanation: the names of its faults, or the name of a hidden cause."""


class Alternative(NamedTuple):
    """A part of an explanation, and a replacement that explains the window equally well."""

    part: Part
    """Part of the explanation."""
    stand_in: Part
    """Replacement of the part."""

    def as_record(self) -> dict[str, list[str]]:
        """Return the alternative as plain values for JSON."""
        return {name: list(part) for name, part in self._asdict().items()}


def names_of(alternatives: Iterable[Alternative]) -> frozenset[str]:
    """Return the names of all faults and hidden causes in the alternatives."""
    return frozenset(name for pair in alternatives for part in pair for name in part)


def faults_of(parts: Iterable[Part]) -> list[int]:
    """Return the indices of all faults in the parts, ignoring hidden causes."""
    names = {name for part in parts for name in part}
    return [number for number, name in enumerate(FAULT_NAMES) if name in names]


def alternative_of(record: Any) -> Alternative:
    """Return an alternative from the output of ``as_record``, or from two labels (version 0.1).

    Raises
    ------
    ValueError, KeyError
        If a name is neither a fault nor a hidden cause, or the number of parts is not two.
    """
    pair = record
    if isinstance(record, dict):
        pair = record["part"], record["stand_in"]
    part, stand_in = map(_part_of, pair)
    return Alternative(part, stand_in)


def _part_of(value: Any) -> Part:
    if value == EQUAL_SHORTS_LABEL:
        return EQUAL_SHORTS
    if isinstance(value, str):
        names = {label: name for name, label in LABELS.items()}
        value = [names.get(label, label) for label in value.split(AND)]
    if not value or any(name not in LABELS for name in value):
        raise ValueError(f"alternative {value!r}: expected names of faults or of a hidden cause")
    return tuple(value)
