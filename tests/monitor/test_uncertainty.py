"""How well a window determines the faults, against what repeated experiments scatter."""

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, FAULT_NAMES, fault_vector
from ema_monitor.identification.uncertainty import (
    MISMATCH_FACTOR,
    MISMATCH_SIGMA,
    SIGNIFICANT_SIGMAS,
    SMALLEST_ECCENTRICITY,
    UNOBSERVABLE_SIGMA,
    USUAL_MISFIT,
    sandwich_covariance,
    uncertainty_of_faults,
)

# As many samples as a window has, and lags over as many as its uncertainty is computed with.
N, RUNS, LAGS = 5000, 1000, 50
PLANE = [ECCENTRICITY, ECCENTRICITY_PHASE]


@pytest.fixture(scope="module")
def jacobian():
    """Derivatives of a linear model, smooth as those of a current are, and of different size."""
    t = np.linspace(0.0, 1.0, N)
    return np.stack([np.sin(9 * t), 3.0 * np.cos(23 * t), 0.5 + t**2], axis=1)


def ar1(rng, rho, runs):
    """Noise of unit variance, `(N, runs)`, in which each value keeps a share rho of that before."""
    noise = rng.normal(size=(N, runs))
    noise[1:] *= np.sqrt(1.0 - rho**2)
    for i in range(1, N):
        noise[i] += rho * noise[i - 1]
    return noise


def experiments(jacobian, rho):
    """Covariance of the estimates of many experiments, and the residuals of the first ones."""
    noise = ar1(np.random.default_rng(11), rho, RUNS)
    estimates = np.linalg.pinv(jacobian) @ noise
    return np.cov(estimates), (noise[:, :40] - jacobian @ estimates[:, :40]).T


def mean_sandwich(jacobian, residuals, lags):
    return np.mean([sandwich_covariance(jacobian, row, lags) for row in residuals], axis=0)


@pytest.mark.parametrize(("rho", "tolerance"), [(0.0, 0.15), (0.8, 0.25)])
def test_covariance_is_what_experiments_scatter(jacobian, rho, tolerance):
    """1000 experiments leave 4.5 % of scatter in a variance.

    The residuals have lost three of the 98 stretches of 51 samples, which makes it up to 6 % too
    small; of correlated noise Bartlett's weights miss 2 rho / (1 - rho^2) / 51 = 9 % more.
    """
    scattered, residuals = experiments(jacobian, rho)
    covariance = mean_sandwich(jacobian, residuals, LAGS)
    sigma = np.sqrt(np.diag(scattered))
    assert np.diag(covariance) == pytest.approx(np.diag(scattered), rel=tolerance)
    assert covariance / np.outer(sigma, sigma) == pytest.approx(
        scattered / np.outer(sigma, sigma), abs=tolerance
    )


def test_correlation_must_not_be_left_out(jacobian):
    """For smooth derivatives it makes the variance (1 + rho) / (1 - rho) = 9 times as large."""
    scattered, residuals = experiments(jacobian, 0.8)
    naive = mean_sandwich(jacobian, residuals, 0)
    assert np.diag(scattered) / np.diag(naive) == pytest.approx(9.0, rel=0.2)


def test_without_lags_it_is_whites_covariance(jacobian):
    """(J'J)^-1 J' diag(r^2) J (J'J)^-1, for any residuals."""
    residuals = np.random.default_rng(1).normal(size=N) * np.linspace(0.5, 2.0, N)
    pseudo_inverse = np.linalg.pinv(jacobian)
    expected = (pseudo_inverse * residuals**2) @ pseudo_inverse.T
    covariance = sandwich_covariance(jacobian, residuals, 0)
    # The ridge is 1e-9 of the largest of the normal matrix, 1e-7 of its smallest.
    assert covariance == pytest.approx(expected, rel=1e-5)


def test_lags_have_bartletts_weights():
    """For one constant derivative: weighted products of residuals over n squared."""
    residuals = np.random.default_rng(6).normal(size=40)
    total = sum(
        (1 - abs(i - j) / 4) * residuals[i] * residuals[j]
        for i in range(40)
        for j in range(40)
        if abs(i - j) <= 3
    )
    [[variance]] = sandwich_covariance(np.ones((40, 1)), residuals, 3)
    # The ridge: 1e-9 of n on either side.
    assert variance == pytest.approx(total / 40**2, rel=1e-7)


def test_invisible_direction_is_unknown_and_spoils_no_other(jacobian):
    """A component without trace, and two that leave the same trace."""
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


def well_fitted(faults, covariance):
    """Uncertainty where the model fits as well as that of a healthy actuator."""
    return uncertainty_of_faults(faults, covariance, 1.0)


def uncertainty(values, sigma=0.01, plane=None):
    """Of faults that are all known alike in Cartesian coordinates, but for those of the plane."""
    covariance = np.eye(8) * sigma**2
    if plane is not None:
        covariance[np.ix_(PLANE, PLANE)] = plane
    # What the residuals must tell to leave this with the mismatch of the model.
    told = (covariance - np.diag(MISMATCH_SIGMA**2)) / MISMATCH_FACTOR**2
    return well_fitted(fault_vector(values), told)


def test_eccentricity_and_phase_are_radius_and_angle():
    """Sigma of the phase is that of an arc: sigma over 2 pi zeta."""
    result = uncertainty({"eccentricity": 0.5, "eccentricity_phase": 0.9})
    sigma = np.sqrt(np.diag(result.covariance))
    assert sigma[ECCENTRICITY] == pytest.approx(0.01, rel=1e-12)
    assert sigma[ECCENTRICITY_PHASE] == pytest.approx(0.01 / (2 * np.pi * 0.5), rel=1e-12)
    assert np.delete(sigma, PLANE) == pytest.approx(0.01, rel=1e-12)
    assert not np.any(result.unobservable)


@pytest.mark.parametrize("phase", [0.02, 0.3, 0.5, 0.71])
def test_eccentricity_and_phase_scatter_as_drawn_in_the_plane(phase):
    values = {"eccentricity": 0.6, "eccentricity_phase": phase}
    plane = np.array([[4e-4, 1.5e-4], [1.5e-4, 1e-4]])
    result = uncertainty(values, plane=plane).covariance[np.ix_(PLANE, PLANE)]
    phi = (2 * phase - 1) * np.pi
    centre = 0.6 * np.array([np.cos(phi), np.sin(phi)])
    x, y = np.random.default_rng(4).multivariate_normal(centre, plane, 100_000).T
    turned = (np.arctan2(y, x) - phi + np.pi) % (2 * np.pi) - np.pi
    scattered = np.cov(np.hypot(x, y), turned / (2 * np.pi))
    # 0.5 % of scatter, and what bends over 3 % of the radius.
    scale = np.sqrt(np.diag(scattered))
    assert result / np.outer(scale, scale) == pytest.approx(
        scattered / np.outer(scale, scale), abs=0.03
    )


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
    """However small the residuals are."""
    zeta = share * SMALLEST_ECCENTRICITY
    result = well_fitted(fault_vector({"eccentricity": zeta}), np.zeros((8, 8)))
    assert result.unobservable[ECCENTRICITY_PHASE] == unobservable


@pytest.mark.parametrize("name", ["friction", "short_circuit_b", "gain"])
def test_component_no_better_known_than_by_its_range_is_unobservable(name):
    index = FAULT_NAMES.index(name)
    covariance = 1e-4 * np.eye(8)
    covariance[index, index] = (1.01 * UNOBSERVABLE_SIGMA / MISMATCH_FACTOR) ** 2
    faults = fault_vector({"eccentricity": 0.5})
    result = well_fitted(faults, covariance)
    assert list(np.flatnonzero(result.unobservable)) == [index]
    covariance[index, index] = (0.99 * UNOBSERVABLE_SIGMA / MISMATCH_FACTOR) ** 2
    assert not np.any(well_fitted(faults, covariance).unobservable)


def test_unobservable_rows_and_columns_are_not_numbers():
    covariance = 1e-4 * np.eye(8) + 1e-5
    covariance[2, 2] = 1.0
    result = well_fitted(fault_vector({}), covariance)
    expected = np.zeros((8, 8), dtype=bool)
    expected[[2, ECCENTRICITY_PHASE], :] = expected[:, [2, ECCENTRICITY_PHASE]] = True
    assert np.array_equal(np.isnan(result.covariance), expected)
    assert np.array_equal(result.unobservable, np.diag(expected))


def test_mismatch_of_the_model_widens_what_the_residuals_tell():
    told = np.diag(np.linspace(1e-5, 1e-4, 8))
    result = well_fitted(fault_vector({"eccentricity": 0.5}), told)
    expected = MISMATCH_FACTOR**2 * np.diag(told) + MISMATCH_SIGMA**2
    assert np.delete(np.diag(result.covariance), PLANE) == pytest.approx(
        np.delete(expected, PLANE), rel=1e-12
    )


@pytest.mark.parametrize(
    ("goodness", "factor"),
    [(0.5, 1.0), (USUAL_MISFIT, 1.0), (3 * USUAL_MISFIT, 3.0), (np.nan, 1.0)],
)
def test_a_poor_fit_makes_all_components_less_sure(goodness, factor):
    faults, told = fault_vector({"eccentricity": 0.5}), 1e-6 * np.eye(8)
    usual = np.diag(uncertainty_of_faults(faults, told, 1.0).covariance)
    widened = np.diag(uncertainty_of_faults(faults, told, goodness).covariance)
    assert widened == pytest.approx(factor**2 * usual, rel=1e-12)


def test_covariance_that_is_no_number_is_unobservable():
    result = well_fitted(fault_vector({"eccentricity": 0.5}), np.full((8, 8), np.nan))
    assert np.all(result.unobservable)
