"""Duty measured from telemetry, block by block."""

import threading
from collections import deque
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core._jit import kernel
from ema_core.description import UnitKey
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.prognosis.duty.flown import (
    CLASS_KELVIN,
    LEAST_RISE,
    WINDING_CLASSES,
    FlownDuty,
    together,
)

RESOLUTION: Final = 5e-4
"""Travel of the user shaft below which a motion is noise of its sensor [rad]."""

_MOST_PIECES: Final = 1000
_MOST_UNITS: Final = 1000
_MOST_LOAD: Final = 10.0
_S_PER_HOUR: Final = 3600.0


@kernel()
def count_travel(
    position: NDArray[np.float64],
    load: NDArray[np.float64],
    last: float,
    amount: NDArray[np.float64],
    moment: NDArray[np.float64],
) -> float:
    """Count the travel of a shaft by load, in place; return from where to count on.

    Parameters
    ----------
    position
        Angles of the user shaft [rad], ``(n,)``.
    load
        Loads [-], ``(n,)``.
    last
        Angle up to which travel is counted [rad]; NaN when there was none before.
    amount, moment
        Travel [rad], and the sum of travel times load [rad], by class, ``(k,)``.
    """
    for i in range(position.size):
        way = abs(position[i] - last)
        if way >= RESOLUTION:
            number = min(int(load[i] * amount.size), amount.size - 1)
            amount[number] += way
            moment[number] += way * load[i]
            last = position[i]
        elif not way < RESOLUTION:
            last = position[i]
    return last


class DutyMeter:
    """Sums up the duty in the telemetry of one unit.

    Blocks that follow one another without a gap are one motion. Where the current is not measured
    the load counts as 1, so that travel alone counts.
    """

    def __init__(self) -> None:
        self._last = np.nan
        self._next_index = -1
        self._flown = FlownDuty()

    def add(
        self, block: Telemetry, parameters: ActuatorParameters, rise: float | None = None
    ) -> None:
        """Add a block.

        Parameters
        ----------
        parameters
            Those of the unit.
        rise
            Of the winding over its calibrated state [K]; None when it is not known.
        """
        if block.first_index != self._next_index:
            self._last = np.nan
        self._next_index = block.first_index + len(block)
        position = np.ascontiguousarray(block.position, dtype=np.float64)
        load = np.ones(len(block))
        if len(block.current):
            load = np.minimum(np.abs(block.current) / parameters.I_max, _MOST_LOAD)
        known = np.isfinite(position) & ~np.isnan(load)
        self._last = count_travel(position[known], load[known], self._last, *self._flown.travel)
        hours = len(block) * block.sample_period / _S_PER_HOUR
        self._flown = replace(self._flown, hours=self._flown.hours + hours)
        if rise is not None:
            number = int((rise - LEAST_RISE) / CLASS_KELVIN)
            number = min(max(number, 0), WINDING_CLASSES - 1)
            self._flown.winding[:, number] += hours, hours * rise

    def take(self) -> FlownDuty:
        """Return the duty since the last call."""
        flown, self._flown = self._flown, FlownDuty()
        return flown


class DutyLog:
    """Duty by unit, cut at the ends of windows; any thread may call.

    Of more than a thousand units those without telemetry for longest are dropped; more than a
    thousand pieces of a unit that no test takes are put together.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._meters: dict[UnitKey, DutyMeter] = {}
        self._pieces: dict[UnitKey, deque[tuple[int, FlownDuty]]] = {}

    def add(
        self,
        unit: UnitKey,
        block: Telemetry,
        parameters: ActuatorParameters,
        rise: float | None = None,
    ) -> None:
        """Add a block of telemetry, as ``DutyMeter.add`` does."""
        with self._lock:
            meter = self._meters[unit] = self._meters.pop(unit, None) or DutyMeter()
            meter.add(block, parameters, rise)
            if len(self._meters) > _MOST_UNITS:
                oldest = next(iter(self._meters))
                del self._meters[oldest]
                self._pieces.pop(oldest, None)

    def cut(self, unit: UnitKey, end_ns: int) -> None:
        """Assign the duty since the last cut to a window by the stamp of its end [ns]."""
        with self._lock:
            meter = self._meters.get(unit)
            if meter is None:
                return
            pieces = self._pieces.setdefault(unit, deque())
            pieces.append((end_ns, meter.take()))
            if len(pieces) > _MOST_PIECES:
                (_, one), (stamp_ns, other) = pieces.popleft(), pieces.popleft()
                pieces.appendleft((stamp_ns, one + other))

    def take(self, unit: UnitKey, end_ns: int) -> FlownDuty | None:
        """Return the duty of the windows by a stamp [ns], once; None without any telemetry."""
        with self._lock:
            # Of any order: one whose stamp is wrong holds back no other.
            pieces, flown = self._pieces.get(unit, deque()), None
            for _ in range(len(pieces)):
                stamp_ns, piece = pieces.popleft()
                if stamp_ns <= end_ns:
                    flown = together(flown, piece)
                else:
                    pieces.append((stamp_ns, piece))
            return flown

    def forget(self, actuator_id: str) -> None:
        """Forget what no test of an actuator has taken."""
        with self._lock:
            for of_it in (self._meters, self._pieces):
                for unit in [unit for unit in of_it if unit[0] == actuator_id]:
                    del of_it[unit]

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._meters.clear()
            self._pieces.clear()
