"""What the optimizers minimise: residuals on the unit box, and their derivatives."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import fault_vector, healthy_faults
from ema_monitor.identification.fitness import FITNESS
from ema_monitor.identification.objective import Objective
from ema_monitor.model.monitor_model import MonitorModel
from ema_monitor.optimizers.least_squares import DIFFERENCE

from .windows import answered, changed

TRUTH = {
    "friction": 0.3,
    "backlash": 0.05,
    "short_circuit_b": 0.15,
    "eccentricity": 0.2,
    "eccentricity_phase": 0.8,
    "gain": 0.6,
}


@pytest.fixture(scope="module")
def made(healthy_windows, calibration):
    """Window that the calibrated model made with faults, at a place in its play."""

    def made(faults, play=1.0, known=True):
        window = healthy_windows[0]
        response = calibration.expect(
            calibration.model().respond(window, fault_vector(faults), play), window
        )
        window = answered(window, response.current[0], response.speed[0])
        return replace(window, play=play if known else None)

    return made


@pytest.mark.parametrize("cartesian", [True, False])
@pytest.mark.parametrize("fitness", FITNESS)
def test_window_that_the_model_made_has_no_residual_at_its_faults(
    made, calibration, fitness, cartesian
):
    objective = Objective(made(TRUTH), calibration, fitness, cartesian=cartesian)
    points = np.stack([objective.encode(fault_vector(TRUTH)), objective.healthy])
    truth, healthy = np.sum(objective.residuals(points) ** 2, axis=1)
    # Faults to the point and back: rounding, which a chirp of 100 Hz makes some 1e-9 A of.
    assert truth < 1e-12
    assert healthy > 1e-4


@pytest.mark.parametrize(("known", "dimension"), [(True, 8), (False, 9)])
def test_unknown_place_in_the_play_is_a_ninth_component(made, calibration, known, dimension):
    faults = {"backlash": 0.3}
    objective = Objective(made(faults, -0.4, known), calibration)
    assert objective.dimension == dimension
    assert objective.linearisation_evaluations == 2 * dimension + 1
    point = objective.encode(fault_vector(faults), -0.4)
    assert point.shape == objective.healthy.shape == (dimension,)
    [found], [play] = objective.decode(point[None])
    assert found == pytest.approx(fault_vector(faults), abs=1e-12)
    assert play == pytest.approx(-0.4, abs=1e-12)
    assert np.sum(objective.residuals(point[None]) ** 2) < 1e-12
    elsewhere = objective.encode(fault_vector(faults), 0.4)[None]
    assert (np.sum(objective.residuals(elsewhere) ** 2) > 1e-6) == (not known)


def test_residuals_are_those_of_the_fitness_in_the_calibrated_model(made, calibration):
    window = made(TRUTH)
    objective = Objective(window, calibration, "least_squares")
    faults = fault_vector({"friction": 0.1})
    model = MonitorModel(calibration.parameters, calibration.form, calibration.dt, calibration.unit)
    current = model.respond(window, faults, 1.0).current[0] + calibration.correction
    expected = np.sqrt(window.sample_period) * (window.current - current)
    [row] = objective.residuals(objective.encode(faults)[None])
    assert row == pytest.approx(expected, abs=1e-12)


def test_correction_moves_with_a_window_that_begins_later(healthy_windows, calibration):
    """Correction and command are laid over each other before anything is compared."""
    window, n = healthy_windows[0], len(healthy_windows[0])
    shifted = changed(window, command=np.append(window.command[3:], np.full(3, window.command[-1])))
    objective = Objective(shifted, calibration)
    model = calibration.model()
    difference = (
        objective.expect(objective.healthy[None]).current[0]
        - model.respond(shifted, healthy_faults(), window.play).current[0]
    )
    assert difference[: n - 3] == pytest.approx(calibration.correction[3:], abs=1e-12)


def test_derivatives_are_central_differences(made, calibration):
    objective = Objective(made(TRUTH), calibration)
    point = objective.encode(fault_vector(TRUTH | {"friction": 0.4}))
    at = objective.linearise(point)
    assert np.array_equal(at.point, point)
    assert at.residuals == pytest.approx(objective.residuals(point[None])[0], abs=1e-15)
    assert at.cost == pytest.approx(np.sum(at.residuals**2), rel=1e-12)
    for i in np.flatnonzero((point > DIFFERENCE) & (point < 1 - DIFFERENCE)):
        step = DIFFERENCE * np.eye(len(point))[i]
        above, below = objective.residuals(np.stack([point + step, point - step]))
        assert at.jacobian[:, i] == pytest.approx((above - below) / (2 * DIFFERENCE), abs=1e-9)


def test_derivatives_at_the_walls_are_one_sided(made, calibration):
    """A healthy actuator has most of its faults there."""
    objective = Objective(made(TRUTH), calibration)
    point = objective.encode(fault_vector({"friction": 1.0, "gain": 0.5}))
    at = objective.linearise(point)
    walls = [0, 1, 2, 3, 4]
    for i in walls:
        inwards = -1.0 if point[i] == 1.0 else 1.0
        step = inwards * DIFFERENCE * np.eye(len(point))[i]
        beside, here = objective.residuals(np.stack([point + step, point]))
        assert at.jacobian[:, i] == pytest.approx(
            (beside - here) / (inwards * DIFFERENCE), abs=1e-9
        )
        assert np.any(at.jacobian[:, i])


def test_linearisation_evaluates_as_often_as_it_says(made, calibration, monkeypatch):
    objective = Objective(made(TRUTH), calibration)
    counted = []
    respond = MonitorModel.respond

    def counting(model, window, faults, *others):
        counted.append(len(np.atleast_2d(faults)))
        return respond(model, window, faults, *others)

    monkeypatch.setattr(MonitorModel, "respond", counting)
    objective.linearise(objective.healthy)
    assert sum(counted) == objective.linearisation_evaluations
