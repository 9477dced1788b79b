"""Faults that drive each other: what is learnt of it, and their common future."""

from dataclasses import fields

import numpy as np
import pytest

from ema_core.faults import COMPONENTS, FAULT_NAMES, fault_vector
from ema_core.growth_laws import LAWS
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.driven import DRIVERS, Driven
from ema_monitor.prognosis.growth.driven_lives import (
    DrivenDraw,
    OwnGrowth,
    driven_lives,
    driven_values,
)
from ema_monitor.prognosis.growth.forecast import Draw, draw, futures, lives
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.mixture import Mixture
from ema_monitor.prognosis.growth.settings import NOMINAL_LAWS, TrackerSettings
from ema_monitor.prognosis.growth.tracker import Tracker

PLAY, FRICTION, ECCENTRICITY = map(COMPONENTS.index, ("backlash", "friction", "eccentricity"))
SETTING = "driven_probability"
SIGMA = 0.004
INTERVAL_H = 12.0
COUPLING = 1.2e-3
AS_PAST = np.ones(len(COMPONENTS))


def test_component_of_a_known_law_is_not_driven():
    driven = Driven(HealthLimits(), TrackerSettings(laws=NOMINAL_LAWS))
    assert not driven.prior.any()
    driven = Driven(HealthLimits(), TrackerSettings())
    assert {COMPONENTS[at] for at in np.flatnonzero(driven.prior.sum(axis=1))} == set(DRIVERS)


def measured(
    play: float,
    friction: float,
    hours: float,
    rng: np.random.Generator,
    unobservable: tuple[str, ...] = (),
) -> Measurement:
    faults = fault_vector({"backlash": play, "friction": friction, "eccentricity": 0.2})
    shown = [FAULT_NAMES.index(name) for name in ("backlash", "friction", "eccentricity")]
    faults[shown] += SIGMA * rng.standard_normal(3)
    hidden = np.array([name in ("eccentricity_phase", *unobservable) for name in FAULT_NAMES])
    covariance = np.where(np.outer(hidden, hidden), np.nan, SIGMA**2 * np.eye(faults.size))
    return Measurement(hours, np.clip(faults, 0.0, 1.0), covariance, hidden)


def tracked(coupling: float, tests: int) -> Tracker:
    """A tracker of a unit whose play grows in jerks, and whose friction follows the play."""
    tracker, rng = Tracker(), np.random.default_rng(4)
    play = friction = 0.05
    for number in range(tests):
        tracker.update(measured(play, friction, INTERVAL_H * number, rng))
        # Play that grows for a while, and then not: no law for life of the friction fits.
        grown = 0.01 if number % 40 < 20 else 0.0
        friction += coupling * INTERVAL_H * (play + 0.5 * grown)
        play += grown
    return tracker


def drawn(tracker: Tracker, number: int, rng: np.random.Generator) -> tuple[Draw, DrivenDraw]:
    sample = draw(tracker._mixture, number, rng)
    assert sample.driven is not None
    return sample, sample.driven


@pytest.fixture(scope="module")
def tracker() -> Tracker:
    return tracked(COUPLING, 60)


@pytest.mark.slow
def test_coupling_is_learnt_from_what_play_does_to_friction(tracker: Tracker):
    driven = tracker._mixture.driven
    share = driven.weight[FRICTION]
    assert share.sum() > 5.0 * driven.prior[FRICTION].sum()
    by_play = share * (driven.driver[FRICTION] == PLAY)
    assert by_play.sum() > 0.9 * share.sum()
    learnt = by_play @ driven.mean[FRICTION, :, 2] / by_play.sum()
    assert learnt == pytest.approx(COUPLING, rel=0.2)
    rate = by_play @ driven.rates()[FRICTION] / by_play.sum()
    (friction,) = [one for one in tracker.components() if one.name == "friction"]
    assert friction.laws["driven"] == pytest.approx(share.sum())
    assert friction.trend == pytest.approx(rate, rel=0.3)


@pytest.mark.slow
def test_samples_of_a_unit_share_their_growth(tracker: Tracker):
    rng = np.random.default_rng(0)
    sample, driven = drawn(tracker, 4000, rng)
    ends = lives(sample, rng)
    number, place = driven.at
    own = place[(number == FRICTION) & (driven.driver == PLAY)]
    pair = ends[:, own]
    both = np.isfinite(pair[PLAY]) & np.isfinite(pair[FRICTION])
    assert both.sum() > 500
    ranks = np.argsort(np.argsort(pair[[PLAY, FRICTION]][:, both], axis=1), axis=1)
    assert np.corrcoef(ranks).min() > 0.2


@pytest.mark.slow
def test_futures_are_finite_and_do_not_fall_however_fine(tracker: Tracker):
    rng = np.random.default_rng(1)
    sample, driven = drawn(tracker, 2000, rng)
    number, place = driven.at
    for last in (60.0, 3000.0, 100_000.0):
        hours = np.linspace(0.0, last, 61)[:, None, None]
        values = futures(sample, hours, rng)[:, number, place]
        assert np.isfinite(values).all()
        grows = driven.state[:, 1] >= 0.0
        assert np.diff(values[:, grows], axis=0).min() >= 0.0


@pytest.mark.slow
@pytest.mark.parametrize("faster", [0.25, 1.0, 4.0])
def test_lives_are_the_first_passages_of_the_futures_whatever_the_duty(
    tracker: Tracker, faster: float
):
    rng, rates = np.random.default_rng(2), np.ones(len(COMPONENTS))
    rates[PLAY] = faster
    sample, driven = drawn(tracker, 8000, rng)
    at = driven.at[1][(driven.at[0] == FRICTION) & (driven.driver == PLAY)]
    ends = lives(sample, rng, rates)[FRICTION, at]
    hours = np.linspace(0.0, 3000.0, 601)
    values = futures(sample, hours[:, None, None] * rates[:, None], rng)[:, FRICTION, at]
    limit = HealthLimits().of("friction")
    for share in (0.25, 0.5):
        over = np.mean(values >= limit, axis=1)
        passed = hours[np.argmax(over >= share)]
        assert np.quantile(ends, share) == pytest.approx(passed, rel=0.08, abs=10.0)


@pytest.mark.slow
def test_driver_that_is_repaired_drives_no_more():
    tracker, rng = tracked(COUPLING, 60), np.random.default_rng(5)
    before = rate_by_play(tracker)
    (friction,) = [one.value for one in tracker.components() if one.name == "friction"]
    for number in (60, 61):
        events = tracker.update(measured(0.003, friction, INTERVAL_H * number, rng))
    assert [(event.kind, event.component) for event in events] == [("repair", "backlash")]
    assert abs(rate_by_play(tracker)) < 0.2 * before


def rate_by_play(tracker: Tracker) -> float:
    """Return the mean growth of friction that play drives [1/h]."""
    driven = tracker._mixture.driven
    share = driven.weight[FRICTION] * (driven.driver[FRICTION] == PLAY)
    return float(share @ driven.rates()[FRICTION] / share.sum())


@pytest.mark.slow
def test_driver_that_no_test_shows_drives_nothing():
    tracker, rng = Tracker(), np.random.default_rng(6)
    for number in range(30):
        tracker.update(measured(0.05, 0.05 + 4e-3 * number, 12.0 * number, rng, ("eccentricity",)))
    assert not tracker._mixture.driven.shown[ECCENTRICITY]
    assert np.abs(tracker._mixture.driven.level).max() < 1.0
    friction = next(one for one in tracker.components() if one.name == "friction")
    assert friction.trend == pytest.approx(4e-3 / 12.0, rel=0.3)
    assert np.isfinite(tracker.futures(np.linspace(0.0, 1e4, 50))).all()


def test_highest_probability_leaves_room_for_growth_by_laws():
    (most,) = [
        item.metadata["range"][1] for item in fields(TrackerSettings) if item.name == SETTING
    ]
    mixture = Mixture(HealthLimits(), TrackerSettings(**{SETTING: most}))
    assert mixture.bank.weight.min() > 0.0
    shares = mixture.bank.sums(mixture.bank.weight)
    shares += sum(one.weight.sum(axis=1) for one in mixture.filters)
    np.testing.assert_allclose(shares, 1.0)
    np.testing.assert_allclose(mixture.constant(), 0.5)


def growth_of(rates: dict[int, float], limit: float = 0.5) -> OwnGrowth:
    """One sample whose components grow linearly."""
    n = len(COMPONENTS)
    rate = np.zeros((n, 1))
    for number, one in rates.items():
        rate[number] = one
    law = np.where(rate > 0.0, LAWS.index("linear"), LAWS.index("constant"))
    zero = np.zeros((n, 1))
    return OwnGrowth(law, zero, rate, zero, np.full((n, 1), np.nan), np.full(n, limit))


def driven_by(pairs: list[tuple[int, int]], state: list[list[float]]) -> DrivenDraw:
    number, driver = (np.array(part) for part in zip(*pairs, strict=True))
    return DrivenDraw((number, np.zeros_like(number)), driver, np.array(state))


def test_life_of_a_driven_fault_is_that_of_the_exact_solution():
    # y = v u, x = a u + c v u^2 / 2.
    v, a, c = 2e-4, 1e-4, 1e-3
    sample = driven_by([(FRICTION, PLAY)], [[0.0, a, c]])
    (hours,) = driven_lives(sample, growth_of({PLAY: v}), AS_PAST)
    exact = (-a + np.sqrt(a**2 + 2.0 * c * v * 0.5)) / (c * v)
    assert hours == pytest.approx(exact, rel=2e-3)


def test_lives_of_faults_that_drive_each_other_are_those_of_the_exact_solution():
    # x' = c y, y' = d x: x = x0 cosh(w u) + y0 c / w sinh(w u), w^2 = c d.
    c, d, x0, y0 = 1e-3, 2e-3, 0.05, 0.02
    w = np.sqrt(c * d)
    pairs, state = [(FRICTION, PLAY), (PLAY, FRICTION)], [[x0, 0.0, c], [y0, 0.0, d]]
    hours = driven_lives(driven_by(pairs, state), growth_of({}), AS_PAST)
    u = np.linspace(0.0, 5000.0, 500_001)
    x = x0 * np.cosh(w * u) + y0 * c / w * np.sinh(w * u)
    y = y0 * np.cosh(w * u) + x0 * d / w * np.sinh(w * u)
    np.testing.assert_allclose(hours, [u[np.argmax(x >= 0.5)], u[np.argmax(y >= 0.5)]], rtol=3e-3)


@pytest.mark.parametrize("slower", [1.0, 0.1])
def test_levels_of_faults_that_drive_each_other_are_exact_by_clocks_of_their_own(slower: float):
    # x' = c y, y' = s d x, s being the hours of the second in an hour of the first.
    c, d, x0, y0 = 1e-3, 2e-3, 0.05, 0.02
    w = np.sqrt(c * d * slower)
    sample = driven_by([(FRICTION, PLAY), (PLAY, FRICTION)], [[x0, 0.0, c], [y0, 0.0, d]])
    hours = np.linspace(0.0, 1500.0, 31)
    values = np.zeros((hours.size, len(COMPONENTS), 1))
    steps = np.diff(hours, prepend=0.0)[:, None] * np.array([1.0, slower])
    driven_values(sample, values, np.zeros((len(COMPONENTS), 1)), steps)
    x = x0 * np.cosh(w * hours) + y0 * c / w * np.sinh(w * hours)
    y = y0 * np.cosh(w * hours) + x0 * w / c * np.sinh(w * hours)
    np.testing.assert_allclose(values[:, FRICTION, 0], x, rtol=1e-3)
    np.testing.assert_allclose(values[:, PLAY, 0], y, rtol=1e-3)


def test_changed_rate_has_the_standard_deviation_that_was_asked_for(tracker: Tracker):
    driven = tracker._mixture.driven.frozen()
    driven.change_rate(FRICTION, 3e-4, 2e-5)
    for at, driver in enumerate(driven.driver[FRICTION]):
        of_rate = np.array([0.0, 1.0, driven.level[driver]])
        mean, covariance = driven.mean[FRICTION, at], driven.covariance[FRICTION, at]
        assert of_rate @ mean == pytest.approx(3e-4)
        assert of_rate @ covariance @ of_rate == pytest.approx(4e-10, rel=1e-6)
        assert np.linalg.eigvalsh(covariance).min() >= -1e-12 * np.abs(covariance).max()


def test_what_no_test_has_shown_drives_nothing():
    rng, tracker = np.random.default_rng(6), Tracker()
    for number in range(40):
        level = 0.05 + 0.004 * number
        tracker.update(
            measured(level, level, 12.0 * number, rng, unobservable=("eccentricity", "backlash"))
        )
    _, driven = drawn(tracker, 4000, rng)
    of_friction = driven.at[0] == FRICTION
    assert of_friction.any()
    assert not driven.state[of_friction, 2].any()
    filters = tracker._mixture.driven
    rate = np.average(filters.rates()[FRICTION], weights=filters.weight[FRICTION])
    assert np.mean(driven.state[of_friction, 1]) == pytest.approx(rate, rel=0.1)


def test_fault_at_its_limit_has_no_life_left_and_one_without_growth_no_end():
    sample = driven_by([(FRICTION, PLAY), (PLAY, FRICTION)], [[0.6, 0.0, 0.0], [0.1, 0.0, 0.0]])
    hours = driven_lives(sample, growth_of({}), AS_PAST)
    assert hours.tolist() == [0.0, np.inf]


def test_levels_to_come_are_those_of_the_exact_solution():
    v, a, c, x0 = 2e-4, 1e-4, 1e-3, 0.03
    sample = driven_by([(FRICTION, PLAY)], [[x0, a, c]])
    hours = np.linspace(0.0, 900.0, 10)
    values = np.zeros((hours.size, len(COMPONENTS), 1))
    values[:, PLAY, 0] = v * hours
    steps = np.diff(hours, prepend=0.0)[:, None]
    driven_values(sample, values, np.zeros((len(COMPONENTS), 1)), steps)
    exact = x0 + a * hours + 0.5 * c * v * hours**2
    np.testing.assert_allclose(values[:, FRICTION, 0], exact, rtol=1e-9)
    np.testing.assert_allclose(values[:, PLAY, 0], v * hours)
