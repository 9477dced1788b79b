# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of the faults in a window, and significance of their differences from healthy."""

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, FAULT_NAMES, fault_vector
from ema_monitor.identification.uncertainty import (
    GROUPS,
    MISMATCH_FACTOR,
    MISMATCH_SIGMA,
    PLANE,
    SIGNIFICANT_SIGMAS,
    SMALLEST_ECCENTRICITY,
    UNOBSERVABLE_SIGMA,
    USUAL_MISFIT,
    Linearisation,
    sandwich_covariance,
    significant_components,
    uncertainty_of_faults,
    widening,
)

N = 500


def derivatives(n):
    """Return derivatives of a linear model, smooth like a current and of different sizes."""
    t = np.linspace(0.0, 1.0, n)
    return np.stack([np.sin(9 * t), 3.0 * np.cos(23 * t), 0.5 + t**2], axis=1)


@pytest.fixture(scope="module")
def jacobian():
    return derivatives(N)


@pytest.mark.parametrize("lags", [0, 3])
def test_covariance_agrees_with_newey_and_west(jacobian, lags):
    """P S P' with the pseudoinverse P; S has products of near residuals with Bartlett's weights.

    Without lags, it is White's covariance.
    """
    residuals = np.random.default_rng(6).normal(size=N) * np.linspace(0.5, 2.0, N)
    apart = np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    weights = np.maximum(1.0 - apart / (lags + 1.0), 0.0)
    inverse = np.linalg.pinv(jacobian)
    expected = inverse @ (weights * np.outer(residuals, residuals)) @ inverse.T
    # The ridge is 1e-9 of the largest eigenvalue of the normal matrix, 1e-7 of its smallest.
    assert sandwich_covariance(jacobian, residuals, lags) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("rho", "tolerance"), [(0.0, 0.15), (0.8, 0.25)])
def test_covariance_agrees_with_the_scatter_of_experiments(rho, tolerance):
    """1000 experiments determine a variance to 4.5 %.

    The residuals have lost three of the 98 stretches of 51 samples, which lowers it by up to 6 %.
    For correlated noise, Bartlett's weights miss another 2 rho / (1 - rho^2) / 51 = 9 %.
    """
    jacobian = derivatives(5000)
    noise = np.random.default_rng(11).normal(size=(5000, 1000))
    noise[1:] *= np.sqrt(1.0 - rho**2)
    for i in range(1, len(noise)):
        noise[i] += rho * noise[i - 1]
    estimates = np.linalg.pinv(jacobian) @ noise
    residuals = (noise[:, :40] - jacobian @ estimates[:, :40]).T
    covariance = np.mean([sandwich_covariance(jacobian, row, 50) for row in residuals], axis=0)
    scattered = np.cov(estimates)
    sigma = np.sqrt(np.diag(scattered))
    assert np.diag(covariance) == pytest.approx(np.diag(scattered), rel=tolerance)
    assert covariance / np.outer(sigma, sigma) == pytest.approx(
        scattered / np.outer(sigma, sigma), abs=tolerance
    )


def test_invisible_direction_is_unknown_and_affects_no_other(jacobian):
    """One component has no effect, and two others have the same effect."""
    residuals = 0.1 * np.random.default_rng(3).normal(size=N)
    alone = sandwich_covariance(jacobian, residuals, 5)
    blind = np.column_stack([jacobian, np.zeros(N)])
    covariance = sandwich_covariance(blind, residuals, 5)
    assert covariance[:3, :3] == pytest.approx(alone, rel=1e-5)
    assert np.sqrt(covariance[3, 3]) > UNOBSERVABLE_SIGMA
    twins = np.column_stack([jacobian, jacobian[:, 0]])
    sigma = np.sqrt(np.diag(sandwich_covariance(twins, residuals, 5)))
    assert np.all(sigma[[0, 3]] > UNOBSERVABLE_SIGMA)
    assert sigma[1:3] == pytest.approx(np.sqrt(np.diag(alone))[1:], rel=1e-3)


def uncertainty(values, sigma=0.01, plane=None):
    """Return the uncertainty with equal sigma in Cartesian coordinates except for the plane."""
    covariance = np.eye(8) * sigma**2
    if plane is not None:
        covariance[np.ix_(PLANE, PLANE)] = plane
    # Residuals and mismatch of the model together give this covariance.
    stated = (covariance - np.diag(MISMATCH_SIGMA**2)) / MISMATCH_FACTOR**2
    return uncertainty_of_faults(fault_vector(values), stated)


@pytest.mark.parametrize("phase", [0.02, 0.3, 0.71])
def test_eccentricity_and_phase_scatter_as_drawn_in_the_plane(phase):
    """All other components keep their variances."""
    plane = np.array([[4e-4, 1.5e-4], [1.5e-4, 1e-4]])
    result = uncertainty({"eccentricity": 0.6, "eccentricity_phase": phase}, plane=plane)
    phi = (2 * phase - 1) * np.pi
    centre = 0.6 * np.array([np.cos(phi), np.sin(phi)])
    x, y = np.random.default_rng(4).multivariate_normal(centre, plane, 100_000).T
    turned = (np.arctan2(y, x) - phi + np.pi) % (2 * np.pi) - np.pi
    scattered = np.cov(np.hypot(x, y), turned / (2 * np.pi))
    # 0.5 % of scatter, and the curvature over 3 % of the radius.
    scale = np.sqrt(np.outer(np.diag(scattered), np.diag(scattered)))
    stated = result.covariance[np.ix_(PLANE, PLANE)]
    assert stated / scale == pytest.approx(scattered / scale, abs=0.03)
    assert np.delete(np.diag(result.covariance), PLANE) == pytest.approx(1e-4, rel=1e-12)
    assert not np.any(result.unobservable)


@pytest.mark.parametrize(("share", "unobservable"), [(0.99, True), (1.01, False)])
def test_phase_is_observable_once_the_eccentricity_is_detected(share, unobservable):
    sigma = 0.01
    zeta = share * SIGNIFICANT_SIGMAS[ECCENTRICITY] * sigma
    result = uncertainty({"eccentricity": zeta, "eccentricity_phase": 0.2}, sigma=sigma)
    assert result.unobservable[ECCENTRICITY_PHASE] == unobservable
    assert not result.unobservable[ECCENTRICITY]


@pytest.mark.parametrize(("share", "unobservable"), [(0.99, True), (1.01, False)])
def test_phase_of_an_eccentricity_as_small_as_the_models_mismatch_is_unobservable(
    share, unobservable
):
    """This holds for residuals of any size."""
    zeta = share * SMALLEST_ECCENTRICITY
    result = uncertainty_of_faults(fault_vector({"eccentricity": zeta}), np.zeros((8, 8)))
    assert result.unobservable[ECCENTRICITY_PHASE] == unobservable


@pytest.mark.parametrize("name", ["friction", "short_circuit_b", "gain"])
def test_component_known_no_better_than_its_range_is_unobservable(name):
    index = FAULT_NAMES.index(name)
    covariance = 1e-4 * np.eye(8)
    covariance[index, index] = (1.01 * UNOBSERVABLE_SIGMA / MISMATCH_FACTOR) ** 2
    faults = fault_vector({"eccentricity": 0.5})
    result = uncertainty_of_faults(faults, covariance)
    assert list(np.flatnonzero(result.unobservable)) == [index]
    covariance[index, index] = (0.99 * UNOBSERVABLE_SIGMA / MISMATCH_FACTOR) ** 2
    assert not np.any(uncertainty_of_faults(faults, covariance).unobservable)


def test_unobservable_rows_and_columns_are_nan():
    covariance = 1e-4 * np.eye(8) + 1e-5
    covariance[2, 2] = 1.0
    result = uncertainty_of_faults(fault_vector({}), covariance)
    expected = np.zeros((8, 8), dtype=bool)
    expected[[2, ECCENTRICITY_PHASE], :] = expected[:, [2, ECCENTRICITY_PHASE]] = True
    assert np.array_equal(np.isnan(result.covariance), expected)
    assert np.array_equal(result.unobservable, np.diag(expected))
    assert np.all(uncertainty_of_faults(fault_vector({}), np.full((8, 8), np.nan)).unobservable)


def test_mismatch_of_the_model_widens_the_covariance_of_the_residuals():
    stated = np.diag(np.linspace(1e-5, 1e-4, 8))
    result = uncertainty_of_faults(fault_vector({"eccentricity": 0.5}), stated)
    expected = MISMATCH_FACTOR**2 * np.diag(stated) + MISMATCH_SIGMA**2
    assert np.delete(np.diag(result.covariance), PLANE) == pytest.approx(
        np.delete(expected, PLANE), rel=1e-12
    )


@pytest.mark.parametrize(
    ("goodness", "factor"),
    [(0.5, 1.0), (USUAL_MISFIT, 1.0), (3 * USUAL_MISFIT, 3.0), (np.nan, 1.0)],
)
def test_poor_fit_widens_the_covariance_of_the_residuals(goodness, factor):
    assert widening(goodness) == pytest.approx(factor, rel=1e-12)


# For linear models with a known covariance.
SAMPLES, SIGMA, FLOOR = 4000, 0.01, 0.01
# Standard deviation of a component, including the mismatch of the model.
WIDENED = np.hypot(MISMATCH_FACTOR * SIGMA, FLOOR)
HEALTHY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5])


@pytest.fixture(params=[8, 9])
def model(request):
    """Return healthy point, noise and derivatives of a model with sigma `SIGMA` in each component.

    The columns are orthogonal to each other and to the noise, whose entries are plus or minus one:
    the covariance from its residuals is `SIGMA` squared on the diagonal to the last digits.
    """
    d = request.param
    rng = np.random.default_rng(6)
    noise = rng.choice([-1.0, 1.0], SAMPLES)
    columns = rng.normal(size=(SAMPLES, d))
    columns -= np.outer(noise, noise @ columns) / SAMPLES
    columns = np.linalg.qr(columns)[0]
    return HEALTHY[:d], noise, columns / SIGMA


def shown(model, offsets):
    """Return the significant components and the point of an estimate, in widened sigma."""
    healthy, noise, jacobian = model
    point = healthy.copy()
    for i, offset in offsets.items():
        point[i] += offset * WIDENED
    result, point = significant_components(
        Linearisation(point, noise, jacobian),
        healthy,
        lambda columns, left: sandwich_covariance(columns, left, 0),
        np.full(len(point), FLOOR),
        np.ones(len(point), dtype=bool),
        GROUPS,
    )
    assert result.dtype == bool
    return set(np.flatnonzero(result[:8])), result, point


def test_component_5_sigma_off_stays_and_component_half_a_sigma_off_is_reset(model):
    kept, result, point = shown(model, {0: 5.0, 1: 0.5, 3: 5.0, 4: 0.5, 7: -5.0})
    assert kept == {0, 3, 7}
    expected = model[0].copy()
    expected[[0, 3, 7]] += np.array([5.0, 5.0, -5.0]) * WIDENED
    # Orthogonal: resetting one component does not change the others.
    assert point == pytest.approx(expected, abs=1e-7)
    assert len(result) == len(point) == len(model[0])


@pytest.mark.parametrize(("share", "stays"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("component", [0, 3, 7])
def test_limit_of_a_single_component_is_the_significance_limit(model, component, share, stays):
    """The limit is in standard deviations with the floor of the mismatch, as reported."""
    kept, _, _ = shown(model, {component: share * SIGNIFICANT_SIGMAS[component]})
    assert kept == ({component} if stays else set())


def test_healthy_actuator_shows_a_significant_fault_in_one_window_of_twenty():
    """200,000 draws with known sigma; five standard errors are 0.25 %."""
    x = np.random.default_rng(8).normal(size=(200_000, 8))
    radius = np.hypot(x[:, ECCENTRICITY], x[:, ECCENTRICITY_PHASE])
    x[:, ECCENTRICITY] = x[:, ECCENTRICITY_PHASE] = radius
    x[:, 7] = np.abs(x[:, 7])
    assert np.mean(np.any(x > SIGNIFICANT_SIGMAS, axis=1)) == pytest.approx(0.05, abs=0.0025)


@pytest.mark.parametrize(("share", "stays"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("angle", [0.0, 0.8, 4.0])
def test_eccentricity_plane_is_tested_as_one(model, angle, share, stays):
    """The limit does not depend on the direction."""
    offset = share * SIGNIFICANT_SIGMAS[ECCENTRICITY]
    kept, _, point = shown(
        model, {ECCENTRICITY: offset * np.cos(angle), ECCENTRICITY_PHASE: offset * np.sin(angle)}
    )
    assert kept == (set(PLANE) if stays else set())
    if not stays:
        assert np.array_equal(point[PLANE], [0.5, 0.5])


@pytest.mark.parametrize("offset", [0.0, -25.0])
def test_position_in_the_play_is_never_dropped(model, offset):
    if len(model[0]) == 9:
        _, result, point = shown(model, {1: 5.0, 8: offset})
        assert result[8]
        assert point[8] == pytest.approx(0.5 + offset * WIDENED, abs=1e-7)
    assert all(8 not in group for group in GROUPS)


def test_one_of_two_similar_components_takes_the_effects_of_both(model):
    """Elimination is stepwise: neither is significant alone, but both together are."""
    healthy, noise, jacobian = model
    alike = jacobian.copy()
    # With a correlation of 0.995, the difference is ten times less certain than the sum.
    alike[:, 1] = 0.995 * jacobian[:, 0] + np.sqrt(1 - 0.995**2) * jacobian[:, 1]
    kept, _, point = shown((healthy, noise, alike), {0: 4.0, 1: 3.0})
    assert kept == {0}
    assert point[0] == pytest.approx((4.0 + 0.995 * 3.0) * WIDENED, abs=1e-6)
    assert point[1] == 0.0


def test_component_without_effect_is_reset(model):
    healthy, noise, jacobian = model
    blind = jacobian.copy()
    blind[:, 2] = 0.0
    kept, _, point = shown((healthy, noise, blind), {0: 5.0, 2: 40.0})
    assert kept == {0}
    assert point[2] == 0.0
