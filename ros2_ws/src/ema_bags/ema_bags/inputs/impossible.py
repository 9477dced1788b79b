"""Samples that no actuator can give: messages that are all zero, values beyond any unit, spikes."""

import math
from collections.abc import Mapping as ByName
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.mapping import AngleSource, Mapping, SpeedSource
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.units import CURRENTS, LENGTHS, LINEAR, UNITS

_ABSURD: Final = 1e15
_MOST_IN_A_ROW: Final = 3
_LEAST_KNOWN: Final = 50
_REMEMBERED: Final = 1000
_STEPS: Final = 10.0
_TOP_SPEEDS: Final = 2.0
_LIMITS: Final = 3.0
_WRAP: Final = 0.4
_LEAST_TURN: Final = 0.01
_LEAST_LENGTH: Final = 1e-3
_SENSORS: Final = ("position", "speed", "current")


class ImpossibleSamples:
    """Finds samples that no actuator can give, and puts them on the line between their neighbours.

    Such a sample is beyond 1e15, or 0 in all columns between samples that are not. Or its position
    is off for three samples at most: by 10 usual steps and, for a modelled drive, twice the travel
    at top speed in a sample; for another drive by half a turn or the usual range, and 1 % of a
    turn. For a modelled drive, a speed or current beyond 3 times the limit is impossible, too. More
    than three in a row are left as they are.

    Parameters
    ----------
    limits
        Largest step of the position, speed and current of a modelled drive, in the units of their
        sources; empty for another drive.

    Attributes
    ----------
    count
        Number of such samples so far.
    """

    def __init__(self, mapping: Mapping, limits: ByName[str, float] = MappingProxyType({})) -> None:
        self.count = 0
        self._limits = limits
        source = mapping.position
        size = abs(source.scale) * UNITS[source.unit]
        least = _LEAST_LENGTH if source.unit in LENGTHS else 2.0 * math.pi * _LEAST_TURN
        self._least = least / size
        self._half_turn = math.inf if source.unit in LENGTHS else math.pi / size
        # Samples at the end of the last block that are held, as their position has jumped.
        self._held = 0
        self._position = np.empty(0)
        self._before: dict[str, float] = {}
        self._open = 0

    def push(self, raw: ByName[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
        """Return columns, ``(n,)`` each, without such samples; call it for each block in order.

        If a block ends before the position of a modelled drive comes back from a jump, the value
        before is held.
        """
        keys = [name for name in _SENSORS if name in raw]
        columns = {name: np.array(values) for name, values in raw.items()}
        count = len(columns["position"])
        if not count:
            return columns
        bad = np.any([np.abs(columns[name]) > _ABSURD for name in keys], axis=0)
        bad |= self._empty([columns[name] for name in keys], [*keys])
        bad |= self._excessive(columns)
        bad |= self._spikes(np.where(bad, np.nan, columns["position"]))
        good = np.flatnonzero(~bad)
        self._open = count - 1 - int(good[-1]) if len(good) else self._open + count
        self.count += count - len(good)
        # Where no sample follows, the value before is held.
        rows = np.arange(count)
        for name in columns if len(good) < count else ():
            kept, values = good, columns[name][good]
            if name in self._before:
                kept = np.concatenate([[-1], good])
                values = np.concatenate([[self._before[name]], values])
            if len(kept):
                columns[name][bad] = np.interp(rows[bad], kept, values)
        if len(good):
            self._before = {name: float(values[good[-1]]) for name, values in columns.items()}
        position = columns["position"]
        finite = position[np.isfinite(position)]
        self._position = np.concatenate([self._position, finite])[-_REMEMBERED:]
        return columns

    def _empty(self, columns: list[NDArray[np.float64]], keys: list[str]) -> NDArray[np.bool_]:
        """Return where all columns are 0 and two of them are not before and after, ``(n,)``."""
        zero = np.all([values == 0.0 for values in columns], axis=0)
        if len(columns) < 2 or not np.any(zero):
            return np.zeros(len(zero), bool)
        filled = [int(np.count_nonzero([self._before.get(name, 0.0) for name in keys]))]
        filled += np.count_nonzero(columns, axis=0).tolist()
        bad = np.zeros(len(zero), bool)
        for first, last in _runs(zero):
            length = last - first + (self._open if not first else 0)
            is_short = length <= _MOST_IN_A_ROW
            comes_back = last == len(zero) or filled[last + 1] >= 2
            bad[first:last] = is_short and comes_back and filled[first] >= 2
        return bad

    def _spikes(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return where a position is far off for a few samples, ``(n,)``."""
        bad = np.zeros(len(position), bool)
        rows = np.flatnonzero(np.isfinite(position))
        positions = np.concatenate([self._position, position[rows]])
        if len(positions) < _LEAST_KNOWN:
            return bad
        steps = np.abs(np.diff(positions))
        far = self._far(positions, steps)
        first = len(self._position)
        held, self._held = self._held, 0
        for row in (np.flatnonzero(steps > far) + 1).tolist():
            if row < max(first, 1) or (row > first and bad[rows[row - 1 - first]]):
                continue
            most = _MOST_IN_A_ROW - (held if row == first else 0)
            after = np.abs(positions[row + 1 : row + 1 + most] - positions[row - 1])
            back = np.flatnonzero(after <= 0.5 * far)
            if len(back):
                bad[rows[row - first : row - first + back[0] + 1]] = True
            elif len(positions) - row <= most and self._is_held(float(steps[row - 1])):
                bad[rows[row - first :]] = True
                self._held = _MOST_IN_A_ROW - most + len(positions) - row
            elif row == first:
                # It does not come back: a jump, whose first samples were held.
                self.count -= held
        return bad

    def _far(self, positions: NDArray[np.float64], steps: NDArray[np.float64]) -> float:
        """Return the deviation of a position that comes back, in the unit of the source."""
        usual = _STEPS * float(np.percentile(steps, 98.0))
        if "position" in self._limits:
            return max(usual, self._limits["position"])
        low, high = np.percentile(positions, [1.0, 99.0])
        return max(usual, min(float(high - low), self._half_turn), self._least)

    def _is_held(self, step: float) -> bool:
        """Return whether a value is held until it shows whether the position comes back.

        It is not held for an unknown drive, whose motion may begin so fast, or over a wrap.
        """
        turn = 2.0 * self._half_turn
        is_wrap = math.isfinite(turn) and abs(step - turn) < _WRAP * turn
        return "position" in self._limits and not is_wrap

    def _excessive(self, columns: ByName[str, NDArray[np.float64]]) -> NDArray[np.bool_]:
        """Return where a speed or current is beyond its limit for a few samples, ``(n,)``."""
        beyond = np.zeros(len(columns["position"]), bool)
        for name in ("speed", "current"):
            if name in self._limits and name in columns:
                beyond |= np.abs(columns[name]) > self._limits[name]
        for start, end in _runs(beyond):
            if end - start > _MOST_IN_A_ROW:
                beyond[start:end] = False
        return beyond


def limits_of(
    mapping: Mapping, description: ActuatorDescription, period: float
) -> dict[str, float]:
    """Return the limits that no motor of a description exceeds, for ``ImpossibleSamples``.

    Parameters
    ----------
    period
        Sample period [s].
    """
    if description.drive == "unknown":
        return {}
    parameters = description.parameters
    top = parameters.top_speed
    limits: dict[str, float] = {}
    angle = _size(mapping.position, parameters)
    if angle:
        limits["position"] = _TOP_SPEEDS * top * period / angle
    if mapping.speed and not mapping.speed.encoding and (size := _size(mapping.speed, parameters)):
        limits["speed"] = _LIMITS * top / size
    current = mapping.measured_current
    if current and not current.encoding and current.unit in CURRENTS:
        limits["current"] = _LIMITS * parameters.I_max / (abs(current.scale) * UNITS[current.unit])
    return limits


def _size(source: AngleSource | SpeedSource, parameters: ActuatorParameters) -> float:
    """Return the angle or speed of the motor for 1 of a source [rad, rad/s]; 0 if unknown."""
    size = abs(source.scale) * UNITS[source.unit]
    if source.unit in LINEAR:
        size *= 2.0 * math.pi / lead if (lead := source.lead or parameters.lead) else 0.0
    return size if source.shaft == "motor" else size / parameters.tau


def _runs(chosen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first row and end of each run of chosen rows."""
    edges = np.flatnonzero(np.diff(chosen, prepend=False, append=False))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
