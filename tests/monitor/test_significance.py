"""Which components of an estimate differ from healthy, on linear models with a known covariance."""

import numpy as np
import pytest
from tests.monitor.bounded_minimum import bounded_minimum

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE
from ema_monitor.identification.uncertainty import (
    GROUPS,
    MISMATCH_FACTOR,
    MISMATCH_SIGMA,
    SIGNIFICANT_SIGMAS,
    Linearisation,
    refitted,
    sandwich_covariance,
    significant_components,
    uncertainty_of_faults,
)

N, SIGMA, FLOOR = 4000, 0.01, 0.01
# Standard deviation of a component, the mismatch of the model included.
WIDENED = np.hypot(MISMATCH_FACTOR * SIGMA, FLOOR)
PLANE = [ECCENTRICITY, ECCENTRICITY_PHASE]
HEALTHY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5])


@pytest.fixture(params=[8, 9])
def model(request):
    """Healthy point, noise and derivatives of a model that knows each component to `SIGMA`.

    The columns are orthogonal to each other and to the noise, whose entries are plus or minus one:
    the covariance that its residuals tell is `SIGMA` squared on the diagonal to the last digits.
    """
    d = request.param
    rng = np.random.default_rng(6)
    noise = rng.choice([-1.0, 1.0], N)
    columns = rng.normal(size=(N, d))
    columns -= np.outer(noise, noise @ columns) / N
    columns = np.linalg.qr(columns)[0]
    return HEALTHY[:d], noise, columns / SIGMA


def estimate(model, offsets):
    """Arguments of an estimate that is so many widened sigma away from healthy."""
    healthy, noise, jacobian = model
    point = healthy.copy()
    for i, offset in offsets.items():
        point[i] += offset * WIDENED
    return point, healthy, noise, jacobian


def significant(point, healthy, residuals, jacobian, lags, floor):
    """What is left of all components, each tested by the covariance that the residuals tell."""
    return significant_components(
        Linearisation(point, residuals, jacobian),
        healthy,
        lambda columns, left: sandwich_covariance(columns, left, lags),
        floor,
        np.ones(len(point), dtype=bool),
        GROUPS,
    )


def shown(model, offsets):
    floor = np.full(len(model[0]), FLOOR)
    result, point = significant(*estimate(model, offsets), 0, floor)
    assert result.dtype == bool
    return set(np.flatnonzero(result[:8])), result, point


def test_what_is_5_sigma_off_stays_and_what_is_half_a_sigma_off_goes(model):
    kept, result, point = shown(model, {0: 5.0, 1: 0.5, 3: 5.0, 4: 0.5, 7: -5.0})
    assert kept == {0, 3, 7}
    expected = model[0].copy()
    expected[[0, 3, 7]] += np.array([5.0, 5.0, -5.0]) * WIDENED
    # Orthogonal: the others do not move when one is put back.
    assert point == pytest.approx(expected, abs=1e-7)
    assert len(result) == len(point) == len(model[0])


@pytest.mark.parametrize(("share", "stays"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("component", [0, 3, 7])
def test_limit_of_one_component_is_that_of_significance(model, component, share, stays):
    """In standard deviations with the floor of the mismatch, as they are reported."""
    kept, _, _ = shown(model, {component: share * SIGNIFICANT_SIGMAS[component]})
    assert kept == ({component} if stays else set())


def test_healthy_actuator_shows_a_significant_fault_in_one_window_of_twenty():
    """Of 200,000 draws with known sigma; five standard errors are 0.25 %."""
    x = np.random.default_rng(8).normal(size=(200_000, 8))
    radius = np.hypot(x[:, ECCENTRICITY], x[:, ECCENTRICITY_PHASE])
    x[:, ECCENTRICITY] = x[:, ECCENTRICITY_PHASE] = radius
    x[:, 7] = np.abs(x[:, 7])
    assert np.mean(np.any(x > SIGNIFICANT_SIGMAS, axis=1)) == pytest.approx(0.05, abs=0.0025)


@pytest.mark.parametrize("sigmas", [1.3, 2.6])
def test_gain_within_the_bound_by_its_reported_sigma_is_not_significant(model, sigmas):
    """However well the residuals know it: the floor of the mismatch counts as well."""
    healthy, noise, jacobian = model
    d = len(healthy)
    sharp = 100.0 * jacobian
    reported = uncertainty_of_faults(healthy[:8], np.eye(8) * (SIGMA / 100.0) ** 2, 1.0)
    point = healthy.copy()
    point[7] += sigmas * np.sqrt(reported.covariance[7, 7])
    floor = np.zeros(d)
    floor[:8] = MISMATCH_SIGMA
    result, _ = significant(point, healthy, noise, sharp, 0, floor)
    assert not result[7]


@pytest.mark.parametrize(("share", "stays"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("angle", [0.0, 0.8, 2.5, 4.0])
def test_eccentricity_plane_is_one(model, angle, share, stays):
    """The same distance in whatever direction."""
    offset = share * SIGNIFICANT_SIGMAS[ECCENTRICITY]
    kept, _, point = shown(
        model,
        {ECCENTRICITY: offset * np.cos(angle), ECCENTRICITY_PHASE: offset * np.sin(angle)},
    )
    assert kept == (set(PLANE) if stays else set())
    if not stays:
        assert np.array_equal(point[PLANE], [0.5, 0.5])


@pytest.mark.parametrize("offset", [0.0, 0.2, -25.0])
def test_place_in_the_play_is_never_dropped(model, offset):
    if len(model[0]) == 9:
        _, result, point = shown(model, {1: 5.0, 8: offset})
        assert result[8]
        assert point[8] == pytest.approx(0.5 + offset * WIDENED, abs=1e-7)
    assert all(8 not in group for group in GROUPS)


def test_one_of_two_that_look_alike_takes_the_traces_of_both(model):
    """Put back one after the other: together they are seen, though neither alone is."""
    healthy, noise, jacobian = model
    alike = jacobian.copy()
    # Correlated by 0.995: their difference is known ten times worse than their sum.
    alike[:, 1] = 0.995 * jacobian[:, 0] + np.sqrt(1 - 0.995**2) * jacobian[:, 1]
    kept, _, point = shown((healthy, noise, alike), {0: 4.0, 1: 3.0})
    assert kept == {0}
    assert point[0] == pytest.approx((4.0 + 0.995 * 3.0) * WIDENED, abs=1e-6)
    assert point[1] == 0.0


def test_component_without_trace_is_put_back(model):
    healthy, noise, jacobian = model
    blind = jacobian.copy()
    blind[:, 2] = 0.0
    kept, _, point = shown((healthy, noise, blind), {0: 5.0, 2: 40.0})
    assert kept == {0}
    assert point[2] == 0.0


def test_correlated_residuals_make_a_component_less_sure(model):
    """Noise that holds for 10 samples is worth a tenth of the samples, for a slow column."""
    healthy, _, jacobian = model
    rng = np.random.default_rng(7)
    noise = np.repeat(rng.choice([-1.0, 1.0], N // 10), 10)
    t = np.arange(N) / N
    jacobian = jacobian.copy()
    jacobian[:, 0] = np.sqrt(2 / N) * np.sin(2 * np.pi * 3 * t) / SIGMA
    point = healthy.copy()
    point[0] += 4.0 * WIDENED
    for lags, stays in ((0, True), (20, False)):
        result, _ = significant(point, healthy, noise, jacobian, lags, np.zeros(len(point)))
        assert result[0] == stays


def problem(seed, d=8, spread=0.0):
    rng = np.random.default_rng(seed)
    point = rng.uniform(-spread, 1.0 + spread, d).clip(0.0, 1.0)
    return (
        point,
        HEALTHY[:d],
        rng.normal(size=200),
        rng.normal(size=(200, d)) * rng.uniform(1, 9, d),
    )


@pytest.mark.parametrize("seed", range(20))
def test_refit_is_constrained_least_squares(seed):
    """Of what is shown, within the unit box, with the others held healthy."""
    point, healthy, residuals, jacobian = problem(seed, 8 + seed % 2, 0.3)
    fitted = np.random.default_rng(100 + seed).random(len(point)) < 0.6
    found = refitted(Linearisation(point, residuals, jacobian), healthy, fitted)
    right = jacobian @ point - residuals - jacobian[:, ~fitted] @ healthy[~fitted]
    best = bounded_minimum(jacobian[:, fitted], right, found[fitted])
    assert np.array_equal(found[~fitted], healthy[~fitted])
    # The ridge is 1e-9 of the largest diagonal entry.
    assert found[fitted] == pytest.approx(best, abs=1e-6)
