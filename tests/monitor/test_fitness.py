# SPDX-License-Identifier: Apache-2.0
"""The residuals of each fitness and the cost, which is the sum of their squares."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import fault_vector, healthy_faults
from ema_monitor.identification import fitness
from ema_monitor.identification.fitness import FITNESS
from ema_monitor.identification.pseudo_huber import pseudo_huber
from ema_monitor.model.monitor_model import Response
from ema_monitor.windows.band import band_limited

from .windows import answered, fitness_for, window_from

H = 1e-4
N = 500


def response(current, speed=None) -> Response:
    current = np.atleast_2d(current)
    return Response(current, np.zeros_like(current) if speed is None else np.atleast_2d(speed))


def measured(current, speed: np.ndarray | float = 0.0, h=H):
    """Return a window with a current and a speed after its start."""
    n = len(current)
    return answered(
        window_from(np.zeros(n + 1), sample_period=h), current, np.broadcast_to(speed, (n,))
    )


@pytest.fixture
def currents():
    rng = np.random.default_rng(3)
    measured = np.cumsum(rng.normal(0.0, 0.2, N))
    return measured, measured + rng.normal(0.0, 0.3, N)


@pytest.fixture
def cost(calibration):
    def cost(name, current, modelled, h=H):
        made = fitness_for(name, measured(current, 20.0, h), calibration)
        return float(np.sum(made.residuals(response(modelled, np.full(len(current), 20.0))) ** 2))

    return cost


def total_least_squares(measured, modelled, h):
    """Section 6.2 of the thesis, with the slope divided by its rms, sample by sample."""
    n = len(measured)
    slope = [
        (measured[min(i + 1, n - 1)] - measured[max(i - 1, 0)])
        / (h * (min(i + 1, n - 1) - max(i - 1, 0)))
        for i in range(n)
    ]
    root_mean_square = math.sqrt(sum(s * s for s in slope) / n)
    return h * sum(
        (measured[i] - modelled[i]) ** 2 / math.sqrt((slope[i] / root_mean_square) ** 2 + 1)
        for i in range(n)
    )


def least_squares(measured, modelled, h):
    """Return the integral of the square."""
    return h * sum((a - b) ** 2 for a, b in zip(measured, modelled, strict=True))


@pytest.mark.parametrize("formula", [total_least_squares, least_squares])
def test_fitness_of_the_thesis_follows_its_formula(currents, cost, formula):
    expected = formula(*(row.tolist() for row in currents), H)
    # Sums of 500 terms in two orders.
    assert cost(formula.__name__, *currents) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", FITNESS)
def test_cost_does_not_depend_on_the_sample_period(name, cost):
    """Cost is an integral over time: half the period and twice the samples give the same cost.

    Sums of a smooth curve differ by first-order terms, a few per cent.
    """
    costs = []
    for h in (2e-4, 1e-4):
        t = np.arange(0.0, 1.0, h)
        costs.append(cost(name, np.sin(7 * t), np.sin(7 * t) + 0.01 * np.cos(3 * t), h))
    assert costs[0] == pytest.approx(costs[1], rel=0.02)


@pytest.mark.parametrize("name", FITNESS)
def test_each_individual_has_a_row(name, calibration):
    rng = np.random.default_rng(4)
    made = fitness_for(name, measured(rng.normal(size=N), rng.normal(size=N)), calibration)
    modelled = Response(rng.normal(size=(3, N)), rng.normal(size=(3, N)))
    rows = made.residuals(modelled)
    for i in range(3):
        alone = made.residuals(Response(modelled.current[[i]], modelled.speed[[i]]))
        assert rows[i] == pytest.approx(alone[0], rel=1e-9, abs=1e-12)


def test_two_thesis_fitnesses_agree_without_any_slope(cost):
    constant, modelled = np.full(20, 1.3), np.linspace(0.0, 2.0, 20)
    assert cost("total_least_squares", constant, modelled) == cost(
        "least_squares", constant, modelled
    )


def test_pseudo_huber_is_odd_monotonic_and_its_square_is_the_loss():
    distance = np.linspace(-9.0, 9.0, 181)
    values = pseudo_huber(distance, 0.7)
    assert values == pytest.approx(-values[::-1], rel=1e-14, abs=1e-14)
    assert np.all(np.diff(values) > 0.0)
    loss = 2 * 0.7**2 * (np.sqrt(1 + (distance / 0.7) ** 2) - 1)
    assert values**2 == pytest.approx(loss, rel=1e-12, abs=1e-13)


def scattering(calibration, current, speed):
    """Return a calibration with scatters for a command that differs from the calibrated one."""
    return replace(calibration, model_rms=current, model_speed_rms=speed)


@pytest.fixture
def scattered(calibration):
    """Return a calibration with a large scatter of the current and a small scatter of the speed.

    The loss is then quadratic in errors of the current.
    """
    return scattering(calibration, 100.0, 1e-3)


def residuals_of(calibration, speed, *, current_error=0.0, speed_error=0.0):
    """Return the band-limited residuals of the current and of the speed in a window, ``(m,)`` each.

    ``speed`` is the measured speed. The model deviates from the measurement by ``current_error``
    and ``speed_error``.
    """
    speed = np.broadcast_to(np.asarray(speed, dtype=float), (N,))
    window = measured(np.linspace(-3.0, 3.0, N), speed)
    expected = response(window.current - current_error, speed - speed_error)
    return np.split(fitness_for("band_limited", window, calibration).residuals(expected)[0], 2)


def test_weight_of_an_error_at_constant_speed_follows_the_speed_over_its_rms(scattered):
    """At the rms speed, the weight is 1 / hypot(1, 1/2) if half the rms counts as slow."""
    of_current, of_speed = residuals_of(scattered, 20.0, current_error=0.3)
    weight = 1.0 / np.hypot(1.0, fitness._SLOW_SHARE)
    # For 0.3 A, the loss with a scale of 100 A is quadratic to 1e-6.
    assert of_current == pytest.approx(0.3 * weight * np.sqrt(1e-3), rel=1e-5)
    assert of_speed == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("error", [{"current_error": 0.3}, {"speed_error": 2.0}])
def test_error_does_not_count_while_the_motor_stands_still(scattered, error):
    speed = np.where(np.arange(N) < N // 2, 0.0, 30.0)
    rows = np.concatenate(residuals_of(scattered, speed, **error))
    standing = np.tile(band_limited(speed, H) == 0.0, 2)
    assert np.sum(standing) > len(rows) // 3
    assert np.all(rows[standing] == 0.0)
    assert np.sum(rows**2) > 0.0


def test_speed_counts_as_half_the_equivalent_current_of_its_loop(scattered):
    p = scattered.parameters
    in_amperes = p.GAP / p.k_t * 0.2
    _, of_speed = residuals_of(scattered, 20.0, speed_error=0.2)
    of_current, _ = residuals_of(scattered, 20.0, current_error=0.5 * in_amperes)
    assert of_speed == pytest.approx(of_current, rel=1e-12)


@pytest.mark.parametrize("sigma", [1.0, 10.0])
def test_speed_that_scatters_more_than_the_current_counts_by_its_scatter(calibration, sigma):
    """A sigma of speed has at most the weight of a sigma of current."""
    noisy = scattering(calibration, 0.02, sigma)
    _, of_speed = residuals_of(noisy, 20.0, speed_error=0.1 * sigma)
    of_current, _ = residuals_of(noisy, 20.0, current_error=0.1 * 0.02)
    assert of_speed == pytest.approx(of_current, rel=1e-9)


@pytest.mark.parametrize("scatter", [0.01, 0.1])
def test_errors_far_beyond_the_healthy_scatter_count_linearly(calibration, scatter):
    scattered = scattering(calibration, scatter, 1e-6)
    costs = [
        np.sum(residuals_of(scattered, 20.0, current_error=multiple * scatter)[0] ** 2)
        for multiple in (0.01, 0.02, 1000.0, 2000.0)
    ]
    assert costs[1] / costs[0] == pytest.approx(4.0, rel=1e-3)
    assert costs[3] / costs[2] == pytest.approx(2.0, rel=1e-2)
    # The cost of four scatters is the pseudo-Huber loss at its scale.
    weight = 1.0 / np.hypot(1.0, fitness._SLOW_SHARE)
    row, _ = residuals_of(scattered, 20.0, current_error=4 * scatter)
    expected = pseudo_huber(np.array([4 * scatter * weight]), fitness._ROBUST_SCALE * scatter)
    assert row == pytest.approx(expected[0] * np.sqrt(1e-3), rel=1e-9)


@pytest.mark.parametrize("scatters", [(math.nan, math.nan), (math.nan, 0.05), (0.02, math.nan)])
def test_unknown_scatter_is_replaced_by_an_assumed_one(calibration, scatters):
    unknown = scattering(calibration, *scatters)
    assumed = fitness._UNKNOWN_SCATTER * calibration.parameters.h_b
    scattered = scattering(
        calibration,
        assumed if math.isnan(scatters[0]) else scatters[0],
        1e-6 if math.isnan(scatters[1]) else scatters[1],
    )
    errors = {"current_error": 0.1, "speed_error": 0.4}
    for row, expected in zip(
        residuals_of(unknown, 20.0, **errors), residuals_of(scattered, 20.0, **errors), strict=True
    ):
        assert np.all(np.isfinite(row))
        assert np.array_equal(row, expected)


def test_healthy_window_costs_less_than_the_good_cost_and_a_fault_more(calibration, unseen_window):
    window = unseen_window
    made, model = fitness_for("band_limited", window, calibration), calibration.model()
    faults = np.stack([healthy_faults(), fault_vector({"friction": 0.05})])
    rows = made.residuals(calibration.expect(model.respond(window, faults, 1.0), window))
    healthy, faulty = np.sum(rows**2, axis=1)
    # Speed and current of a healthy actuator, whose scatters give a cost of up to about 2 of 8.
    assert healthy < made.good_cost / 2 < made.good_cost < faulty
