# SPDX-License-Identifier: Apache-2.0
"""The test bench: the telemetry of a cycle, and cycles synchronised with the wall clock."""

import threading
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from ema_core import steady_thread
from ema_core.commands import Command, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector, healthy_faults
from ema_core.telemetry import Telemetry, join
from ema_sim import runner
from ema_sim.bench import ActuatorBench, BenchSettings, MeasuredBlock, RunningCycle
from ema_sim.growth import Growth, grow
from ema_sim.runner import TOLERANCE_S, BenchRunner, Pacer

from ..waiting import SimulatedTime
from .trajectories import assert_same

FAULTS = fault_vector({"friction": 0.25, "eccentricity": 0.1})
SHORT = Command("step", amplitude=1e-3, duration=2e-3, start_time=0.0)
# Approach and return take 1.1 s in addition.
SHORT_SAMPLES = build_cycle(SHORT, 1e-4).samples


def short_bench(**settings) -> ActuatorBench:
    bench = ActuatorBench(ActuatorDescription(), BenchSettings(**settings))
    bench.set_command(SHORT)
    return bench


def telemetry(cycle: RunningCycle) -> Telemetry:
    return join([block for block, _ in cycle.blocks])


@pytest.mark.slow
@pytest.mark.parametrize(("block_s", "n"), [(0.01, 100), (0.3, 3000), (1e-6, 1)])
def test_telemetry_does_not_depend_on_the_length_of_blocks(block_s, n):
    cycle = short_bench(block_s=block_s, current_noise=0.1).begin_cycle()
    blocks = [block for block, _ in cycle.blocks]
    assert {len(block) for block in blocks[:-1]} == {n}
    assert 0 < len(blocks[-1]) <= n
    whole = telemetry(short_bench(block_s=1.0, current_noise=0.1).begin_cycle())
    assert_same(join(blocks), whole)


def test_cycles_follow_each_other_unless_a_start_is_given():
    bench = short_bench()
    n, period_ns = len(SHORT_SAMPLES), 100_000
    first = bench.begin_cycle(7_000_000_000)
    assert telemetry(first).stamp_ns == 7_000_000_000 + period_ns
    assert bench.end_ns == 7_000_000_000 + n * period_ns
    second = bench.begin_cycle()
    assert second.start_ns == 7_000_000_000 + n * period_ns
    assert telemetry(second).stamp_ns == second.start_ns + period_ns
    third = bench.begin_cycle(9_999_999_999)
    assert third.start_ns == 9_999_999_999
    block = telemetry(third)
    assert (block.stamp_ns, block.first_index) == (9_999_999_999 + period_ns, 2 * n + 1)


def test_changed_settings_apply_from_the_next_cycle_on():
    bench, undisturbed = short_bench(), short_bench()
    cycle, expected = bench.begin_cycle(), undisturbed.begin_cycle()
    longer = Command("step", amplitude=2e-3, duration=4e-3)
    blocks = []
    for i, (block, _) in enumerate(cycle.blocks):
        blocks.append(block)
        if i == 3:
            bench.set_faults(FAULTS)
            bench.set_command(longer)
    np.testing.assert_array_equal(cycle.faults, healthy_faults())
    assert_same(join(blocks), telemetry(expected))

    following = bench.begin_cycle()
    np.testing.assert_array_equal(following.faults, FAULTS)
    block = telemetry(following)
    np.testing.assert_array_equal(block.command, build_cycle(longer, 1e-4).samples)
    # The new friction affects the samples, not only the reported faults.
    healthy = undisturbed
    healthy.set_command(longer)
    assert np.abs(block.current - telemetry(healthy.begin_cycle()).current).max() > 0.5


def test_faults_grow_from_cycle_to_cycle():
    growths = {"backlash": Growth("archard", 3e-4, 3.0), "friction": Growth("linear", 1e-3, 0, 0.3)}
    bench = short_bench(seed=5)
    bench.set_faults(FAULTS, growths, hours_per_cycle=20.0)
    generator = np.random.default_rng(5).spawn(3)[2]
    expected = FAULTS
    for number in range(4):
        np.testing.assert_array_equal(bench.begin_cycle().faults, expected)
        expected = grow(expected, growths, 20.0 * number, 20.0, generator)
    assert expected[1] > 0.02


@pytest.mark.parametrize(
    ("faults", "growths", "hours", "message"),
    [
        ({"friction": 1.5}, {}, 1.0, r"friction = 1.5 is outside \[0, 1\]"),
        ({}, {"rust": Growth()}, 1.0, "unknown fault 'rust'"),
        ({}, {}, -1.0, "hours_per_cycle = -1 h"),
    ],
)
def test_impossible_faults_are_refused_and_change_nothing(faults, growths, hours, message):
    bench = short_bench()
    bench.set_faults(FAULTS, {"backlash": Growth("linear", 1e-3)}, 10.0)
    with pytest.raises(ValueError, match=message):
        bench.set_faults(faults, growths, hours)
    np.testing.assert_array_equal(bench.begin_cycle().faults, FAULTS)
    assert bench.begin_cycle().faults[1] == pytest.approx(0.01)


def test_causes_apply_from_the_next_cycle_on_and_their_times_begin_with_it():
    bench = short_bench()
    first = bench.begin_cycle()
    bench.set_causes(["position_offset=0.01@0.002"])
    assert_same(telemetry(first), telemetry(short_bench().begin_cycle()))
    second = telemetry(bench.begin_cycle()).position
    # Without the offset, the user shaft rests within its play of 1e-5 rad.
    np.testing.assert_allclose(second[:20], 0.0, rtol=0, atol=2e-5)
    np.testing.assert_allclose(second[20:30], 0.01, rtol=0, atol=2e-5)
    bench.set_causes({})
    np.testing.assert_allclose(telemetry(bench.begin_cycle()).position[:30], 0.0, atol=2e-5)


@pytest.mark.parametrize("rate", [0.01, 1.0, 4.0])
def test_blocks_are_due_at_the_end_of_their_last_sample(rate):
    clock = SimulatedTime()
    pacer = Pacer(rate, clock.monotonic)
    for i in range(1, 301):
        clock.now_s += 0.3 * 0.01 / rate  # Computing takes part of the time.
        assert pacer.wait(0.01, clock)
        assert clock.now_s == pytest.approx(100.0 + i * 0.01 / rate, abs=1e-9)
    pace = pacer.pace()
    assert not pace.behind
    assert pace.achieved_rate == pytest.approx(rate, rel=1e-9)
    assert pace.busy_share == pytest.approx(0.3, rel=1e-6)


def test_short_delay_is_caught_up():
    clock = SimulatedTime()
    pacer = Pacer(1.0, clock.monotonic)
    clock.now_s += 0.8 * TOLERANCE_S
    for _ in range(20):
        pacer.wait(0.01, clock)
    assert clock.now_s == pytest.approx(100.2)
    assert not pacer.pace().behind


def test_after_a_long_delay_the_schedule_is_shifted():
    clock = SimulatedTime()
    pacer = Pacer(1.0, clock.monotonic)
    clock.now_s += 5.0
    arrivals = []
    for _ in range(4):
        pacer.wait(0.01, clock)
        arrivals.append(clock.now_s)
    np.testing.assert_allclose(np.diff(arrivals), 0.01, rtol=0, atol=1e-9)
    assert pacer.pace().behind
    assert pacer.pace().lag_s == pytest.approx(4.99)


class Run:
    """A runner in simulated time that stores its blocks with their arrival times."""

    def __init__(
        self, clock: SimulatedTime, rate: float = 1.0, stall_at: int = -1, stall_s: float = 0.0
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

    def _keep(self, measured: MeasuredBlock) -> None:
        self.arrivals_ns.append(self.clock.time_ns())
        if len(self.blocks) == self._stall[0]:
            self.clock.now_s += self._stall[1]
        self.blocks.append(measured.telemetry)
        if len(self.blocks) == self._last:
            self.runner.thread.ending.set()

    def _fail(self, failure: str, trace: str) -> None:
        self.failures.append(failure)
        self.runner.thread.ending.set()

    def until(self, blocks: int) -> None:
        """Run until a number of blocks has arrived, or until the runner fails."""
        self._last = blocks
        self.runner.start()
        self.runner.thread._thread.join()
        self.runner.stop()

    def lateness_s(self) -> np.ndarray:
        ends = np.array([block.stamps_ns[-1] for block in self.blocks])
        return 1e-9 * (np.array(self.arrivals_ns) - ends)


@pytest.fixture
def make_run(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Run]:
    """Return a function that makes a runner, whose clocks advance only while it waits."""
    clock = SimulatedTime()

    def begin_anew() -> SimulatedTime:
        """Reset the event as for a new start."""
        clock.clear()
        return clock

    threads = {"Thread": threading.Thread, "current_thread": threading.current_thread}
    events = SimpleNamespace(Event=begin_anew, **threads)
    monkeypatch.setattr(steady_thread, "threading", events)
    monkeypatch.setattr(runner, "time", clock)
    monkeypatch.setattr(runner, "Pacer", lambda rate: Pacer(rate, clock.monotonic))
    return partial(Run, clock)


@pytest.fixture(scope="module", autouse=True)
def _kernels():
    ActuatorBench(ActuatorDescription()).compile_kernels()


def blocks_per_cycle(run: Run) -> int:
    return -(-run.cycles[0].samples // 100)


def test_stamps_follow_the_wall_clock_across_cycles(make_run):
    run = make_run()
    run.until(150)
    late = run.lateness_s()
    # Adding up times of 100 s has rounding errors of 1e-14 s each; stamps are whole nanoseconds.
    np.testing.assert_allclose(late, 0.0, atol=1e-8)
    assert len(run.cycles) == 2
    assert run.cycles[1].start_ns == run.cycles[0].start_ns + 100_000 * run.cycles[0].samples
    steps = [b.stamp_ns - a.stamps_ns[-1] for a, b in zip(run.blocks, run.blocks[1:], strict=False)]
    assert set(steps) == {100_000}


def test_after_a_stall_there_is_no_burst_and_the_next_cycle_follows_the_wall_clock(make_run):
    run = make_run(stall_at=20, stall_s=0.4)
    run.until(170)
    gaps = 1e-9 * np.diff(run.arrivals_ns)
    assert gaps[20] == pytest.approx(0.4, abs=1e-6)
    # Twenty blocks take their usual time; in a burst, they would arrive together.
    assert gaps[21:41].sum() == pytest.approx(0.2, abs=1e-6)
    per_cycle = blocks_per_cycle(run)
    late = run.lateness_s()
    assert late[25:per_cycle].min() > 0.3
    np.testing.assert_allclose(late[per_cycle:], 0.0, atol=1e-8)
    indices = [block.first_index for block in run.blocks]
    ends = [block.first_index + len(block) for block in run.blocks]
    assert indices[1:] == ends[:-1]


def test_simulated_time_has_no_gap_after_a_delay(make_run):
    run = make_run(rate=10.0, stall_at=5, stall_s=0.3)
    before = run.clock.time_ns()
    run.until(250)
    run.until(400)
    assert len(run.cycles) >= 4
    stamps = np.array([block.stamp_ns for block in run.blocks])
    indices = np.array([block.first_index for block in run.blocks])
    np.testing.assert_array_equal(stamps - stamps[0], 100_000 * (indices - indices[0]))
    assert run.cycles[0].start_ns == before


def test_stopped_runner_starts_again_with_a_new_cycle_and_continuing_indices(make_run):
    run = make_run()
    run.until(5)
    kept = len(run.blocks)
    assert run.runner.activity == "idle"
    run.until(kept + 5)
    assert [cycle.number for cycle in run.cycles] == [0, 1]
    # The block that was due at the stop is not published, which leaves a gap.
    gap = run.blocks[kept].first_index - run.blocks[kept - 1].first_index
    assert gap in (100, 200)
    # The new cycle starts after the block that was left out.
    np.testing.assert_allclose(run.lateness_s()[kept:], -0.01, atol=1e-8)


def test_failure_is_reported(make_run):
    run = make_run()

    def fail(*_: object) -> RunningCycle:
        raise RuntimeError("no bench")

    run.bench.begin_cycle = fail  # pyright: ignore[reportAttributeAccessIssue]
    run.until(1)
    [failure] = run.failures
    assert failure.startswith("the simulation thread has ended: RuntimeError('no bench')")
    assert (run.runner.thread.failure, run.runner.thread.ends) == (failure, 1)
