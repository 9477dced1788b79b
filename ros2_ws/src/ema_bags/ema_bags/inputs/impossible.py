# SPDX-License-Identifier: Apache-2.0
"""Physically impossible samples: all-zero messages, absurdly large values and spikes."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.excursions import (
    FEWEST,
    MOST_IN_A_ROW,
    Excursions,
    JumpThresholds,
    find_excursions,
)
from ema_bags.inputs.mapping import ColumnMapping

_ABSURD: Final = 1e15
_MOST_ZEROS: Final = 200
_MOST_WAITING: Final = 200
_REMEMBERED: Final = 1000
_STEPS: Final = 10.0
_NEAR: Final = 8
_TIMES_FASTEST: Final = 2.0
_SENSORS: Final = ("position", "speed", "current")
_COMMANDS: Final = ("command", "error")


class _Findings(NamedTuple):
    """Impossible samples in a block of `n` samples."""

    bridged: NDArray[np.bool_]
    """True where all columns are interpolated, ``(n,)``."""
    dropped: NDArray[np.bool_]
    """True where the sample is dropped, ``(n,)``."""
    commands: dict[str, NDArray[np.bool_]]
    """True where only the command is interpolated, by command name, ``(n,)`` each."""
    first_open: int
    """Index of the first sample that cannot be judged before more samples arrive."""

    @property
    def is_impossible(self) -> NDArray[np.bool_]:
        """True where a sample is impossible for any reason, ``(n,)``."""
        return np.any([self.bridged, self.dropped, *self.commands.values()], axis=0)


class ImpossibleSampleRepair:
    """Replaces physically impossible samples by linear interpolation.

    A sample is impossible if a value exceeds 1e15, if all sensor columns are 0 although its
    neighbours are not, or if its position or command is part of an excursion of at most three
    samples (see ``find_excursions``). For a modelled drive, a position excursion must instead
    exceed 10 times the 98th percentile of the steps and twice the travel per sample at top speed; a
    speed or current above 3 times its limit is impossible as well.

    Runs of more than three impossible samples are kept unchanged. The exceptions are all-zero runs:
    up to 200 samples are dropped if the position jumps to 0 and back, or if a moving command jumps
    to 0 and continues as if it had moved on.

    Parameters
    ----------
    limits
        Largest position step, speed and current of a modelled drive, in source units. Empty for an
        unknown drive.

    Attributes
    ----------
    count
        Number of impossible samples so far.
    """

    def __init__(
        self, mapping: ColumnMapping, limits: Mapping[str, float] = MappingProxyType({})
    ) -> None:
        self.count = 0
        self._limits = limits
        self._commands = [name for name in _COMMANDS if getattr(mapping, name) is not None]
        # Samples that cannot be judged until the next samples arrive.
        self._stamps_ns = np.empty(0, dtype=np.int64)
        self._waiting: dict[str, NDArray[np.float64]] = {}
        # The latest finite values returned, and the last sample returned.
        self._past: dict[str, NDArray[np.float64]] = {}
        self._before: dict[str, float] = {}

    def push(
        self,
        stamps_ns: NDArray[np.int64],
        raw: Mapping[str, NDArray[np.float64]],
        *,
        is_last: bool = False,
    ) -> tuple[NDArray[np.int64], dict[str, NDArray[np.float64]]]:
        """Return stamps and columns, ``(n,)`` each, with impossible samples replaced or dropped.

        Blocks must be passed in order. Samples at the end of a block are held back if they cannot
        be judged without the next block; ``is_last`` releases all of them.
        """
        if self._waiting:
            stamps_ns = np.concatenate([self._stamps_ns, stamps_ns])
            raw = {name: np.concatenate([self._waiting[name], raw[name]]) for name in raw}
        columns = {name: np.array(values) for name, values in raw.items()}
        findings = self._find(columns, is_last=is_last)
        n, passed = len(stamps_ns), findings.first_open
        if is_last or n - passed > _MOST_WAITING:
            passed = n
        self._stamps_ns = stamps_ns[passed:]
        self._waiting = {name: np.array(raw[name][passed:]) for name in raw}
        self.count += int(np.count_nonzero(findings.is_impossible[:passed]))
        for name in columns:
            bad = findings.bridged | findings.dropped
            if name in findings.commands:
                bad |= findings.commands[name]
            columns[name] = self._bridged(name, columns[name], bad)[:passed]
        self._remember(columns, findings.dropped[:passed])
        kept = ~findings.dropped[:passed]
        if np.all(kept):
            return stamps_ns[:passed], columns
        return stamps_ns[:passed][kept], {name: values[kept] for name, values in columns.items()}

    def _find(self, columns: Mapping[str, NDArray[np.float64]], *, is_last: bool) -> _Findings:
        sensors = {name: columns[name] for name in _SENSORS if name in columns}
        n = len(columns["position"])
        absurd = np.any([np.abs(values) > _ABSURD for values in sensors.values()], axis=0)
        absurd |= self._excessive(sensors, n)
        bridged, dropped, first_open = self._empty(sensors, n, is_last=is_last)
        bridged |= absurd
        if "command" in self._commands:
            outages, open_outage = self._command_outages(columns["command"], is_last=is_last)
            dropped |= outages & ~bridged
            first_open = min(first_open, open_outage)
        flaws, open_spike = self._spikes(
            "position", np.where(bridged | dropped, np.nan, columns["position"]), is_last=is_last
        )
        bridged |= flaws
        first_open = min(first_open, open_spike, _last_run(bridged))
        commands: dict[str, NDArray[np.bool_]] = {}
        for name in self._commands:
            flaws = np.abs(columns[name]) > _ABSURD
            spikes, open_spike = self._spikes(
                name, np.where(flaws | bridged | dropped, np.nan, columns[name]), is_last=is_last
            )
            commands[name] = flaws | spikes
            first_open = min(first_open, open_spike, _last_run(commands[name]))
        # Interpolation must end at a sample that has been judged valid.
        flaws = np.any([bridged, *commands.values()], axis=0)
        while 0 < first_open < n and flaws[first_open - 1]:
            first_open -= 1
        return _Findings(bridged, dropped, commands, first_open)

    def _bridged(
        self, name: str, values: NDArray[np.float64], bad: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Interpolate bad samples linearly in place, and return the column.

        Bad samples at the end have the last good value.
        """
        if not np.any(bad):
            return values
        kept = np.flatnonzero(~bad)
        good = values[kept]
        if name in self._before:
            kept = np.concatenate([[-1], kept])
            good = np.concatenate([[self._before[name]], good])
        if len(kept):
            values[bad] = np.interp(np.flatnonzero(bad), kept, good)
        return values

    def _remember(
        self, columns: Mapping[str, NDArray[np.float64]], dropped: NDArray[np.bool_]
    ) -> None:
        """Store the last samples, with which the next block is compared."""
        kept = np.flatnonzero(~dropped)
        if not len(kept):
            return
        self._before = {name: float(values[kept[-1]]) for name, values in columns.items()}
        for name in ("position", *self._commands):
            values = columns[name][kept]
            past = self._past.get(name, np.empty(0))
            self._past[name] = np.concatenate([past, values[np.isfinite(values)]])[-_REMEMBERED:]

    def _empty(
        self, sensors: Mapping[str, NDArray[np.float64]], n: int, *, is_last: bool
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], int]:
        """Return masks of empty messages, and the first sample that cannot be judged yet.

        All sensor columns are 0 in an empty message; at least two are nonzero before and after. The
        masks, ``(n,)`` each, mark the messages to interpolate and the messages to drop.
        """
        bridged, dropped = np.zeros(n, bool), np.zeros(n, bool)
        zero = np.all([values == 0.0 for values in sensors.values()], axis=0)
        if len(sensors) < 2 or not np.any(zero):
            return bridged, dropped, n
        filled = [int(np.count_nonzero([self._before.get(name, 0.0) for name in sensors]))]
        filled += np.count_nonzero([*sensors.values()], axis=0).tolist()
        position, first_open = sensors["position"], n
        for first, end in _runs(zero):
            length = end - first
            if filled[first] < 2 or length > _MOST_ZEROS:
                continue
            is_short = length <= MOST_IN_A_ROW
            if not is_short and not self._is_jump(position, first):
                continue
            if end < n:
                bridged[first:end] = is_short and filled[end + 1] >= 2
                dropped[first:end] = not is_short and self._is_jump(position, end)
            elif is_last:
                bridged[first:end] = is_short
            else:
                first_open = first
        return bridged, dropped, first_open

    def _command_outages(
        self, command: NDArray[np.float64], *, is_last: bool
    ) -> tuple[NDArray[np.bool_], int]:
        """Return a mask of zeros within a moving command, and the first sample not judged yet."""
        outages, first_open = np.zeros(len(command), bool), len(command)
        past = self._past.get("command", np.empty(0))
        series = np.concatenate([past, command])
        moving = series[np.isfinite(series) & (series != 0.0)]
        if not np.any(command == 0.0) or len(moving) < FEWEST:
            return outages, first_open
        thresholds = JumpThresholds.of(moving)
        jump = max(thresholds.least_step, thresholds.least_change)
        for first, end in _runs(series == 0.0):
            before, after = series[max(first - _NEAR, 0) : first], series[end : end + _NEAR]
            length, start = end - first, max(first - len(past), 0)
            if end <= len(past) or length > _MOST_ZEROS or not _moves(before, jump, -1):
                continue
            if len(after) < _NEAR and not is_last:
                first_open = min(first_open, start)
            elif length > MOST_IN_A_ROW and _moves(after, jump, 0):
                fastest = max(np.max(np.abs(np.diff(part))) for part in (before, after))
                is_continued = abs(after[0] - before[-1]) <= _TIMES_FASTEST * (length + 1) * fastest
                # A command that passes through 0 may have a dead band.
                if is_continued and after[0] * before[-1] > 0.0:
                    outages[start : end - len(past)] = True
        return outages, first_open

    def _is_jump(self, position: NDArray[np.float64], row: int) -> bool:
        """Return whether the position jumps between the previous sample and this one."""
        before = position[row - 1] if row else self._before.get("position", position[row])
        step = abs(float(position[row] - before))
        if "position" in self._limits:
            return step > self._limits["position"]
        finite = position[np.isfinite(position) & (position != 0.0)]
        positions = np.concatenate([self._past.get("position", np.empty(0)), finite])
        if len(positions) < FEWEST:
            return False
        thresholds = JumpThresholds.of(positions)
        return step > max(thresholds.least_step, thresholds.least_change)

    def _spikes(
        self, name: str, values: NDArray[np.float64], *, is_last: bool
    ) -> tuple[NDArray[np.bool_], int]:
        """Return a mask of excursions, ``(n,)``, and the first sample that cannot be judged yet."""
        spikes = np.zeros(len(values), bool)
        rows = np.flatnonzero(np.isfinite(values))
        past = self._past.get(name, np.empty(0))
        series = np.concatenate([past, values[rows]])
        if name == "position" and name in self._limits:
            excursions = self._beyond_limit(series, len(past), is_last=is_last)
        else:
            excursions = find_excursions(series, len(past), is_last=is_last)
        for first, end in excursions.parts:
            spikes[rows[first - len(past) : end - len(past)]] = True
        if excursions.first_open is None:
            return spikes, len(values)
        return spikes, int(rows[max(excursions.first_open - len(past), 0)])

    def _beyond_limit(
        self, positions: NDArray[np.float64], first: int, *, is_last: bool
    ) -> Excursions:
        """Return position excursions that are faster than the modelled drive can move."""
        if len(positions) < FEWEST:
            return Excursions([], None)
        steps = np.abs(np.diff(positions))
        least_step = max(_STEPS * float(np.percentile(steps, 98.0)), self._limits["position"])
        parts: list[tuple[int, int]] = []
        end, first_open = max(first, 1), None
        for row in (np.flatnonzero(steps > least_step) + 1).tolist():
            if row < end:
                continue
            after = np.abs(positions[row + 1 : row + 1 + MOST_IN_A_ROW] - positions[row - 1])
            back = np.flatnonzero(after <= 0.5 * least_step)
            if len(back):
                end = row + int(back[0]) + 1
                parts.append((row, end))
            elif not is_last and first_open is None and len(positions) - row <= MOST_IN_A_ROW:
                first_open = row
        return Excursions(parts, first_open)

    def _excessive(self, sensors: Mapping[str, NDArray[np.float64]], n: int) -> NDArray[np.bool_]:
        """Return a mask, ``(n,)``, of speeds or currents that briefly exceed their limit."""
        is_excessive = np.zeros(n, bool)
        for name in ("speed", "current"):
            if name in self._limits and name in sensors:
                is_excessive |= np.abs(sensors[name]) > self._limits[name]
        for start, end in _runs(is_excessive):
            if end - start > MOST_IN_A_ROW:
                is_excessive[start:end] = False
        return is_excessive


def _moves(command: NDArray[np.float64], jump: float, edge: int) -> bool:
    """Return whether a command moves, and its value at the edge is a jump away from 0."""
    if len(command) < _NEAR or not np.all(np.isfinite(command)):
        return False
    return bool(abs(command[edge]) > jump and np.median(np.abs(np.diff(command))) > 0.0)


def _runs(chosen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return start and end (exclusive) of each run of true values."""
    edges = np.flatnonzero(np.diff(chosen, prepend=False, append=False))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _last_run(chosen: NDArray[np.bool_]) -> int:
    """Return the start of the trailing run of true values; the length if there is none."""
    rows = np.flatnonzero(~chosen)
    return int(rows[-1]) + 1 if len(rows) else 0
