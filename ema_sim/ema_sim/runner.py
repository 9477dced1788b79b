"""Runs a test bench cycle by cycle, synchronised with the wall clock, in its own thread."""

import threading
import time
from collections.abc import Callable
from typing import Final

from ema_core.telemetry import Telemetry
from ema_sim.bench import ActuatorBench, RunningCycle
from ema_sim.pacing import TOLERANCE_S, Pace, Pacer

_JOIN_TIMEOUT_S: Final = 0.5


class BenchRunner:
    """Runs the cycles of a bench from start to stop.

    At rate 1 the stamps follow the wall clock: a cycle starts at the end of the previous one, or at
    the present time where that differs by more than the tolerance. At other rates simulated time
    continues without a gap from the first start.

    Parameters
    ----------
    bench
        The bench.
    rate
        Simulated over wall time [-].
    on_cycle
        Called when a cycle starts.
    on_block
        Called with each block when its last sample is due, and the torque of the motor at its
        end [N.m].
    on_failure
        Called with the exception that ended the run.

    Attributes
    ----------
    doing
        Current activity, in words.
    cycle
        Running number of the cycle.
    """

    def __init__(
        self,
        bench: ActuatorBench,
        rate: float,
        *,
        on_cycle: Callable[[RunningCycle], None],
        on_block: Callable[[Telemetry, float], None],
        on_failure: Callable[[Exception], None],
    ) -> None:
        self.doing = "idle"
        self.cycle = 0
        self._bench = bench
        self._rate = rate
        self._on_cycle = on_cycle
        self._on_block = on_block
        self._on_failure = on_failure
        self._pacer = Pacer(rate)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def pace(self) -> Pace:
        """Lag and rate of the simulation."""
        return self._pacer.pace()

    def start(self) -> None:
        """Start to run, with a new cycle."""
        self._stop = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(self._stop,), name="simulation", daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """Stop at the next block, for which ``on_block`` is no longer called."""
        self._stop.set()
        if self._thread is not None:
            # A compilation cannot be interrupted; its thread ends by itself afterwards.
            self._thread.join(_JOIN_TIMEOUT_S)
        self.doing = "idle"

    def _run(self, stop: threading.Event) -> None:
        try:
            self.doing = "compiling kernels"
            self._bench.compile_kernels()
            if stop.is_set():
                return
            self.doing = "running"
            self._pacer = Pacer(self._rate)
            while self._run_cycle(stop):
                pass
        except Exception as error:
            self.doing = f"failed: {error}"
            self._on_failure(error)

    def _run_cycle(self, stop: threading.Event) -> bool:
        start_ns = self._start_ns()
        cycle = self._bench.begin_cycle(start_ns)
        self._pacer.begin_cycle(from_now=start_ns is not None)
        self.cycle = cycle.number
        self._on_cycle(cycle)
        for block, torque in cycle.blocks:
            if not self._pacer.wait(len(block) * block.sample_period, stop):
                return False
            self._on_block(block, torque)
        return True

    def _start_ns(self) -> int | None:
        """Return the start of the next cycle [ns]; None for the end of the previous one."""
        now_ns, end_ns = time.time_ns(), self._bench.end_ns
        if self._rate != 1.0:
            return None if end_ns else now_ns
        return now_ns if abs(now_ns - end_ns) > 1e9 * TOLERANCE_S else None
