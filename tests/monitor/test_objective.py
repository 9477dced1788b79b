# SPDX-License-Identifier: Apache-2.0
"""Objective of the optimizers: residuals on the unit box, and their derivatives."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, HIGHEST, fault_vector
from ema_monitor.identification.fitness import FITNESS
from ema_monitor.identification.objective import Coordinates, Objective
from ema_monitor.model.monitor_model import MonitorModel
from ema_monitor.optimizers.least_squares import DIFFERENCE

from .reference_cases import TRUTH
from .windows import made_by


@pytest.fixture(scope="module")
def made(healthy_windows, calibration):
    """Return a window that the calibrated model simulated with faults."""
    return made_by(calibration, healthy_windows[0], TRUTH)


@pytest.mark.parametrize("cartesian", [True, False])
@pytest.mark.parametrize("fitness", FITNESS)
def test_window_simulated_by_the_model_has_zero_residuals_at_its_faults(
    made, calibration, fitness, cartesian
):
    objective = Objective(made, calibration, fitness, cartesian=cartesian)
    points = np.stack([objective.encode(fault_vector(TRUTH)), objective.healthy])
    truth, healthy = np.sum(objective.residuals(points) ** 2, axis=1)
    # Rounding of faults to the point and back, amplified to about 1e-9 A by a chirp of 100 Hz.
    assert truth < 1e-12
    assert healthy > 1e-4


@pytest.mark.parametrize(("is_play_known", "dimension"), [(True, 8), (False, 9)])
def test_unknown_position_in_the_play_is_a_ninth_component(
    healthy_windows, calibration, is_play_known, dimension
):
    faults = {"backlash": 0.3}
    window = made_by(calibration, healthy_windows[0], faults, -0.4)
    window = replace(window, play=-0.4 if is_play_known else None)
    objective = Objective(window, calibration)
    assert objective.dimension == dimension
    assert objective.linearisation_evaluations == 2 * dimension + 1
    point = objective.encode(fault_vector(faults), -0.4)
    assert point.shape == objective.healthy.shape == (dimension,)
    assert np.sum(objective.residuals(point[None]) ** 2) < 1e-12
    elsewhere = objective.encode(fault_vector(faults), 0.4)[None]
    assert (np.sum(objective.residuals(elsewhere) ** 2) > 1e-6) == (not is_play_known)


def test_residuals_equal_those_of_the_fitness_in_the_calibrated_model(made, calibration):
    objective = Objective(made, calibration, "least_squares")
    faults = fault_vector({"friction": 0.1})
    model = MonitorModel(calibration.parameters, calibration.form, calibration.dt, calibration.unit)
    current = model.respond(made, faults, 1.0).current[0] + calibration.correction
    expected = np.sqrt(made.sample_period) * (made.current - current)
    [row] = objective.residuals(objective.encode(faults)[None])
    assert row == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("friction", [0.4, 1.0])
def test_derivatives_are_central_differences_and_one_sided_at_the_bounds(
    made, calibration, friction
):
    """A healthy actuator has most of its faults at the bounds."""
    objective = Objective(made, calibration)
    point = objective.encode(fault_vector({"friction": friction, "gain": 0.6}))
    at = objective.linearise(point)
    assert np.array_equal(at.point, point)
    assert at.residuals == pytest.approx(objective.residuals(point[None])[0], abs=1e-15)
    assert at.cost == pytest.approx(np.sum(at.residuals**2), rel=1e-12)
    for i, step in enumerate(DIFFERENCE * np.eye(len(point))):
        ends = np.clip([point + step, point - step], 0.0, 1.0)
        above, below = objective.residuals(ends)
        expected = (above - below) / (ends[0, i] - ends[1, i])
        assert at.jacobian[:, i] == pytest.approx(expected, abs=1e-9)
        assert np.any(at.jacobian[:, i])


def test_linearisation_evaluates_as_often_as_stated(made, calibration, counted):
    objective = Objective(made, calibration)
    counted.clear()
    objective.linearise(np.full(objective.dimension, 0.3))
    # Five faults are at their bound when healthy: one of the two differences is the point itself.
    objective.linearise(objective.healthy)
    most = objective.linearisation_evaluations
    assert counted == [most, most - 5]


@pytest.fixture(params=[(0.25, True), (0.25, False), (None, True), (None, False)])
def coordinates(request) -> Coordinates:
    """Return coordinates with and without the position in the play and the eccentricity plane."""
    return Coordinates(*request.param)


def test_encoding_then_decoding_returns_the_faults(coordinates):
    rng = np.random.default_rng(8)
    for _ in range(50):
        faults, play = rng.random(8) * HIGHEST, rng.uniform(-1.0, 1.0)
        point = coordinates.encode(faults, play)
        assert point.shape == ((8,) if coordinates.play is not None else (9,))
        assert np.all((point >= 0.0) & (point <= 1.0))
        [decoded], [decoded_play] = coordinates.decode(point[None])
        # The phase loses three digits at the smallest eccentricity drawn, 1e-3.
        assert decoded == pytest.approx(faults, abs=1e-12)
        assert decoded_play == pytest.approx(
            play if coordinates.play is None else coordinates.play, abs=1e-15
        )


def test_every_point_of_the_box_is_a_fault_vector(coordinates):
    d = 8 if coordinates.play is not None else 9
    rng = np.random.default_rng(9)
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * d)).reshape(d, -1).T
    faults, play = coordinates.decode(np.concatenate([corners, rng.random((200, d))]))
    assert np.array_equal(fault_vector(faults), faults)
    assert np.all(np.abs(play) <= 1.0)


@pytest.mark.parametrize(("x", "y"), [(1.0, 1.0), (0.0, 1.0), (0.1, 0.05), (1.0, 0.9)])
def test_eccentricity_beyond_one_is_projected_along_its_direction(x, y):
    point = np.full(8, 0.5)
    point[[ECCENTRICITY, ECCENTRICITY_PHASE]] = x, y
    [faults], _ = Coordinates(0.0, cartesian=True).decode(point[None])
    assert np.hypot(2 * x - 1, 2 * y - 1) > 1.0
    assert faults[ECCENTRICITY] == 1.0
    phi = (2 * faults[ECCENTRICITY_PHASE] - 1) * np.pi
    assert np.tan(phi) == pytest.approx((2 * y - 1) / (2 * x - 1), rel=1e-12)
    assert np.sign(np.cos(phi)) == np.sign(2 * x - 1)


def test_eccentricity_and_phase_are_mapped_to_the_plane():
    """A phase of 0.75 is phi = pi / 2: zeta is entirely in y."""
    faults = fault_vector({"eccentricity": 0.4, "eccentricity_phase": 0.75})
    point = Coordinates(0.0, cartesian=True).encode(faults)
    assert point[[ECCENTRICITY, ECCENTRICITY_PHASE]] == pytest.approx([0.5, 0.7], abs=1e-15)


def test_unknown_play_starts_at_the_centre_unless_given():
    coordinates = Coordinates(None, cartesian=True)
    places = [coordinates.encode(fault_vector({}), *play)[8] for play in ((-1.0,), (), (1.0,))]
    assert places == [0.0, 0.5, 1.0]
