# SPDX-License-Identifier: Apache-2.0
"""Execution of a simulation in a thread, cycle by cycle, synchronised with the wall clock."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar

from ema_core.steady_thread import SteadyThread

TOLERANCE_S: Final = 0.1
"""Largest delay that is caught up [s]; longer delays shift the schedule."""

_MEASURED_S: Final = 1.0
_JOIN_TIMEOUT_S: Final = 0.5


class SimulationPace(NamedTuple):
    """Lag and rate of the simulation."""

    behind: bool
    """Whether a block of this or the previous cycle was late by more than ``TOLERANCE_S``."""
    lag_s: float
    """Largest lag in this and the previous cycle [s]."""
    achieved_rate: float
    """Ratio of simulated to wall time over the last one to two seconds [-]."""
    busy_share: float
    """Share of wall time not spent waiting, over the last one to two seconds [-]."""


class _Mark(NamedTuple):
    wall_s: float
    simulated_s: float
    waited_s: float


class Pacer:
    """Delays each block until it is due, at a rate relative to the wall clock.

    Delays up to ``TOLERANCE_S`` are caught up. After a longer delay the schedule continues from the
    current time, so that a suspended process does not publish missed blocks in a burst.

    Parameters
    ----------
    rate
        Ratio of simulated to wall time [-].
    clock
        Monotonic wall clock [s].
    """

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate = rate
        self._clock = clock
        self._simulated_s = self._waited_s = 0.0
        self._lag_s = self._lag_before_s = self._skipped_s = 0.0
        self._due = clock()
        self._marks = (self._mark(self._due),) * 2

    def begin_cycle(self, *, from_now: bool) -> None:
        """Start a cycle; its schedule starts now or at the end of the previous cycle."""
        self._lag_before_s, self._lag_s, self._skipped_s = self._lag_s, 0.0, 0.0
        if from_now:
            self._due = self._clock()

    def wait(self, simulated_s: float, stop: threading.Event) -> bool:
        """Wait until the end of the next block is due; return False if ``stop`` is set.

        Parameters
        ----------
        simulated_s
            Length of the block [s].
        stop
            Event that ends the wait.
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
        self._lag_s = max(self._lag_s, self._skipped_s + late)
        if late > TOLERANCE_S:
            self._skipped_s += late
            self._due = now
        if now - self._marks[1].wall_s >= _MEASURED_S:
            self._marks = (self._marks[1], self._mark(now))
        return not stop.is_set()

    def pace(self) -> SimulationPace:
        """Return lag and rate of the simulation. Thread-safe."""
        mark = self._marks[0]
        elapsed = self._clock() - mark.wall_s
        lag = max(self._lag_s, self._lag_before_s)
        rate = busy = math.nan
        if elapsed > 0.0:
            rate = (self._simulated_s - mark.simulated_s) / elapsed
            busy = 1.0 - (self._waited_s - mark.waited_s) / elapsed
        return SimulationPace(lag > TOLERANCE_S, lag, rate, busy)

    def _mark(self, now: float) -> _Mark:
        return _Mark(now, self._simulated_s, self._waited_s)


class Block(Protocol):
    """Simulated samples that are published together."""

    @property
    def duration_s(self) -> float:
        """Length of the block [s]."""
        ...


class CycleProgress(Protocol):
    """Cycle in progress."""

    @property
    def number(self) -> int:
        """Running number, from 0."""
        ...

    @property
    def blocks(self) -> Iterator[Any]:
        """Blocks of the cycle, computed on demand."""
        ...


AnyBlock = TypeVar("AnyBlock", bound=Block)
AnyCycle = TypeVar("AnyCycle", bound=CycleProgress)
CycleOut = TypeVar("CycleOut", bound=CycleProgress, covariant=True)


class Bench(Protocol[CycleOut]):
    """Simulation that runs in cycles."""

    @property
    def end_ns(self) -> int:
        """End of the last sample so far [ns]."""
        ...

    def compile_kernels(self) -> None:
        """Compile the kernels of the simulation, or load them from the cache."""

    def begin_cycle(self, start_ns: int | None = None) -> CycleOut:
        """Start and return the next cycle.

        It starts at ``start_ns`` [ns], by default at the end of the last sample.
        """
        ...


class BenchRunner(Generic[AnyCycle, AnyBlock]):
    """Runs the cycles of a bench from start to stop.

    At rate 1 the stamps follow the wall clock: a cycle starts at the end of the previous cycle, or
    at the present time if the two differ by more than the tolerance. At other rates simulated time
    continues without a gap from the first start.

    Parameters
    ----------
    bench
        The simulation.
    rate
        Ratio of simulated to wall time [-].
    on_cycle
        Called when a cycle starts.
    on_block
        Called with each block when its last sample is due.
    on_failure
        Called with reason and traceback when the run has ended unexpectedly; the run is restarted
        with a new cycle.

    Attributes
    ----------
    activity
        Current activity, as a phrase.
    cycle
        Running number of the latest cycle, from 0.
    thread
        Thread of the run.
    """

    def __init__(
        self,
        bench: Bench[AnyCycle],
        rate: float,
        *,
        on_cycle: Callable[[AnyCycle], None],
        on_block: Callable[[AnyBlock], None],
        on_failure: Callable[[str, str], object],
    ) -> None:
        self.activity = "idle"
        self.cycle = 0
        self._bench = bench
        self._rate = rate
        self._on_cycle = on_cycle
        self._on_block = on_block
        self._on_failure = on_failure
        self._pacer = Pacer(rate)
        self._prepare()

    @property
    def pace(self) -> SimulationPace:
        """Lag and rate of the simulation."""
        return self._pacer.pace()

    def start(self) -> None:
        """Start the thread with a new cycle."""
        self._prepare()
        self.thread.start()

    def stop(self) -> None:
        """Stop before the next call of ``on_block``."""
        # A compilation cannot be interrupted; the thread ends after it.
        self.thread.end(_JOIN_TIMEOUT_S)
        self.activity = "idle"

    def _prepare(self) -> None:
        # The previous thread may still be compiling.
        self.thread = thread = SteadyThread(
            "simulation", lambda: self._run(thread.ending), self._on_failure
        )

    def _run(self, stop: threading.Event) -> None:
        self.activity = "compiling kernels"
        self._bench.compile_kernels()
        if stop.is_set():
            return
        self.activity = "running"
        self._pacer = Pacer(self._rate)
        while self._run_cycle(stop):
            pass

    def _run_cycle(self, stop: threading.Event) -> bool:
        start_ns = self._start_ns()
        cycle = self._bench.begin_cycle(start_ns)
        self._pacer.begin_cycle(from_now=start_ns is not None)
        self.cycle = cycle.number
        self._on_cycle(cycle)
        for block in cycle.blocks:
            if not self._pacer.wait(block.duration_s, stop):
                return False
            self._on_block(block)
        return True

    def _start_ns(self) -> int | None:
        """Return the start of the next cycle [ns]; None for the end of the previous cycle."""
        now_ns, end_ns = time.time_ns(), self._bench.end_ns
        if self._rate != 1.0:
            return None if end_ns else now_ns
        return now_ns if abs(now_ns - end_ns) > 1e9 * TOLERANCE_S else None
