# SPDX-License-Identifier: Apache-2.0
"""Each deviation of a unit changes the model by its equation, and zeros change nothing."""

import numpy as np
import pytest

from ema_core.causes import COPPER
from ema_core.commands import THESIS_CHIRP
from ema_core.faults import fault_vector, healthy_faults, random_faults
from ema_core.parameters import ActuatorParameters
from ema_core.simd import LANES
from ema_monitor.model.deviations import (
    HIDDEN_CAUSES,
    N_DEVIATIONS,
    NAMES,
    Deviations,
    hidden_causes,
    sensed,
    unit_priors,
)
from ema_monitor.model.monitor_model import FORMS, MonitorModel, Response
from ema_monitor.windows.band import rms

from .windows import window_from

PARAMETERS = ActuatorParameters()
H = 1e-4
CHIRP = window_from(np.concatenate([[0.0], THESIS_CHIRP.sample(H)]))


@pytest.mark.parametrize("form", FORMS)
def test_zero_deviations_leave_results_bit_identical(form):
    rng = np.random.default_rng(1)
    m = LANES + 3
    faults = np.stack([random_faults(rng) for _ in range(m)])
    window = window_from(CHIRP.command[:500])
    plain = MonitorModel(PARAMETERS, form).respond(window, faults, 0.4)
    zero = MonitorModel(PARAMETERS, form, unit=Deviations()).respond(
        window, faults, 0.4, deviations=np.zeros((m, N_DEVIATIONS))
    )
    for actual, expected in zip(plain, zero, strict=True):
        assert actual.tobytes() == expected.tobytes()


# Actuator parameters that a deviation represents, with their changed values. Other deviations are
# compared with the twin.
@pytest.mark.parametrize(
    ("name", "value", "parameters", "factor"),
    [
        ("torque_constant", -0.1, ("k_e", "G_M"), 0.9),
        ("winding_temperature", 80.0, ("R_s",), 1.0 + 0.00393 * 80.0),
        ("supply_voltage", -0.3, ("V_max",), 0.7),
        ("viscous_friction", 2.0, ("C_m", "C_u"), 3.0),
        ("inertia", 0.25, ("J_m", "J_u"), 1.25),
        ("friction", -0.2, ("f_sm", "f_su"), 0.8),
        ("backlash", 0.6, ("BLK",), 1.6),
        ("loop_gain", 0.05, ("G_prop",), 1.05),
        ("speed_loop", -0.08, ("GAP",), 0.92),
    ],
)
def test_deviation_of_a_field_oriented_drive_equals_a_changed_parameter(
    name, value, parameters, factor
):
    """The gains of the current loop, which follow the nominal resistance, cause 0.02 A."""
    p = PARAMETERS.replace({"V_max": 8.0})
    changed_parameters = p.replace({n: factor * getattr(p, n) for n in parameters})
    faults = {"friction": 0.2, "backlash": 0.01, "short_circuit_b": 0.2, "gain": 0.6}
    window = window_from(CHIRP.command[:600])
    plain, deviating, replaced = (
        MonitorModel(parameters_of, "field_oriented", unit=unit)
        .respond(window, fault_vector(faults))
        .current
        for parameters_of, unit in (
            (p, None),
            (p, Deviations(**{name: value})),
            (changed_parameters, None),
        )
    )
    assert rms(deviating - replaced) < 0.02
    assert not np.array_equal(deviating, plain)


def test_delay_of_a_sensor_may_be_any_fraction_of_a_sample_and_negative():
    """Values are interpolated linearly; an early sensor repeats its last value."""
    rows = np.stack([np.arange(20.0) ** 2, np.arange(20.0)])
    for samples in (0.25, 2.5, -0.5, -3.0):
        sensors = np.zeros((2, 6))
        sensors[:, 4:] = samples * H
        seen, _ = sensed((rows, rows), sensors, H)
        t = np.arange(20.0) - samples
        inside = (t >= 0.0) & (t <= 19.0)
        assert seen[0, inside] == pytest.approx(np.interp(t, np.arange(20.0), rows[0])[inside])
        assert seen[1] == pytest.approx(np.maximum(t, 0.0))


def test_corrections_apply_to_the_sensor_readings():
    unit = Deviations(current_gain=0.1, current_delay=2e-4, speed_offset=0.5)
    rng = np.random.default_rng(3)
    corrections = Response(*rng.normal(size=(2, len(CHIRP))))
    model = MonitorModel(PARAMETERS, unit=unit)
    plain = model.respond(CHIRP, healthy_faults())
    corrected = model.respond(CHIRP, healthy_faults(), corrections=corrections)
    for actual, original, added in zip(corrected, plain, corrections, strict=True):
        assert actual == pytest.approx(original + added, rel=1e-12, abs=1e-12)


def test_individuals_deviate_from_the_unit_independently():
    """This holds also within a group of lanes."""
    rng = np.random.default_rng(5)
    sigma = {unit_prior.name: unit_prior.sigma for unit_prior in unit_priors(PARAMETERS, 0.01)}
    rows = np.array([sigma.get(name, 0.0) for name in NAMES]) * rng.normal(
        size=(LANES + 1, N_DEVIATIONS)
    )
    unit = Deviations.of(rows[0])
    faults = np.stack([random_faults(rng) for _ in rows])
    window = window_from(CHIRP.command[:400])
    together = MonitorModel(PARAMETERS, unit=unit).respond(window, faults, deviations=rows)
    for i in range(len(rows)):
        alone = MonitorModel(PARAMETERS, unit=Deviations.of(np.add(unit, rows[i])))
        response = alone.respond(window, faults[i])
        assert together.current[i] == pytest.approx(response.current[0], abs=1e-9, rel=0)
        assert together.speed[i] == pytest.approx(response.speed[0], abs=1e-7, rel=0)


def test_hidden_causes_are_the_last_components_and_can_be_simulated():
    assert (
        tuple(hidden_cause.name for hidden_cause in hidden_causes(PARAMETERS, 0.01))
        == HIDDEN_CAUSES
    )
    for hidden_cause in hidden_causes(PARAMETERS, 0.01):
        assert (
            hidden_cause.lowest
            < hidden_cause.expected
            < hidden_cause.reach
            <= hidden_cause.cause.highest
        )
        assert hidden_cause.sigma < hidden_cause.reach
        if hidden_cause.cause.unit == "-":
            assert hidden_cause.cause.lowest <= hidden_cause.lowest
        if hidden_cause.name == "winding_temperature":
            assert 1.0 + COPPER * hidden_cause.lowest > 0.0


def test_loads_and_sensors_scale_with_the_actuator():
    p = PARAMETERS
    double = p.replace({"T_max": 2 * p.T_max, "I_max": 2 * p.I_max, "omega_max": 2 * p.omega_max})
    names = ("load_torque", "load_stiffness", "current_offset", "speed_offset")
    for priors in (hidden_causes, unit_priors):
        for prior, doubled in zip(priors(p, 0.01), priors(double, 0.01), strict=True):
            scale = 2.0 if prior.name in names else 1.0
            assert doubled.sigma == pytest.approx(scale * prior.sigma)
            assert doubled.reach == pytest.approx(scale * prior.reach)
        stiffness = [
            prior.sigma
            for travel in (0.01, 0.02)
            for prior in priors(p, travel)
            if prior.name == "load_stiffness"
        ]
        assert stiffness[0] == pytest.approx(2 * stiffness[1])


def test_deviations_that_no_healthy_test_shows_are_not_fitted():
    """Of torque constant, friction, inertia and current gain, only the ratios are visible."""
    fitted = {unit_prior.name for unit_prior in unit_priors(PARAMETERS, 0.01)}
    assert set(NAMES) - fitted == {
        "torque_constant",
        "winding_temperature",
        "supply_voltage",
        "current_gain",
    }
