"""What growth does not explain: outliers, repairs, steps; and none of them when all is well."""

import numpy as np
import pytest

from ema_monitor.prognosis.growth.tracker import Tracker
from ema_sim.growth import Growth

from .tracked_lives import SIGMA, feed, observed, of

GROWTH = {"friction": Growth("exponential", 2e-3, 0.05, 0.3)}


def grown(until: float = 600.0, seed: int = 0) -> tuple[Tracker, np.ndarray, np.random.Generator]:
    tracker, rng = Tracker(), np.random.default_rng(seed)
    events, faults = feed(tracker, GROWTH, until, rng)
    assert events == []
    return tracker, faults, rng


def test_outlier_is_reported_once_and_never_used():
    tracker, faults, rng = grown()
    twin, _, twin_rng = grown()
    wrong = faults.copy()
    wrong[0] += 0.2
    (event,) = tracker.update(observed(610.0, wrong, rng))
    twin_rng.standard_normal(8)
    assert (event.kind, event.component, event.hours) == ("outlier", "friction", 610.0)
    assert "friction" in event.text
    assert "held back" in event.text
    assert of(tracker, "friction").value == pytest.approx(faults[0], abs=0.01)
    assert tracker.update(observed(620.0, faults, rng)) == []
    twin.update(observed(620.0, faults, twin_rng))
    assert of(tracker, "friction").value == pytest.approx(of(twin, "friction").value, abs=1e-3)


def test_outlier_in_one_component_keeps_the_whole_test_back():
    tracker, faults, rng = grown()
    before = of(tracker, "backlash").tests
    wrong = faults.copy()
    wrong[[0, 1]] += [0.2, 0.01]
    tracker.update(observed(610.0, wrong, rng))
    assert of(tracker, "backlash").tests == before


def test_repair_restarts_the_level_and_reopens_the_growth():
    tracker, faults, rng = grown()
    assert tracker.predict().overall.known
    repaired = faults.copy()
    repaired[0] = 0.0
    assert [event.kind for event in tracker.update(observed(610.0, repaired, rng))] == ["outlier"]
    (event,) = tracker.update(observed(620.0, repaired, rng))
    assert (event.kind, event.component, event.hours) == ("repair", "friction", 610.0)
    item = of(tracker, "friction")
    assert item.value < 4 * SIGMA
    assert item.growing_probability == pytest.approx(0.5, abs=0.02)
    assert not tracker.predict().components["friction"].known


def test_step_raises_the_level_and_keeps_the_rate_but_less_surely():
    tracker, faults, rng = grown()
    before = of(tracker, "friction")
    stepped = faults.copy()
    stepped[0] += 0.1
    tracker.update(observed(610.0, stepped, rng))
    (event,) = tracker.update(observed(620.0, stepped, rng))
    assert (event.kind, event.component, event.hours) == ("step", "friction", 610.0)
    after = of(tracker, "friction")
    assert after.value == pytest.approx(stepped[0], abs=4 * SIGMA)
    # The exponential law itself goes (x + x_0) times faster at the higher level.
    assert before.trend < after.trend < 3.0 * before.trend
    assert after.trend_sigma > before.trend_sigma
    life = tracker.predict().components["friction"]
    assert life.known


def test_gain_that_comes_nearer_to_healthy_is_repaired_on_either_side():
    for gain in (0.35, 0.65):
        tracker, rng = Tracker(), np.random.default_rng(1)
        feed(tracker, {}, 200.0, rng, {"gain": gain})
        tracker.update(observed(210.0, {"gain": 0.5}, rng))
        (event,) = tracker.update(observed(220.0, {"gain": 0.5}, rng))
        assert (event.kind, event.component) == ("repair", "gain")


def test_jump_of_the_size_of_occasional_errors_must_show_three_times():
    tracker, rng = Tracker(), np.random.default_rng(2)
    feed(tracker, {}, 400.0, rng, {"backlash": 0.1})
    kinds = []
    for hours in (410.0, 420.0, 430.0):
        kinds += [e.kind for e in tracker.update(observed(hours, {"backlash": 0.138}, None))]
    assert kinds == ["step"]
    assert of(tracker, "backlash").value == pytest.approx(0.138, abs=SIGMA)


def test_two_wrong_tests_in_a_row_do_not_pass_for_a_change():
    tracker, rng = Tracker(), np.random.default_rng(3)
    faults = {"friction": 0.1, "backlash": 0.1, "eccentricity": 0.1}
    feed(tracker, {}, 300.0, rng, faults)
    first = {"friction": 0.2, "backlash": 0.2, "eccentricity": 0.3}
    other = {"friction": 0.2, "backlash": 0.1, "eccentricity": 0.1}
    events = tracker.update(observed(310.0, first)) + tracker.update(observed(320.0, other))
    assert {event.kind for event in events} == {"outlier"}
    assert tracker.update(observed(330.0, faults)) == []
    assert of(tracker, "friction").value == pytest.approx(0.1, abs=SIGMA)


def test_what_stays_off_is_used_in_the_end():
    tracker, rng = Tracker(), np.random.default_rng(4)
    feed(tracker, {}, 300.0, rng, {"friction": 0.1})
    for hours, value in ((310.0, 0.3), (320.0, 0.5), (330.0, 0.3), (340.0, 0.5), (350.0, 0.5)):
        tracker.update(observed(hours, {"friction": value}))
    assert of(tracker, "friction").value == pytest.approx(0.5, abs=2 * SIGMA)


def test_life_does_not_start_from_a_wrong_first_test():
    tracker, rng = Tracker(), np.random.default_rng(5)
    assert tracker.update(observed(10.0, {"friction": 0.4, "gain": 0.3})) == []
    kinds = {event.kind for event in tracker.update(observed(20.0, {}, rng))}
    assert kinds == {"outlier"}
    assert tracker.update(observed(30.0, {}, rng)) == []
    assert of(tracker, "friction").value == pytest.approx(0.0, abs=2 * SIGMA)
    assert of(tracker, "gain").value == pytest.approx(0.5, abs=2 * SIGMA)


@pytest.mark.slow
def test_healthy_and_constant_actuators_have_no_events_and_no_remaining_life():
    # 8 actuators of 7 components, 75 tests each; 13,000 such tests had none in a longer trial.
    for seed in range(8):
        tracker, rng = Tracker(), np.random.default_rng(seed)
        levels = {"friction": 0.2, "short_circuit_b": 0.05, "gain": 0.4} if seed % 2 else {}
        for i in range(75):
            assert tracker.update(observed(10.0 * i, levels, rng)) == []
            if i % 5 == 0:
                prognosis = tracker.predict()
                assert not prognosis.overall.known
                assert np.isnan(prognosis.overall.hours_50)
                assert prognosis.overall.reason
                assert np.all(np.isinf(prognosis.samples))
