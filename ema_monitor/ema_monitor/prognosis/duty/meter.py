# SPDX-License-Identifier: Apache-2.0
"""Measurement of the duty from telemetry, block by block."""

from collections import deque
from dataclasses import replace
from typing import Final

import numpy as np

from ema_core._jit import kernel
from ema_core.arrays import Array
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.prognosis.duty.damage import CLASS_KELVIN, LEAST_RISE, WINDING_CLASSES, FlownDuty

RESOLUTION: Final = 5e-4
"""Travel of the user shaft below which a motion is sensor noise [rad]."""

_MOST_LOAD: Final = 10.0
_S_PER_HOUR: Final = 3600.0


@kernel(nogil=False)
def count_travel(
    position: Array, current: Array, limit: float, last: float, amount: Array, moment: Array
) -> float:
    """Add the travel of a shaft to load classes, in place. Return the last counted angle.

    Samples without a finite position or with a NaN current are skipped. Travel is counted once it
    reaches ``RESOLUTION``.

    Parameters
    ----------
    position
        Angles of the user shaft [rad], ``(n,)``.
    current
        Currents [A], ``(n,)``, or ``(0,)`` if the current is not measured; the load is then 1.
    limit
        Current at which the load is 1 [A].
    last
        Angle up to which travel was counted before [rad]; NaN at the start.
    amount, moment
        Travel [rad], and sum of travel times load [rad], by load class, ``(k,)``; updated in place.
    """
    for i in range(position.size):
        load = min(abs(current[i]) / limit, _MOST_LOAD) if current.size else 1.0
        if not np.isfinite(position[i]) or np.isnan(load):
            continue
        distance = abs(position[i] - last)
        if distance >= RESOLUTION:
            number = min(int(load * amount.size), amount.size - 1)
            amount[number] += distance
            moment[number] += distance * load
            last = position[i]
        elif not distance < RESOLUTION:
            last = position[i]
    return last


class DutyMeter:
    """Accumulates the duty of one unit from its telemetry.

    Successive blocks without a gap form one motion. If the current is not measured, the load is
    assumed to be 1.

    Parameters
    ----------
    pieces
        Queue to which ``cut`` appends a window's end stamp [ns] and the duty since the last cut.
    most_pieces
        Largest length of the queue; beyond it, the two oldest pieces are merged. None: unlimited.
    """

    def __init__(
        self, pieces: deque[tuple[int, FlownDuty]], most_pieces: int | None = None
    ) -> None:
        self.pieces = pieces
        self._most_pieces = most_pieces
        self._last = np.nan
        self._next_index = -1
        self._hours = 0.0
        self._flown = FlownDuty()

    def add(
        self, block: Telemetry, parameters: ActuatorParameters, rise: float | None = None
    ) -> None:
        """Add the duty of a block of telemetry.

        ``rise`` is the temperature rise of the winding over the calibrated state [K]; None if
        unknown.
        """
        if block.first_index != self._next_index:
            self._last = np.nan
        self._next_index = block.first_index + len(block)
        position, current = (
            np.ascontiguousarray(column, dtype=np.float64)
            for column in (block.position, block.current)
        )
        self._last = count_travel(
            position, current, parameters.I_max, self._last, *self._flown.travel
        )
        hours = len(block) * block.sample_period / _S_PER_HOUR
        self._hours += hours
        if rise is not None:
            number = int((rise - LEAST_RISE) / CLASS_KELVIN)
            number = min(max(number, 0), WINDING_CLASSES - 1)
            self._flown.winding[:, number] += hours, hours * rise

    def cut(self, end_ns: int) -> None:
        """Assign the duty since the last cut to the window that ends at ``end_ns`` [ns]."""
        self.pieces.append((end_ns, replace(self._flown, hours=self._hours)))
        if self._most_pieces and len(self.pieces) > self._most_pieces:
            (_, oldest), (stamp_ns, second) = self.pieces.popleft(), self.pieces.popleft()
            self.pieces.appendleft((stamp_ns, oldest + second))
        self._hours = 0.0
        self._flown = FlownDuty()

    def take(self, end_ns: int) -> FlownDuty:
        """Remove and return the duty of all windows up to the stamp ``end_ns`` [ns]."""
        # The queue may be out of order: a wrong stamp must not block other windows.
        taken = [piece for piece in self.pieces if piece[0] <= end_ns]
        for piece in taken:
            self.pieces.remove(piece)
        return sum((flown for _, flown in taken), FlownDuty())
