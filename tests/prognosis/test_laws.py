# SPDX-License-Identifier: Apache-2.0
"""Growth laws in text form, and properties of every registered law."""

import numpy as np
import pytest

from ema_core.faults import COMPONENTS
from ema_core.growth_laws import GROWING_LAWS
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.cells import grid
from ema_monitor.prognosis.growth.laws import TRACKED_LAWS
from ema_monitor.prognosis.growth.laws.interface import BENDS, Figures, Future, Levels
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import (
    NOMINAL_LAWS,
    KnownLaw,
    KnownLawTexts,
    TrackerSettings,
    known_law,
)

from .tracked_lives import observed


def test_law_without_numbers_has_the_defaults_of_its_type():
    assert known_law("backlash", "archard") == NOMINAL_LAWS["backlash"]


def test_numbers_are_rate_and_second_parameter_of_the_law():
    assert known_law("friction", "power:900:1.5") == KnownLaw("power", 900.0, shape=1.5)
    assert known_law("friction", "linear:1e-3") == KnownLaw("linear", 1e-3)
    assert known_law("gain", "drift:1e-4:2e-4") == KnownLaw("drift", 1e-4, diffusion=2e-4)


@pytest.mark.parametrize(
    ("fault", "written", "message"),
    [
        ("frction", "linear:1e-3", "unknown fault 'frction'"),
        ("friction", "cubic", "unknown law of friction 'cubic'"),
        ("friction", "constant", "unknown law of friction 'constant'"),
        ("friction", "archard", "default rate of friction exists for law exponential only"),
        ("friction", "linear:fast", "'linear:fast' of friction: could not convert"),
        ("friction", "linear:-1", "rate"),
        ("friction", "power:900", "law power needs a second parameter"),
        ("friction", "archard:1e-3", "law archard needs a second parameter"),
        ("eccentricity", "power:1e-9:1.6", "takes .* h: expected 50 to 30000 h"),
        ("friction", "linear:1e6", "takes 5e-07 h: expected 50 to 30000 h"),
        ("friction", "exponential:2e-3:0", "needs an x_0 above 0"),
        ("friction", "power:900:1:2", "expected at most two"),
    ],
)
def test_text_that_is_not_a_law_is_refused_by_name(fault, written, message):
    with pytest.raises(ValueError, match=message):
        known_law(fault, written)


def test_law_of_short_circuits_applies_to_each_phase():
    laws = KnownLawTexts(short_circuit="self_heating", gain="drift:1e-4:2e-4").laws()
    assert sorted(laws) == ["gain", "short_circuit_a", "short_circuit_b", "short_circuit_c"]
    assert laws["short_circuit_b"] == NOMINAL_LAWS["short_circuit_b"]


@pytest.mark.parametrize(
    ("text", "reported"), [("cubic", "'cubic': unknown law"), (0.5, "0.5: exp")]
)
def test_impossible_text_among_several_is_named(text, reported):
    with pytest.raises(ValueError, match=f"^eccentricity = {reported}"):
        KnownLawTexts(friction="exponential", eccentricity=text)


LIMIT = 0.5
NOISE_HOURS = 0.94
FIGURES = {
    "linear": (5e-4, 0.0, 0.0),
    "exponential": (2e-3, 0.05, 0.0),
    "archard": (3e-4, 3.0, 0.0),
    "self_heating": (3e-4, 3.0, 0.0),
    "power": (1500.0, 1.6, 0.0),
    "logistic": (2e-3, 0.65, 0.03),
    "drift": (5e-4, 0.0, 1e-3),
    "jumps": (3e-4, 4.0, 0.01),
}
"""Rate, shape and third parameter for a life of some thousand hours, for laws with growth."""

each = pytest.mark.parametrize("name", FIGURES)


def figures(name: str, n: int) -> Figures:
    return Figures(*(np.full(n, value) for value in (1.0, *FIGURES[name], LIMIT)))


def ahead(hours: np.ndarray, n: int, rng: np.random.Generator, noise: float) -> Future:
    """Return the future of n samples at hours from 0 on, with process noise or without."""
    steps = np.diff(hours, prepend=0.0)[:, None]
    wiener = np.cumsum(np.sqrt(steps) * rng.standard_normal((hours.size, n)), axis=0)
    every = np.tile(hours[:, None], n)
    return Future(every, every, np.sqrt(noise) * wiener, wiener)


def test_every_law_that_grows_is_tested():
    assert set(FIGURES) == set(TRACKED_LAWS) - {"constant"}


@each
def test_futures_of_a_law_pass_the_limit_when_its_lives_end(name):
    law, n, rng = TRACKED_LAWS[name], 4000, np.random.default_rng(1)
    x, of = np.full(n, 0.25), figures(name, n)
    mean, shape = law.passage(x, of, NOISE_HOURS, rng)
    ends = np.where(shape > 0.0, rng.wald(mean, np.maximum(shape, 1e-9)), mean)
    hours = np.linspace(0.0, np.quantile(ends, 0.9), 60)
    values = law.future(x, of, ahead(hours, n, rng, NOISE_HOURS), rng)
    np.testing.assert_allclose(values[0], 0.25)
    passed = np.maximum.accumulate(values, axis=0) >= LIMIT
    for at in (20, 40, 59):
        # Tolerance: two binomial shares of 4,000 samples, four standard errors, first order and
        # steps.
        assert passed[at].mean() == pytest.approx(np.mean(ends <= hours[at]), abs=0.06)


@each
def test_fault_at_its_limit_has_no_life_left(name):
    for limit in np.arange(0.02, 1.0, 0.01):
        of = figures(name, 2)
        of = of._replace(limit=np.full(2, limit), shape=of.shape + limit)
        over = limit * np.array([1.0, 1.3])
        assert np.all(
            TRACKED_LAWS[name].passage(over, of, NOISE_HOURS, np.random.default_rng())[0] == 0.0
        )


def test_life_by_jumps_is_the_mean_hours_to_the_jump_that_ends_it():
    n, law = 40_000, TRACKED_LAWS["jumps"]
    of, x = figures("jumps", n), np.full(n, 0.25)
    hours, _ = law.passage(x, of, NOISE_HOURS, np.random.default_rng(0))
    first = of.third / of.rate / (1.0 + of.shape * x)
    assert hours.mean() == pytest.approx((first + law.hours_until(x, of)).mean(), rel=0.01)


@each
def test_level_after_a_gap_equals_the_level_after_steps_of_the_same_length(name):
    law, of = TRACKED_LAWS[name], figures(name, 2 * 49)
    levels = []
    for steps in (1, 6):
        weight, mean, variance = np.full(98, 0.5), np.full(98, 0.2), np.full(98, 1e-6)
        for _ in range(steps):
            law.advance(Levels(weight, mean, variance), of, np.full(98, 60.0 / steps), NOISE_HOURS)
        middle = np.average(mean, weights=weight)
        spread = np.average(variance + (mean - middle) ** 2, weights=weight)
        levels.append((middle, np.sqrt(spread)))
    assert levels[0][0] > 0.21
    np.testing.assert_allclose(*levels, rtol=0.05)


@pytest.mark.slow
@each
def test_law_is_predicted_over_a_gap_and_a_restart_and_reset_by_a_repair(name):
    law, rng, of = TRACKED_LAWS[name], np.random.default_rng(3), figures(name, 1)
    begin = np.full(1, 0.1)
    until = float(law.hours_until(begin, of)[0])
    hours = np.arange(0.0, 0.7 * until, 10.0)
    values = law.future(begin, of, ahead(hours, 1, rng, 0.0), rng)[:, 0]
    rate, shape, third = FIGURES[name]
    is_known = name in GROWING_LAWS
    laws = {"friction": KnownLaw.of(name, rate, third or shape)} if is_known else {}
    tracker, restored = (Tracker(settings=TrackerSettings(laws=laws)) for _ in range(2))
    is_shown = (hours < 0.3 * until) | (hours > 0.4 * until)
    for number in np.flatnonzero(is_shown):
        tracker.update(observed(hours[number], {"friction": values[number]}, rng, 0.001))
    restored.restore(tracker.state())
    original, after_restart = tracker.predict(), restored.predict()
    np.testing.assert_array_equal(original.samples, after_restart.samples)
    left = float(law.hours_until(values[-1:], of)[0])
    assert original.dominant_fault == "friction"
    assert original.overall.hours_05 < left < original.overall.hours_95
    # Some thirty jumps, partly hidden by a gap, determine rate and bend to a factor of two.
    most = {"jumps": 2.0, "drift": 1.3}.get(name, 1.1)
    assert 1.0 / most < original.overall.hours_50 / left < most
    reported = [
        event.kind
        for later in (10.0, 20.0)
        for event in tracker.update(observed(hours[-1] + later, {}, rng, 0.001))
    ]
    assert reported == ["outlier", "repair"]
    assert not tracker.predict().components["friction"].known
    with pytest.raises(ValueError, match="at least the hours of the latest test"):
        tracker.update(observed(hours[0], {}))


@pytest.mark.parametrize("name", ["archard", "self_heating", "power"])
def test_all_laws_have_the_same_bends_and_interpolation_errs_by_little(name):
    """Over three quarters of life, the error is below half of the 20 % allowed for a prediction."""
    law, bends, left = TRACKED_LAWS[name], [], []
    for curve in law.curves(LIMIT):
        of = Figures(*np.array([[1.0], [1.0], [curve.shape], [0.0], [LIMIT]]))
        until, hour = law.hours_until(np.zeros(1), of), np.full(1, 1e-8)
        now = law.increment(np.zeros(1), of, 0.75 * until)
        bends += (law.increment(np.full(1, LIMIT), of, hour) / hour * until / LIMIT).tolist()
        # Hours that the rest of the growth would take at the current speed.
        speed = law.increment(now, of, hour) / hour
        left += (0.25 * until * speed / (LIMIT - now)).tolist()
    assert bends == pytest.approx(BENDS, rel=1e-4)
    assert 0.5 * np.max(np.abs(np.diff(np.log(left)))) < 0.5 * 0.2


def test_laws_are_equally_probable_with_all_their_bends_and_one_sided_faults_do_not_drift():
    cells = grid(HealthLimits(), TrackerSettings())
    for component in ("friction", "gain"):
        selected = (cells.component == COMPONENTS.index(component)) & ~cells.wanders
        share = {law: cells.prior[part][selected[part]].sum() for law, part in cells.slices.items()}
        for law in ("self_heating", "power", "jumps"):
            assert share[law] == pytest.approx(share["archard"])
        drifts = share["archard"] if component == "gain" else 0.0
        assert share["drift"] == pytest.approx(drifts)


def test_given_law_is_the_only_one():
    given_law = KnownLaw("self_heating", 1e-4, shape=6.0)
    cells = grid(HealthLimits(), TrackerSettings(laws={"friction": given_law}))
    selected = (cells.component == COMPONENTS.index("friction")) & (cells.prior < 0.5)
    assert set(np.flatnonzero(selected)) <= set(
        range(cells.prior.size)[cells.slices["self_heating"]]
    )
    assert set(cells.shape[selected]) == {6.0}
