# SPDX-License-Identifier: Apache-2.0
"""Unwrapping of angles that wrap after a turn or at the end of their register."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.mapping import AngleSource, ColumnMapping
from ema_core.units import LINEAR, UNITS

_ANGLES: Final = ("position", "command", "error")
_BITS: Final = (8, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 24, 32)
_LEAST_STEP: Final = 0.6
_MOST_STEP: Final = 1.4
_SLOW: Final = 0.2
_NEAR: Final = 0.02
_ALIKE: Final = 4.0
_AROUND: Final = 8
_FULL: Final = 0.9


@dataclass
class _Angle:
    """State of the unwrapping of an angle, in source units."""

    turn: float
    """Size of a full turn; infinity for a length."""

    last: float = math.nan
    """Latest source value."""

    offset: float = 0.0
    """Offset currently added to source values."""

    steps: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """Latest steps, with wraps removed."""

    lowest: float = math.inf
    highest: float = -math.inf

    is_whole: bool = True
    """Whether all values are whole numbers."""


class Unwrapper:
    """Unwraps angles block by block.

    A step of about one full turn is a wrap if the neighbouring steps are short and the step minus
    the turn is similar to them. An integer register wraps at a power of two.

    Attributes
    ----------
    wraps
        Number of wraps so far, by quantity.
    periods
        Size of a wrap, by quantity, in source units.
    """

    def __init__(self, mapping: ColumnMapping) -> None:
        self.wraps: dict[str, int] = {}
        self.periods: dict[str, float] = {}
        self._angles: dict[str, _Angle] = {}
        for name in _ANGLES:
            source: AngleSource | None = getattr(mapping, name)
            if source is not None:
                size = abs(source.scale) * UNITS[source.unit]
                is_length = source.unit in LINEAR
                self._angles[name] = _Angle(math.inf if is_length else 2.0 * math.pi / size)

    def push(self, raw: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
        """Return the columns with unwrapped angles; ``raw`` holds source values, ``(n,)`` each."""
        changed = dict(raw)
        if "command" in self._angles:
            self._align(raw)
        for name, angle in self._angles.items():
            changed[name] = self._continued(name, angle, raw[name])
        return changed

    def _align(self, raw: Mapping[str, NDArray[np.float64]]) -> None:
        """Align the command to the position if their first values differ by a wrap."""
        command, position = self._angles["command"], self._angles["position"]
        is_finite = np.isfinite(raw["command"]) & np.isfinite(raw["position"])
        if not math.isnan(command.last) or not np.any(is_finite) or command.turn != position.turn:
            return
        first = int(np.argmax(is_finite))
        ahead = float(raw["command"][first] - raw["position"][first])
        if abs(ahead) < command.turn and abs(ahead) > (1.0 - _SLOW) * command.turn:
            command.offset = -math.copysign(command.turn, ahead)

    def _continued(
        self, name: str, angle: _Angle, values: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        rows = np.flatnonzero(np.isfinite(values))
        if not len(rows):
            return values
        readings = values[rows]
        angle.lowest = min(angle.lowest, float(readings.min()))
        angle.highest = max(angle.highest, float(readings.max()))
        angle.is_whole = angle.is_whole and not np.any(readings % 1.0)
        first = readings[0] if math.isnan(angle.last) else angle.last
        steps = np.diff(readings, prepend=first)
        turns = np.zeros(len(readings))
        for period in self._periods(angle):
            wraps = _wraps(steps, period, angle.steps)
            if np.any(wraps):
                turns[wraps] = -np.sign(steps[wraps]) * period
                self.wraps[name] = self.wraps.get(name, 0) + int(np.count_nonzero(wraps))
                self.periods[name] = period
                break
        offsets = angle.offset + np.cumsum(turns)
        angle.steps = np.concatenate([angle.steps, (steps + turns)])[-_AROUND:]
        angle.last, angle.offset = float(readings[-1]), float(offsets[-1])
        if not np.any(offsets):
            return values
        continued = values.copy()
        continued[rows] = readings + offsets
        return continued

    def _periods(self, angle: _Angle) -> list[float]:
        """Return the possible wrap periods: one turn, or the register's number of counts."""
        periods = [angle.turn] if math.isfinite(angle.turn) else []
        if angle.is_whole and angle.lowest >= 0.0:
            counts = (2.0**bits for bits in _BITS)
            periods += [n for n in counts if _FULL * n < angle.highest < n]
        return periods


def _wraps(
    steps: NDArray[np.float64], period: float, before: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return a mask of the steps that are wraps, ``(n,)``."""
    sizes = np.abs(steps)
    wraps = (sizes > _LEAST_STEP * period) & (sizes < _MOST_STEP * period)
    if not np.any(wraps):
        return wraps
    all_sizes = np.concatenate([np.abs(before), sizes])
    are_usual = np.concatenate([np.ones(len(before), bool), ~wraps])
    for row in np.flatnonzero(wraps):
        at = row + len(before)
        around = slice(max(0, at - _AROUND), at + _AROUND + 1)
        usual = all_sizes[around][are_usual[around]]
        longest = float(np.max(usual, initial=0.0))
        remainder = abs(sizes[row] - period)
        wraps[row] = (
            len(usual) > 0
            and longest < _SLOW * period
            and remainder < _ALIKE * longest + _NEAR * period
        )
    return wraps
