"""A test departs where no healthy one looks like it, and not before."""

import numpy as np
import pytest

from ema_monitor.normal.features import LEVEL, RATIO, Feature
from ema_monitor.normal.normal import NONE_OF_THESE, HealthyTest, Normal
from ema_monitor.normal.states import LabelledTest, States, known_states

DAY_NS = 86_400_000_000_000
KNOWN = {
    "level": Feature(LEVEL, "the level"),
    **{f"scatter{number}": Feature(RATIO, f"scatter {number}") for number in range(10)},
}


def drawn(rng, count, *, sigma=0.02, shift=0.0, day=0):
    """Healthy tests: a level of 1 and logarithms of ten scatters."""
    tests = []
    for _ in range(count):
        values = sigma * rng.standard_normal(len(KNOWN))
        values[0] += 1.0 + shift
        tests.append(HealthyTest(day * DAY_NS, dict(zip(KNOWN, values, strict=True))))
    return tests


@pytest.mark.parametrize(
    ("count", "sigma"), [(3, 0.002), (3, 0.07), (5, 0.02), (5, 0.07), (20, 0.07), (20, 0.2)]
)
def test_healthy_tests_depart_no_more_often_than_said(count, sigma):
    rng = np.random.default_rng(count)
    alarms = 0
    for _ in range(200):
        *known, later = drawn(rng, count + 1, sigma=sigma)
        alarms += Normal(known, KNOWN).departure(later).is_significant
    # 200 tests at 1 %: 2 are expected, more than 7 come once in 1,000 runs.
    assert alarms <= 7


def test_departure_names_what_changed_and_by_how_much():
    rng = np.random.default_rng(0)
    normal = Normal(drawn(rng, 8, sigma=0.005), KNOWN)
    (later,) = drawn(rng, 1, sigma=0.005, shift=0.12)
    found = normal.departure(later)
    assert found.is_significant
    assert [one.name for one in found.changes] == ["level"]
    assert "the level is 1.12 instead of 1 (+11%)" in str(found)


def test_smallest_departure_is_bounded_by_the_floor():
    tests = drawn(np.random.default_rng(0), 8, sigma=0.0)
    for shift, expected in ((0.02, False), (0.06, True)):
        (later,) = drawn(np.random.default_rng(0), 1, sigma=0.0, shift=shift)
        assert Normal(tests, KNOWN).departure(later).is_significant == expected


def test_drift_between_days_is_usual_once_it_was_seen_and_assumed_before():
    rng = np.random.default_rng(1)
    one_day = drawn(rng, 6, sigma=0.002)
    (same_day,) = drawn(rng, 1, sigma=0.002, shift=0.08)
    assert Normal(one_day, KNOWN).departure(same_day).is_significant
    (later,) = drawn(rng, 1, sigma=0.002, shift=0.08, day=9)
    found = Normal(one_day, KNOWN).departure(later)
    assert not found.is_significant
    days = [
        test
        for day, shift in enumerate((0.0, 0.05, -0.05, 0.02))
        for test in drawn(rng, 3, sigma=0.002, shift=shift, day=day)
    ]
    found = Normal(days, KNOWN).departure(later)
    assert not found.is_significant
    (far,) = drawn(rng, 1, sigma=0.002, shift=0.8, day=9)
    assert Normal(days, KNOWN).departure(far).is_significant


def test_too_few_tests_say_nothing():
    with pytest.raises(ValueError, match="2 healthy tests: expected 3"):
        Normal(drawn(np.random.default_rng(0), 2), KNOWN)


PLANE = {name: Feature(RATIO, name) for name in "ab"}


def at(x, y):
    return HealthyTest(0, {"a": x, "b": y})


def clusters(rng, centres, count=6, rows=3):
    found = []
    for state, (x, y) in centres.items():
        for _ in range(count):
            parts = [
                {"a": x + 0.1 * rng.standard_normal(), "b": y + 0.1 * rng.standard_normal()}
                for _ in range(rows)
            ]
            mean = {name: float(np.mean([part[name] for part in parts])) for name in "ab"}
            found.append(LabelledTest(state, HealthyTest(0, mean), parts))
    return found


def test_states_are_named_and_what_is_none_of_them():
    rng = np.random.default_rng(0)
    centres = {"healthy": (0.0, 0.0), "dry 1": (1.0, 0.0), "dry 2": (2.0, 0.0), "play": (0.0, 2.0)}
    states = States(known_states(clusters(rng, centres)), PLANE)
    for state, centre in centres.items():
        found = states.probabilities(at(*centre))
        assert next(iter(found)) == state
        assert sum(found.values()) == pytest.approx(1.0)
    assert next(iter(states.probabilities(at(30.0, 30.0)))) == NONE_OF_THESE
    with pytest.raises(ValueError, match="lacks b"):
        states.probabilities(HealthyTest(0, {"a": 1.0}))
    assert not known_states(clusters(rng, {"healthy": (0.0, 0.0)})[:2])
