# SPDX-License-Identifier: Apache-2.0
"""Commands as samples, and the test cycle around a command."""

import math

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP, Command, build_cycle
from ema_core.parameters import ActuatorParameters

H = 1e-4


def times(n: int, h: float = H) -> np.ndarray:
    return h * np.arange(1, n + 1)


def test_thesis_chirp():
    """A sin(2 pi (f0 t + (f1 - f0) t^2 / 2 T)) from 0 to 15 Hz in 0.5 s."""
    t = times(5000)
    # Phases reach 24 rad: rounding errors are multiplied by 5 mrad.
    np.testing.assert_allclose(
        THESIS_CHIRP.sample(H), 0.005 * np.sin(2 * np.pi * 15 * t**2), rtol=0, atol=1e-16
    )


@pytest.mark.parametrize("end", [0.1, -0.1])
def test_ramp_reaches_its_amplitude_at_its_rate_and_stays_there(end):
    c = Command("ramp", amplitude=end, rate=2.0, duration=0.1, start_time=0.02).sample(H)
    t = times(1000)
    expected = np.interp(t, [0.02, 0.07], [0.0, end])
    np.testing.assert_allclose(c, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("command", "printed"),
    [
        (Command(amplitude=5.0), "amplitude = 5 rad is beyond the end stop, theta_stop = 1.2 rad"),
        (Command(amplitude=5.0), "usually 0.001 to 0.1 rad: 0.08727 rad = 5 degrees was probably"),
        (Command("step", amplitude=-1.3), "amplitude = 1.3 rad is beyond"),
        (Command("custom", samples=[0.0, -2.0]), "farthest sample = 2 rad is beyond the end stop"),
    ],
)
def test_command_beyond_the_end_stop_is_refused_with_the_probable_intention(command, printed):
    assert printed in command.travel_warning(ActuatorParameters())


def test_swing_begins_and_ends_at_rest_and_turns_at_its_amplitude():
    swing = Command(
        "swing", amplitude=0.004, duration=0.25, start_frequency=10.0, end_frequency=14.0
    ).sample(H)
    # 12 Hz on average: six half periods.
    turns = np.flatnonzero(np.diff(np.sign(np.diff(swing)))) + 1
    np.testing.assert_allclose(swing[turns], 0.004 * np.array([1, -1, 1, -1, 1]), rtol=1e-4)
    assert swing[-1] == pytest.approx(-0.004, rel=1e-9)
    # At its start and end, a sample moves much less than the fastest sample in between.
    steps = np.abs(np.diff(swing, prepend=0.0))
    assert max(steps[0], steps[-1]) < 0.02 * steps.max()
    # Neither position nor speed jumps.
    assert np.abs(np.diff(steps)).max() < 0.02 * steps.max()


class TestMoves:
    def test_stay_within_their_reach_and_speed(self):
        c = Command("moves", amplitude=0.008, rate=0.2, duration=20.0, seed=1).sample(H)
        assert np.abs(c).max() <= 0.008
        # With uniformly drawn angles, some of twenty come near either end.
        assert c.max() > 0.004
        assert c.min() < -0.004
        # The fastest moves are shorter than the shortest allowed time, and are slowed down
        # accordingly.
        assert np.abs(np.diff(c)).max() / H <= 0.2 * (1 + 1e-6)

    def test_begin_at_zero_move_smoothly_and_dwell(self):
        c = np.concatenate([[0.0], Command("moves", duration=10.0, seed=2).sample(H)])
        speed = np.diff(c) / H
        # Half a cosine of at least 50 ms over up to twice the amplitude: the speed does not jump.
        assert np.abs(np.diff(speed)).max() <= math.pi**2 / 2 * 0.01 / 0.05**2 * H * 1.01
        assert np.mean(speed == 0.0) > 0.05

    def test_are_reproducible_by_their_seed(self):
        first, same, different = (Command("moves", seed=seed).sample(H) for seed in (3, 3, 4))
        np.testing.assert_array_equal(first, same)
        assert np.any(first != different)

    def test_need_a_maximum_speed(self):
        with pytest.raises(ValueError, match=r"rate = 0 rad/s: expected a positive speed"):
            Command("moves", rate=0.0)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -2e4, 2e4])
@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("amplitude", "rad"),
        ("duration", "s"),
        ("start_time", "s"),
        ("rate", "rad/s"),
        ("start_frequency", "Hz"),
        ("end_frequency", "Hz"),
        ("final_fraction", ""),
    ],
)
def test_impossible_number_is_refused_by_name_value_unit_and_range(name, unit, value):
    with pytest.raises(ValueError, match=rf"{name} = {value:g}\b.* \[.*\] {unit}"):
        Command(**{name: value})


@pytest.mark.parametrize(
    ("samples", "match"),
    [
        ([], "one-dimensional array"),
        ([[0.0, 1.0]], "one-dimensional array"),
        (0.5, "one-dimensional array"),
        ([0.0, math.nan], "sample 1 is nan"),
        ([math.inf], "sample 0 is inf"),
    ],
)
def test_bad_custom_samples_are_refused(samples, match):
    with pytest.raises(ValueError, match=match):
        Command("custom", samples=samples)


@pytest.mark.parametrize("h", [1e-4, 1e-3])
@pytest.mark.parametrize(
    "command",
    [THESIS_CHIRP, Command(final_fraction=0.3), Command("sine", start_frequency=4.0)],
    ids=["chirp", "falling", "sine"],
)
class TestCycle:
    def test_holds_the_command_between_start_and_stop(self, command, h):
        cycle = build_cycle(command, h)
        np.testing.assert_array_equal(
            cycle.samples[cycle.start + 1 : cycle.stop], command.sample(h)
        )
        # The actuator is still at rest at the start; the last sample precedes any motion.
        assert cycle.samples[cycle.start] == 0.0

    def test_rests_before_and_after(self, command, h):
        cycle = build_cycle(command, h)
        tenth = round(0.1 / h)
        assert (cycle.samples[:tenth] == 0.0).all()
        assert (cycle.samples[cycle.start - tenth + 1 : cycle.start + 1] == 0.0).all()
        assert (cycle.samples[-tenth:] == 0.0).all()

    def test_approaches_slowly_from_below(self, command, h):
        """The approach starts from -2 mrad for any h, so that the gear ends on one flank."""
        cycle = build_cycle(command, h)
        before = cycle.samples[: cycle.start + 1]
        lowest = np.flatnonzero(before <= before.min() + 1e-12)
        assert before.min() == pytest.approx(-2e-3, rel=1e-12)
        # The command waits at the lower position before it turns.
        assert lowest.size * h >= 0.1
        rise = np.diff(before[lowest[-1] :])
        assert (rise >= 0.0).all()
        assert rise.max() / h == pytest.approx(2e-3 / 0.4, rel=1e-9)
        assert (before <= 0.0).all()

    def test_returns_smoothly_in_three_tenths_of_a_second(self, command, h):
        cycle = build_cycle(command, h)
        end = command.sample(h)[-1]
        back = cycle.samples[cycle.stop :]
        n = round(0.3 / h)
        assert (back[n - 1 :] == 0.0).all()
        assert back.size == n + round(0.1 / h)
        # Half a cosine: the speed does not jump at either end, and is greatest half way.
        speed = np.diff(np.concatenate([[end], back])) / h
        assert np.abs(speed).max() <= math.pi / 2 * abs(end) / 0.3 * (1 + 1e-9)
        assert np.abs(np.diff(speed)).max() <= math.pi**2 / 2 * abs(end) / 0.3**2 * h * 1.01

    def test_is_continuous(self, command, h):
        """No step between samples exceeds the step of the fastest part."""
        samples = np.concatenate([[0.0], build_cycle(command, h).samples])
        fastest = max(
            2 * math.pi * 15 * 0.005,  # end of the chirp
            math.pi / 2 * 2e-3 / 0.1,  # retreat
            math.pi / 2 * 5e-3 / 0.3,  # return
        )
        assert np.abs(np.diff(samples)).max() <= fastest * h


def test_window_opens_at_the_start_of_the_command():
    """The command starts after a second of preparation and rest, and lasts half a second."""
    cycle = build_cycle(THESIS_CHIRP, H)
    assert cycle.start == 7999
    assert cycle.stop - cycle.start - 1 == 5000
    assert cycle.samples.size == 8000 + 5000 + 3000 + 1000
