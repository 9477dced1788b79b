"""Samples that no actuator can give: messages that are all zero, values beyond any unit, spikes."""

import math
from collections.abc import Mapping as ByName
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.mapping import LENGTHS, UNITS, Mapping

_ABSURD: Final = 1e15
_MOST_IN_A_ROW: Final = 3
_LEAST_KNOWN: Final = 50
_REMEMBERED: Final = 1000
_STEPS: Final = 30.0
_LEAST_TURN: Final = 0.01
_LEAST_LENGTH: Final = 1e-3
_SENSORS: Final = ("position", "speed", "current")


class ImpossibleSamples:
    """Finds samples that no actuator can give, and puts them on the line between their neighbours.

    Such a sample is beyond 1e15, or 0 in all columns between samples that are not, or its position
    is far off for three samples at most: by 30 usual steps, the usual range and 1 % of a turn.
    More than three in a row are left as they are.

    Attributes
    ----------
    found
        Number of such samples so far.
    """

    def __init__(self, mapping: Mapping) -> None:
        self.found = 0
        source = mapping.position
        size = abs(source.scale) * UNITS[source.unit]
        least = _LEAST_LENGTH if source.unit in LENGTHS else 2.0 * math.pi * _LEAST_TURN
        self._least = least / size
        self._position = np.empty(0)
        self._before: dict[str, float] = {}
        self._open = 0

    def push(self, raw: ByName[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
        """Return columns, ``(n,)`` each, without such samples, those of one block after another.

        A spike is found only if the block shows that the position comes back.
        """
        keys = [name for name in _SENSORS if name in raw]
        columns = {name: np.array(values) for name, values in raw.items()}
        count = len(columns["position"])
        if not count:
            return columns
        bad = np.any([np.abs(columns[name]) > _ABSURD for name in keys], axis=0)
        bad |= self._empty([columns[name] for name in keys], [*keys])
        bad |= self._spikes(np.where(bad, np.nan, columns["position"]))
        good = np.flatnonzero(~bad)
        self._open = count - 1 - int(good[-1]) if len(good) else self._open + count
        self.found += count - len(good)
        # Where no sample follows, the value before is held.
        rows = np.arange(count)
        for name in columns if len(good) < count else ():
            known, values = good, columns[name][good]
            if name in self._before:
                known = np.concatenate([[-1], good])
                values = np.concatenate([[self._before[name]], values])
            if len(known):
                columns[name][bad] = np.interp(rows[bad], known, values)
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
        known = np.concatenate([self._position, position[rows]])
        if len(known) < _LEAST_KNOWN:
            return bad
        steps = np.abs(np.diff(known))
        low, high = np.percentile(known, [1.0, 99.0])
        far = max(_STEPS * float(np.percentile(steps, 98.0)), float(high - low), self._least)
        first = len(self._position)
        for row in np.flatnonzero(steps > far) + 1:
            if row < max(first, 1) or (row > first and bad[rows[row - 1 - first]]):
                continue
            after = np.abs(known[row + 1 : row + 1 + _MOST_IN_A_ROW] - known[row - 1])
            back = np.flatnonzero(after <= 0.5 * far)
            if len(back):
                bad[rows[row - first : row - first + back[0] + 1]] = True
        return bad


def _runs(chosen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first row and end of each run of chosen rows."""
    edges = np.flatnonzero(np.diff(chosen, prepend=False, append=False))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
