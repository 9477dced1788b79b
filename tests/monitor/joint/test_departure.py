# SPDX-License-Identifier: Apache-2.0
"""A test departs only if no healthy test looks like it."""

import numpy as np
import pytest

from ema_monitor.joint.departure import NONE_OF_THESE, DatedFigures, JudgedFigure, departure_of
from ema_monitor.joint.states import Example, examples_by_state, probabilities
from ema_monitor.reason_texts import text_of

FIGURES = {
    "level": JudgedFigure(0.01, is_logarithm=False),
    **{f"scatter{number}": JudgedFigure(0.024) for number in range(10)},
}


def drawn(rng, count, *, sigma=0.02, shift=0.0, day=0):
    """Return healthy tests: a level of 1 A and logarithms of ten scatters."""
    tests = []
    for _ in range(count):
        values = sigma * rng.standard_normal(len(FIGURES))
        values[0] += 1.0 + shift
        tests.append(DatedFigures(day, dict(zip(FIGURES, values, strict=True))))
    return tests


@pytest.mark.parametrize(
    ("count", "sigma"), [(3, 0.002), (3, 0.07), (5, 0.02), (5, 0.07), (20, 0.07), (20, 0.2)]
)
@pytest.mark.slow
@pytest.mark.parametrize("later_day", [0, 9])
def test_healthy_tests_depart_no_more_often_than_stated(count, sigma, later_day):
    rng = np.random.default_rng(count)
    alarms = 0
    for _ in range(200):
        *healthy, later = drawn(rng, count + 1, sigma=sigma)
        alarms += departure_of(later._replace(day=later_day), healthy, FIGURES).is_significant
    # 200 tests at 0.1 %: 0.2 departures are expected; more than 3 occur once in 10,000 runs. Three
    # tests cannot rule out the prior of a level, a scatter of 0.6 %, a tenth of the actual one.
    assert alarms <= (7 if (count, sigma) == (3, 0.07) else 3)


def test_departure_names_the_changed_figures_with_their_size():
    rng = np.random.default_rng(0)
    healthy = drawn(rng, 8, sigma=0.005)
    (later,) = drawn(rng, 1, sigma=0.005, shift=0.12)
    departure = departure_of(later, healthy, FIGURES)
    assert departure.is_significant
    assert [change.name for change in departure.changes] == ["level"]
    assert "level is 1.12 A, healthy 1 A (+11 %)" in text_of(departure.reason)
    louder = later._replace(values={**later.values, "level": 1.0, "scatter3": np.log(1.5)})
    departure = departure_of(louder, healthy, FIGURES)
    assert "scatter3 is 1.5 times the healthy value" in text_of(departure.reason)


def test_equal_healthy_tests_do_not_imply_zero_scatter():
    tests = drawn(np.random.default_rng(0), 8, sigma=0.0)
    for shift, expected in ((0.003, False), (0.06, True)):
        (later,) = drawn(np.random.default_rng(0), 1, sigma=0.0, shift=shift)
        assert departure_of(later, tests, FIGURES).is_significant == expected


def test_drift_between_days_is_assumed_at_first_and_learned_from_days():
    rng = np.random.default_rng(1)
    one_day = drawn(rng, 6, sigma=0.002)
    (same_day,) = drawn(rng, 1, sigma=0.002, shift=0.05)
    assert departure_of(same_day, one_day, FIGURES).is_significant
    (later,) = drawn(rng, 1, sigma=0.002, shift=0.05, day=9)
    departure = departure_of(later, one_day, FIGURES)
    assert not departure.is_significant
    assert departure.would_depart is not None
    words = "level differs by +5 %; on a day without healthy tests, changes above"
    assert words in text_of(departure.would_depart)
    days = [
        test
        for day, shift in enumerate((0.0, 0.05, -0.05, 0.02))
        for test in drawn(rng, 3, sigma=0.002, shift=shift, day=day)
    ]
    departure = departure_of(later, days, FIGURES)
    assert not departure.is_significant
    (far,) = drawn(rng, 1, sigma=0.002, shift=0.8, day=9)
    assert departure_of(far, days, FIGURES).is_significant
    # Days that agree lower the detectable change on a further day.
    steady = [test for day in range(6) for test in drawn(rng, 2, sigma=0.002, day=day)]
    assert departure_of(later, steady, FIGURES).is_significant


def test_smallest_change_is_detected_in_90_percent_of_tests():
    rng = np.random.default_rng(2)
    figure = {"level": FIGURES["level"]}
    detected = 0
    for _ in range(200):
        *healthy, later = drawn(rng, 13, sigma=0.005)
        [change] = departure_of(later._replace(values={"level": 2.0}), healthy, figure).changes
        moved = later.values["level"] + change.smallest_change
        detected += departure_of(
            later._replace(values={"level": moved}), healthy, figure
        ).is_significant
    # Binomial with 200 at 90 %: a standard deviation of 2 %.
    assert detected / 200 >= 0.84


def test_too_few_tests_give_no_judgement():
    healthy = drawn(np.random.default_rng(0), 2)
    with pytest.raises(ValueError, match="2 healthy tests: expected 3"):
        departure_of(healthy[0], healthy, FIGURES)
    three = drawn(np.random.default_rng(0), 3)
    with pytest.raises(ValueError, match="no figure in common"):
        departure_of(DatedFigures(0, {"other": 1.0}), three, FIGURES)


PLANE = {name: JudgedFigure(0.03) for name in "ab"}


def at(x, y):
    return DatedFigures(0, {"a": x, "b": y})


def clusters(rng, centres, count=6, rows=3):
    examples = []
    for state, (x, y) in centres.items():
        for _ in range(count):
            stretches = [
                {"a": x + 0.1 * rng.standard_normal(), "b": y + 0.1 * rng.standard_normal()}
                for _ in range(rows)
            ]
            mean = {name: float(np.mean([stretch[name] for stretch in stretches])) for name in "ab"}
            examples.append(Example(state, DatedFigures(0, mean), stretches))
    return examples


def test_states_are_named_and_unknown_states_are_not():
    rng = np.random.default_rng(0)
    centres = {"healthy": (0.0, 0.0), "dry 1": (1.0, 0.0), "dry 2": (2.0, 0.0), "play": (0.0, 2.0)}
    examples = examples_by_state(clusters(rng, centres))
    for state, centre in centres.items():
        probability_of = probabilities(examples, at(*centre), PLANE)
        assert next(iter(probability_of)) == state
        assert sum(probability_of.values()) == pytest.approx(1.0)
    assert next(iter(probabilities(examples, at(30.0, 30.0), PLANE))) == NONE_OF_THESE
    # A missing figure does not count.
    probability_of = probabilities(examples, DatedFigures(0, {"b": 2.0}), PLANE)
    assert next(iter(probability_of)) == "play"
    assert probabilities(examples, DatedFigures(0, {}), PLANE) == {}
    assert not examples_by_state(clusters(rng, {"healthy": (0.0, 0.0)})[:2])
