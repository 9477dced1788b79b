# SPDX-License-Identifier: Apache-2.0
"""Unwrapping of angles that wrap after a turn or at the end of their register."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.mapping import AngleSource, ColumnMapping
from ema_core.columns.errors import WrappedColumn
from ema_core.columns.wraps import AROUND, is_turn_apart, register_periods, wraps_in
from ema_core.units import LINEAR, UNITS

_ANGLES: Final = ("position", "command", "error")


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

    An angle wraps after a full turn, an integer register at a power of two.

    Attributes
    ----------
    wrapped
        Angles that have wrapped so far, by quantity.
    """

    def __init__(self, mapping: ColumnMapping) -> None:
        self.wrapped: dict[str, WrappedColumn] = {}
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
        if is_turn_apart(ahead, command.turn):
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
            wraps = wraps_in(steps, period, angle.steps)
            if np.any(wraps):
                turns[wraps] = -np.sign(steps[wraps]) * period
                before = self.wrapped[name].count if name in self.wrapped else 0
                count = before + int(np.count_nonzero(wraps))
                self.wrapped[name] = WrappedColumn(name, period, count)
                break
        offsets = angle.offset + np.cumsum(turns)
        angle.steps = np.concatenate([angle.steps, (steps + turns)])[-AROUND:]
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
            periods += register_periods(angle.highest)
        return periods
