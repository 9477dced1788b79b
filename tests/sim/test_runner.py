"""Cycles in step with the wall clock: when blocks come, what they are stamped, and lateness."""

import threading
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_sim import runner
from ema_sim.bench import ActuatorBench, BenchSettings, RunningCycle
from ema_sim.runner import TOLERANCE_S, BenchRunner, Pacer


class Clock(threading.Event):
    """A clock that only waiting moves, or whoever is said to be slow."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 100.0

    def __call__(self) -> float:
        return self.now

    def time_ns(self) -> int:
        return round(1e9 * self.now)

    def restarted(self) -> "Clock":
        """As the event of a new start."""
        self.clear()
        return self

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        if not self.is_set():
            self.now += timeout
        return self.is_set()


@pytest.mark.parametrize("rate", [0.01, 1.0, 4.0])
def test_blocks_are_due_at_the_end_of_their_last_sample(rate):
    clock = Clock()
    pacer = Pacer(rate, clock)
    for i in range(1, 301):
        clock.now += 0.3 * 0.01 / rate  # computing takes a part of the time
        assert pacer.wait(0.01, clock)
        assert clock.now == pytest.approx(100.0 + i * 0.01 / rate, abs=1e-9)
    pace = pacer.pace()
    assert not pace.behind
    assert pace.achieved_rate == pytest.approx(rate, rel=1e-9)
    assert pace.busy_share == pytest.approx(0.3, rel=1e-6)


def test_short_delay_is_made_up_for():
    clock = Clock()
    pacer = Pacer(1.0, clock)
    clock.now += 0.8 * TOLERANCE_S
    for _ in range(20):
        pacer.wait(0.01, clock)
    assert clock.now == pytest.approx(100.2)
    assert not pacer.pace().behind


def test_after_a_long_delay_the_schedule_goes_on_from_there():
    clock = Clock()
    pacer = Pacer(1.0, clock)
    clock.now += 5.0
    arrivals = []
    for _ in range(4):
        pacer.wait(0.01, clock)
        arrivals.append(clock.now)
    np.testing.assert_allclose(np.diff(arrivals), 0.01, rtol=0, atol=1e-9)
    assert pacer.pace().behind
    assert pacer.pace().lag_s == pytest.approx(4.99)


class Run:
    """A runner in simulated time, whose blocks are kept with the time at which they came."""

    def __init__(
        self, clock: Clock, rate: float = 1.0, stall_at: int = -1, stall_s: float = 0.0
    ) -> None:
        self.clock = clock
        self.bench = ActuatorBench(ActuatorDescription(), BenchSettings())
        self.bench.set_command(Command("step", amplitude=1e-3, duration=2e-3))
        self.cycles: list[RunningCycle] = []
        self.blocks: list[Telemetry] = []
        self.arrivals_ns: list[int] = []
        self.failures: list[str] = []
        self._stall = stall_at, stall_s
        self._last = 0
        self.runner = BenchRunner(
            self.bench,
            rate,
            on_cycle=self.cycles.append,
            on_block=self._keep,
            on_failure=self._fail,
        )

    def _keep(self, block: Telemetry, torque: float) -> None:
        self.arrivals_ns.append(self.clock.time_ns())
        if len(self.blocks) == self._stall[0]:
            self.clock.now += self._stall[1]
        self.blocks.append(block)
        if len(self.blocks) == self._last:
            assert self.runner._thread is not None
            self.runner._thread.ending.set()
            self.clock.set()

    def _fail(self, failure: str, trace: str) -> None:
        self.failures.append(failure)
        assert self.runner._thread is not None
        self.runner._thread.ending.set()

    def until(self, blocks: int) -> None:
        """Run until there are so many blocks, or it fails."""
        self._last = blocks
        self.runner.start()
        thread = self.runner._thread
        assert thread is not None
        thread._thread.join()
        self.runner.stop()

    def lateness_s(self) -> np.ndarray:
        ends = np.array([block.stamps_ns[-1] for block in self.blocks])
        return 1e-9 * (np.array(self.arrivals_ns) - ends)


@pytest.fixture
def make_run(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Run]:
    """Make a runner whose clocks stand still unless it waits."""
    clock = Clock()
    events = SimpleNamespace(Event=clock.restarted, Thread=threading.Thread)
    monkeypatch.setattr(runner, "threading", events)
    monkeypatch.setattr(runner, "time", clock)
    monkeypatch.setattr(runner, "Pacer", lambda rate: Pacer(rate, clock))
    return partial(Run, clock)


@pytest.fixture(scope="module", autouse=True)
def _kernels():
    ActuatorBench(ActuatorDescription()).compile_kernels()


def blocks_per_cycle(run: Run) -> int:
    return -(-run.cycles[0].samples // 100)


def test_stamps_are_those_of_the_wall_clock_and_run_on(make_run):
    run = make_run()
    run.until(150)
    late = run.lateness_s()
    # Times of 100 s are added up, which costs some 1e-14 s each; stamps are whole nanoseconds.
    np.testing.assert_allclose(late, 0.0, atol=1e-8)
    assert len(run.cycles) == 2
    assert run.cycles[1].start_ns == run.cycles[0].start_ns + 100_000 * run.cycles[0].samples
    steps = [b.stamp_ns - a.stamps_ns[-1] for a, b in zip(run.blocks, run.blocks[1:], strict=False)]
    assert set(steps) == {100_000}


def test_after_a_stall_no_burst_and_the_next_cycle_on_the_wall_clock_again(make_run):
    run = make_run(stall_at=20, stall_s=0.4)
    run.until(170)
    gaps = 1e-9 * np.diff(run.arrivals_ns)
    assert gaps[20] == pytest.approx(0.4, abs=1e-6)
    # Twenty blocks take their time: made up for in a burst they would come at once.
    assert gaps[21:41].sum() == pytest.approx(0.2, abs=1e-6)
    per_cycle = blocks_per_cycle(run)
    late = run.lateness_s()
    assert late[25:per_cycle].min() > 0.3
    np.testing.assert_allclose(late[per_cycle:], 0.0, atol=1e-8)
    indices = [block.first_index for block in run.blocks]
    ends = [block.first_index + len(block) for block in run.blocks]
    assert indices[1:] == ends[:-1]


def test_simulated_time_runs_on_without_a_gap_however_late(make_run):
    run = make_run(rate=10.0, stall_at=5, stall_s=0.3)
    before = run.clock.time_ns()
    run.until(250)
    run.until(400)
    assert len(run.cycles) >= 4
    stamps = np.array([block.stamp_ns for block in run.blocks])
    indices = np.array([block.first_index for block in run.blocks])
    np.testing.assert_array_equal(stamps - stamps[0], 100_000 * (indices - indices[0]))
    assert run.cycles[0].start_ns == before


def test_stopped_runner_starts_again_with_a_new_cycle_and_running_indices(make_run):
    run = make_run()
    run.until(5)
    kept = len(run.blocks)
    assert run.runner.activity == "idle"
    run.until(kept + 5)
    assert [cycle.number for cycle in run.cycles] == [0, 1]
    # The block that was being waited for when it stopped is not told: a gap, as it was one.
    gap = run.blocks[kept].first_index - run.blocks[kept - 1].first_index
    assert gap in (100, 200)
    # It starts where the telemetry of before ended: after the block that was left out.
    np.testing.assert_allclose(run.lateness_s()[kept:], -0.01, atol=1e-8)


def test_failure_is_told(make_run):
    run = make_run()

    def fail(*_: object) -> RunningCycle:
        raise RuntimeError("no bench")

    run.bench.begin_cycle = fail  # pyright: ignore[reportAttributeAccessIssue]
    run.until(1)
    [failure] = run.failures
    assert failure.startswith("the simulation thread has ended: RuntimeError('no bench')")
    assert (run.runner.failure, run.runner.ends) == (failure, 1)
