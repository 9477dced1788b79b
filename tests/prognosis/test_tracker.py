# SPDX-License-Identifier: Apache-2.0
"""The tracker: measurements, level, rate, law, onset, outliers, repairs and steps."""

import math
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, FaultVector, healthy_faults
from ema_monitor.prognosis.event_texts import text_of
from ema_monitor.prognosis.events import ValueUnexpected
from ema_monitor.prognosis.growth.filters import near_healthy_update
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import KnownLaw, TrackerSettings
from ema_sim.growth import Growth

from .made_tests import PHASE, made_test
from .tracked_lives import SIGMA, feed, growing, laws_of, observed, of

IS_FRICTION = np.array([name == "friction" for name in FAULT_NAMES])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "growth", "until"),
    [
        ("archard", Growth("exponential", 3e-3, 0.02), 1100.0),  # the same curves
        ("self_heating", Growth("self_heating", 1.5e-4, 6.0), 1070.0),
        ("power", Growth("power", 1200.0, 2.0), 880.0),
        ("linear", Growth("linear", 4e-4), 1150.0),
    ],
)
def test_true_law_is_the_most_probable_late_in_life(law, growth, until):
    tracker = Tracker()
    feed(tracker, {"backlash": growth}, until, np.random.default_rng(3))
    laws = laws_of(tracker, "backlash")
    assert laws[law] == max(laws.values())
    assert laws["constant"] < 1e-3


def test_onset_of_growth_is_detected():
    tracker = Tracker()
    growth = {"short_circuit_a": Growth("self_heating", 3e-4, 6.0, onset=500.0)}
    rng = np.random.default_rng(4)
    feed(tracker, growth, 500.0, rng)
    assert growing(tracker, "short_circuit_a") < 0.5
    assert not tracker.predict().overall.known
    feed(tracker, growth, 700.0, rng, after=500.0)
    assert growing(tracker, "short_circuit_a") > 0.999
    assert tracker.predict().dominant_fault == "short_circuit_a"


def test_change_of_rate_is_learned_in_a_few_tests():
    tracker = Tracker()
    rng = np.random.default_rng(10)
    feed(tracker, {"backlash": Growth("linear", 2e-4, onset=1000.0)}, 1000.0, rng)
    for i in range(1, 9):
        tracker.update(observed(1000.0 + 10.0 * i, {"backlash": 0.015 * i}, rng))
    assert of(tracker, "backlash").trend == pytest.approx(1.5e-3, rel=0.3)


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("mean", [-0.004, 0.0, 0.004, 0.01])
def test_near_healthy_measurement_updates_by_bayes_rule(mean, two_sided):
    sd, sigma = 0.003, 0.002
    x = np.linspace(mean - 10 * sd, mean + 10 * sd, 40_001)
    below = np.array([0.5 * math.erfc((v - 2 * sigma) / sigma / math.sqrt(2)) for v in x])
    if two_sided:
        below -= np.array([0.5 * math.erfc((v + 2 * sigma) / sigma / math.sqrt(2)) for v in x])
    weight = np.exp(-0.5 * ((x - mean) / sd) ** 2) * below
    expected = np.average(x, weights=weight)
    spread = np.average((x - expected) ** 2, weights=weight)
    means, variances, log_likelihood = np.array([mean]), np.array([sd**2]), np.empty(1)
    near_healthy_update(
        means,
        variances,
        np.array([sigma**2]),
        np.array([2.0]),
        np.array([two_sided]),
        log_likelihood,
    )
    assert means[0] == pytest.approx(expected, abs=1e-8)
    assert variances[0] == pytest.approx(spread, rel=1e-4)
    total = weight.sum() * (x[1] - x[0]) / (sd * math.sqrt(2 * math.pi))
    assert log_likelihood[0] == pytest.approx(math.log(total), abs=1e-4)


def test_unobservable_component_stays_unknown_and_does_not_affect_the_others():
    complete, partial = Tracker(), Tracker()
    rng = np.random.default_rng(5)
    for i in range(30):
        seen = observed(10.0 * i, {"friction": 0.1 + 0.002 * i}, rng)
        complete.update(seen)
        hidden = observed(10.0 * i, seen.faults, unobservable=["gain"])
        partial.update(hidden)
    assert np.isnan(of(partial, "gain").value)
    assert np.isnan(of(partial, "gain").trend)
    assert of(partial, "gain").tests == 0
    assert partial.predict().components["gain"].reason == "fewer than two tests agree so far"
    # Their scores are equally unknown; NaN does not equal itself.
    assert repr(of(partial, "friction")) == repr(of(complete, "friction"))


def test_component_unobservable_for_a_while_becomes_less_certain():
    tracker = Tracker()
    feed(tracker, {"friction": Growth("linear", 1e-3)}, 200.0, np.random.default_rng(6))
    before = of(tracker, "friction")
    for hours in (210.0, 220.0, 230.0, 240.0):
        tracker.update(observed(hours, {"friction": 0.9}, unobservable=["friction"]))
    after = of(tracker, "friction")
    assert after.sigma > before.sigma
    assert after.value == pytest.approx(before.value + 0.04, abs=2.0 * after.sigma)
    # A rate may change while the component is unobservable, and some of the curves are steep.
    assert after.sigma < 0.05
    assert after.tests == before.tests


def test_component_set_to_healthy_is_not_mistaken_for_exactly_healthy():
    tracker = Tracker()
    for i in range(40):
        tracker.update(observed(10.0 * i, {"friction": 1.5 * SIGMA}))
    item = of(tracker, "friction")
    assert abs(item.value) < 2.5 * SIGMA
    assert item.sigma > 0.3 * SIGMA
    # A value just above the limit for setting to healthy is then no surprise.
    assert tracker.update(observed(400.0, {"friction": 2.5 * SIGMA})) == []


def test_gain_is_tracked_on_both_sides_of_healthy():
    for sign in (-1.0, 1.0):
        tracker = Tracker()
        growth = {"gain": Growth("linear", sign * 3e-4)}
        feed(tracker, growth, 500.0, np.random.default_rng(8))
        item = of(tracker, "gain")
        assert item.value == pytest.approx(0.5 + sign * 0.15, abs=2 * SIGMA)
        assert item.trend * sign > 2e-4
        truth = 0.1 / 3e-4
        assert tracker.predict().components["gain"].hours_50 == pytest.approx(truth, rel=0.3)


def test_restored_and_frozen_trackers_equal_their_originals():
    whole, rng = Tracker(), np.random.default_rng(9)
    faults = [{"friction": 0.1, "eccentricity": 4e-3 * i} for i in range(60)]
    tests = [observed(10.0 * i, item, rng) for i, item in enumerate(faults)]
    # A jump: the state is stored while a test is held back, and the next test confirms it.
    tests[39:] = [replace(item, faults=item.faults + 0.2 * IS_FRICTION) for item in tests[39:]]
    for test in tests[:40]:
        whole.update(test)
    again, frozen = Tracker(), whole.frozen()
    again.restore({name: np.array(item) for name, item in whole.state().items()})
    before = whole.predict().samples
    reported = [tracker.update(test) for test in tests[40:] for tracker in (whole, again)]
    assert reported[::2] == reported[1::2]
    assert [event.kind for events in reported[::2] for event in events] == ["step"]
    np.testing.assert_array_equal(whole.predict().samples, again.predict().samples)
    np.testing.assert_array_equal(frozen.predict().samples, before)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TrackerSettings(laws={"rust": KnownLaw()}), "unknown fault 'rust'"),
        (lambda: TrackerSettings(samples=1), "samples = 1 is outside"),
        (lambda: KnownLaw("constant"), "law = 'constant': expected one of"),
        (lambda: KnownLaw("power"), "shape = 0: the law power"),
        (lambda: KnownLaw("exponential"), "shape = 0: law exponential"),
    ],
)
def test_impossible_settings_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


GROWTH = {"friction": Growth("exponential", 2e-3, 0.05, 0.3)}


Grown = tuple[Tracker, np.ndarray, np.random.Generator]


@pytest.fixture(scope="module")
def once_grown() -> Grown:
    tracker, rng = Tracker(), np.random.default_rng(0)
    events, faults = feed(tracker, GROWTH, 600.0, rng)
    assert events == []
    return tracker, faults, rng


@pytest.fixture
def grown(once_grown: Grown) -> Grown:
    """Return an independent copy."""
    return deepcopy(once_grown)


def test_outlier_is_reported_once_and_never_used(grown):
    tracker, faults, rng = grown
    twin, _, twin_rng = deepcopy(grown)
    before = of(tracker, "backlash").tests
    wrong = faults.copy()
    wrong[[0, 1]] += [0.2, 0.01]
    (event,) = tracker.update(observed(610.0, wrong, rng))
    assert isinstance(event, ValueUnexpected)
    assert of(tracker, "backlash").tests == before, "the whole test is held back"
    twin_rng.standard_normal(8)
    assert (event.kind, event.component, event.hours) == ("outlier", "friction", 610.0)
    assert (event.value, event.expected) == pytest.approx((wrong[0], faults[0]), abs=0.01)
    assert text_of(event).startswith("friction ")
    assert "held back" in text_of(event)
    assert of(tracker, "friction").value == pytest.approx(faults[0], abs=0.01)
    assert tracker.update(observed(620.0, faults, rng)) == []
    twin.update(observed(620.0, faults, twin_rng))
    assert of(tracker, "friction").value == pytest.approx(of(twin, "friction").value, abs=1e-3)


def test_repair_resets_the_level_and_the_certainty_of_growth(grown):
    tracker, faults, rng = grown
    assert tracker.predict().overall.known
    repaired = faults.copy()
    repaired[0] = 0.0
    assert [event.kind for event in tracker.update(observed(610.0, repaired, rng))] == ["outlier"]
    (event,) = tracker.update(observed(620.0, repaired, rng))
    assert (event.kind, event.component, event.hours) == ("repair", "friction", 610.0)
    item = of(tracker, "friction")
    assert item.value < 4 * SIGMA
    assert growing(tracker, "friction") == pytest.approx(0.5, abs=0.02)
    assert not tracker.predict().components["friction"].known


def test_repair_of_several_faults_is_confirmed_after_two_tests_despite_uncertain_growth():
    growths = {
        "friction": Growth("exponential", rate=8.5e-3, shape=0.05, noise=0.2),
        "backlash": Growth("archard", rate=6e-4, shape=3.0, noise=0.2),
        "short_circuit_a": Growth("self_heating", rate=7e-4, shape=6.0, noise=0.2, onset=100.0),
    }
    for seed in range(4):
        tracker, rng = Tracker(), np.random.default_rng(seed)
        feed(tracker, growths, 200.0, rng)
        kinds = feed(tracker, growths, 220.0, rng, after=200.0)[0]
        assert {event.kind for event in kinds} == {"outlier", "repair"}
        assert all(of(tracker, name).value < 0.03 for name in growths)


def test_step_raises_the_level_and_keeps_the_rate_with_less_certainty(grown):
    tracker, faults, rng = grown
    before, growth = of(tracker, "friction"), tracker._mixture.members[0]
    sure = tracker._mixture.weight[growth].max()
    stepped = faults.copy()
    stepped[0] += 0.1
    tracker.update(observed(610.0, stepped, rng))
    (event,) = tracker.update(observed(620.0, stepped, rng))
    assert (event.kind, event.component, event.hours) == ("step", "friction", 610.0)
    after = of(tracker, "friction")
    assert after.value == pytest.approx(stepped[0], abs=4 * SIGMA)
    # The exponential law itself grows (x + x_0) times faster at the higher level.
    assert before.trend < after.trend < 3.0 * before.trend
    assert tracker._mixture.weight[growth].max() < sure
    life = tracker.predict().components["friction"]
    assert life.known


def test_gain_that_moves_closer_to_healthy_is_a_repair_on_either_side():
    for gain in (0.35, 0.65):
        tracker, rng = Tracker(), np.random.default_rng(1)
        feed(tracker, {}, 200.0, rng, {"gain": gain})
        tracker.update(observed(210.0, {"gain": 0.5}, rng))
        (event,) = tracker.update(observed(220.0, {"gain": 0.5}, rng))
        assert (event.kind, event.component) == ("repair", "gain")


def test_jump_of_the_size_of_occasional_errors_must_appear_three_times():
    tracker, rng = Tracker(), np.random.default_rng(2)
    feed(tracker, {}, 400.0, rng, {"backlash": 0.1})
    kinds = []
    for hours in (410.0, 420.0, 430.0):
        kinds += [e.kind for e in tracker.update(observed(hours, {"backlash": 0.138}, None))]
    assert kinds == ["step"]
    assert of(tracker, "backlash").value == pytest.approx(0.138, abs=SIGMA)


def test_two_wrong_tests_in_a_row_are_not_mistaken_for_a_change():
    tracker, rng = Tracker(), np.random.default_rng(3)
    faults = {"friction": 0.1, "backlash": 0.1, "eccentricity": 0.1}
    feed(tracker, {}, 300.0, rng, faults)
    first = {"friction": 0.2, "backlash": 0.2, "eccentricity": 0.3}
    wrong = {"friction": 0.2, "backlash": 0.1, "eccentricity": 0.1}
    events = tracker.update(observed(310.0, first)) + tracker.update(observed(320.0, wrong))
    assert {event.kind for event in events} == {"outlier"}
    assert tracker.update(observed(330.0, faults)) == []
    assert of(tracker, "friction").value == pytest.approx(0.1, abs=SIGMA)


def test_lasting_deviation_is_eventually_used():
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
    # 4 actuators of 7 components, with 75 tests each; 13,000 such tests had none in a longer trial.
    for seed in range(4):
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


NONE = np.zeros(8, dtype=bool)


def test_measurement_of_an_estimate_has_its_values():
    faults = np.linspace(0.1, 0.8, 8)
    made = replace(made_test(0), faults=faults, covariance=1e-5 * np.eye(8), unobservable=NONE)
    seen = Measurement.of(made, 120)
    assert seen.hours == 120.0
    np.testing.assert_array_equal(seen.faults, faults)
    np.testing.assert_allclose(seen.noise, 1e-5)


def test_invalid_estimate_measures_nothing():
    with pytest.raises(ValueError, match="cannot use an estimate that is not valid: a gap"):
        Measurement.of(made_test(0, valid=False), 10.0)


def test_component_at_its_healthy_value_is_known_only_to_be_near_it():
    faults = healthy_faults()
    faults[0] = 0.02
    unobservable = NONE.copy()
    unobservable[1] = True
    seen = Measurement(10.0, faults, 1e-5 * np.eye(8), unobservable)
    np.testing.assert_array_equal(np.flatnonzero(~seen.near_healthy), [0, 1])


def test_unobservable_components_need_no_values():
    faults, covariance = healthy_faults(), 1e-5 * np.eye(8)
    faults[PHASE] = np.nan
    covariance[PHASE] = covariance[:, PHASE] = np.nan
    unobservable = NONE.copy()
    unobservable[PHASE] = True
    seen = Measurement(10.0, faults, covariance, unobservable)
    assert np.isfinite(seen.noise).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hours": -1.0}, "hours = -1.0 h"),
        ({"faults": np.zeros(7)}, r"faults of a measurement has shape \(7,\)"),
        ({"covariance": np.zeros(8)}, "covariance of a measurement has shape"),
        ({"faults": np.full(8, np.nan)}, "is not finite"),
        ({"covariance": np.full((8, 8), np.nan)}, "variances"),
        ({"covariance": -np.eye(8)}, "variances"),
    ],
)
def test_impossible_measurement_is_refused(changes, message):
    figures = {
        "hours": 10.0,
        "faults": FaultVector.of(healthy_faults()),
        "covariance": np.eye(8),
        "unobservable": NONE,
    }
    with pytest.raises(ValueError, match=message):
        Measurement(**(figures | changes))
