"""The test bench: what it makes of a cycle, and when what is set takes effect."""

import math

import numpy as np
import pytest

from ema_core.commands import Command, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector, healthy_faults
from ema_core.telemetry import COLUMNS, Telemetry, join
from ema_sim.bench import ActuatorBench, BenchSettings, RunningCycle
from ema_sim.growth import Growth, grow

FAULTS = fault_vector({"friction": 0.25, "eccentricity": 0.1})
SHORT = Command("step", amplitude=1e-3, duration=2e-3, start_time=0.0)
# 1.1 s of approach and return about it.
SHORT_SAMPLES = build_cycle(SHORT, 1e-4).samples


def short_bench(**settings) -> ActuatorBench:
    bench = ActuatorBench(ActuatorDescription(), BenchSettings(**settings))
    bench.set_command(SHORT)
    return bench


def telemetry(cycle: RunningCycle) -> Telemetry:
    return join([block for block, _ in cycle.blocks])


def assert_same(one: Telemetry, other: Telemetry) -> None:
    np.testing.assert_array_equal(one.stamps_ns, other.stamps_ns)
    assert one.first_index == other.first_index
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(one, column), getattr(other, column))


@pytest.mark.slow
@pytest.mark.parametrize(("block_s", "n"), [(0.01, 100), (0.3, 3000), (1e-6, 1)])
def test_blocks_have_their_length_and_do_not_show(block_s, n):
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


def test_what_is_set_holds_from_the_next_cycle_on():
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
    # The new friction is in the samples, and not only in what is told of them.
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
        ({"friction": math.nan}, {}, 1.0, "friction = nan"),
        ({}, {"rust": Growth()}, 1.0, "unknown fault 'rust'"),
        ({}, {}, math.nan, "hours_per_cycle = nan h"),
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


@pytest.mark.parametrize(
    ("name", "value", "unit"),
    [
        ("block_s", 0.0, "s"),
        ("pause_s", -1.0, "s"),
        ("hours_per_cycle", math.inf, "h"),
        ("load", math.nan, "N.m"),
        ("noise_gain", -1.0, "-"),
        ("current_noise", -1.0, "A"),
        ("seed", -1, "-"),
    ],
)
def test_impossible_settings_are_refused(name, value, unit):
    with pytest.raises(ValueError, match=rf"{name} = .*{unit}"):
        BenchSettings(**{name: value})


def test_causes_hold_from_the_next_cycle_on_and_their_times_begin_with_it():
    bench = short_bench()
    first = bench.begin_cycle()
    bench.set_causes(["position_offset=0.01@0.002"])
    assert_same(telemetry(first), telemetry(short_bench().begin_cycle()))
    second = telemetry(bench.begin_cycle()).position
    # Without the offset the user shaft rests in its play, of 1e-5 rad.
    np.testing.assert_allclose(second[:20], 0.0, rtol=0, atol=2e-5)
    np.testing.assert_allclose(second[20:30], 0.01, rtol=0, atol=2e-5)
    bench.set_causes({})
    np.testing.assert_allclose(telemetry(bench.begin_cycle()).position[:30], 0.0, atol=2e-5)


def test_impossible_causes_are_refused_and_change_nothing():
    bench = ActuatorBench(ActuatorDescription(), causes={"jam": 1.0})
    for causes in (["jamm=1"], ["load_torque=99"], {"load_torque": math.nan}):
        with pytest.raises(ValueError, match=r"jamm|load_torque"):
            bench.set_causes(causes)
    assert list(bench.causes) == ["jam"]
    with pytest.raises(ValueError, match="did you mean 'jam'"):
        ActuatorBench(ActuatorDescription(), causes={"jamm": 1.0})
