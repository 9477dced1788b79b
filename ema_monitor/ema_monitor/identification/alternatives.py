# SPDX-License-Identifier: Apache-2.0
"""Parts of an explanation that a window cannot distinguish from each other.

The method is described in ``docs/identification.md``, M27.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

from ema_core.causes import CAUSE_BY_NAME
from ema_core.faults import FAULT_BY_NAME, FAULT_NAMES

_NAMES: Final = frozenset((*FAULT_BY_NAME, *CAUSE_BY_NAME))

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
    """Return an alternative from the output of ``as_record``.

    Raises
    ------
    ValueError, KeyError
        If it is not such an output, or a name is neither a fault nor a hidden cause.
    """
    if not isinstance(record, Mapping):
        raise ValueError(f"alternative {record!r}: expected a mapping with part and stand_in")
    return Alternative(_part_of(record["part"]), _part_of(record["stand_in"]))


def _part_of(names: Any) -> Part:
    if not names or isinstance(names, str) or any(name not in _NAMES for name in names):
        raise ValueError(f"alternative {names!r}: expected names of faults or of a hidden cause")
    return tuple(names)
