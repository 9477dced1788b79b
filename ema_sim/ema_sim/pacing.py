"""Synchronises simulated time with the wall clock and measures how far it lags."""

import math
import threading
import time
from collections.abc import Callable
from typing import Final, NamedTuple

TOLERANCE_S: Final = 0.1
"""Lateness that is caught up [s]; beyond it the schedule is shifted."""

_MEASURED_S: Final = 1.0


class Pace(NamedTuple):
    """Lag and rate of the simulation.

    ``behind`` is whether it was late by more than ``TOLERANCE_S`` in this or the previous cycle,
    ``lag_s`` the largest lag in them [s]. ``achieved_rate`` is simulated over wall time and
    ``busy_share`` the share of wall time that was not spent waiting, both of the last one to two
    seconds.
    """

    behind: bool
    lag_s: float
    achieved_rate: float
    busy_share: float


class _Mark(NamedTuple):
    wall_s: float
    simulated_s: float
    waited_s: float


class Pacer:
    """Waits until a block is due.

    Short delays are caught up. After a longer one the schedule continues from the present, so that
    a suspended process does not publish all missed blocks in a burst.

    Parameters
    ----------
    rate
        Simulated over wall time [-].
    clock
        Monotonic wall clock [s].
    """

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate = rate
        self._clock = clock
        self._simulated_s = self._waited_s = 0.0
        self._lag_s = self._lag_before_s = self._given_up_s = 0.0
        self._due = clock()
        self._marks = (self._mark(self._due),) * 2

    def begin_cycle(self, *, from_now: bool) -> None:
        """Begin a cycle.

        Parameters
        ----------
        from_now
            Whether its schedule starts now instead of at the end of the previous cycle's.
        """
        self._lag_before_s, self._lag_s, self._given_up_s = self._lag_s, 0.0, 0.0
        if from_now:
            self._due = self._clock()

    def wait(self, simulated_s: float, stop: threading.Event) -> bool:
        """Wait until the next block is due.

        Parameters
        ----------
        simulated_s
            Its length [s].
        stop
            Ends the wait when it is set.

        Returns
        -------
        bool
            Whether it is due; False when ``stop`` ended the wait.
        """
        self._due += simulated_s / self._rate
        before = now = self._clock()
        while now < self._due:
            if stop.wait(self._due - now):
                return False
            now = self._clock()
        self._waited_s += now - before
        self._simulated_s += simulated_s
        late = now - self._due
        self._lag_s = max(self._lag_s, self._given_up_s + late)
        if late > TOLERANCE_S:
            self._given_up_s += late
            self._due = now
        if now - self._marks[1].wall_s >= _MEASURED_S:
            self._marks = (self._marks[1], self._mark(now))
        return not stop.is_set()

    def pace(self) -> Pace:
        """Return lag and rate of the simulation; any thread may call this."""
        mark = self._marks[0]
        elapsed = self._clock() - mark.wall_s
        lag = max(self._lag_s, self._lag_before_s)
        if elapsed <= 0.0:
            return Pace(lag > TOLERANCE_S, lag, math.nan, math.nan)
        return Pace(
            lag > TOLERANCE_S,
            lag,
            (self._simulated_s - mark.simulated_s) / elapsed,
            1.0 - (self._waited_s - mark.waited_s) / elapsed,
        )

    def _mark(self, now: float) -> _Mark:
        return _Mark(now, self._simulated_s, self._waited_s)
