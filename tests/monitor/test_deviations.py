"""Each deviation of a unit changes the model as its equation says, and zeros change nothing."""

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
FAULTS = {"friction": 0.2, "backlash": 0.01, "short_circuit_b": 0.2, "gain": 0.6}


def respond(deviations=None, faults=None, *, form="fast", parameters=PARAMETERS, window=CHIRP):
    model = MonitorModel(parameters, form, unit=Deviations(**deviations or {}))
    return model.respond(window, fault_vector(faults or {}), window.play or 0.0)


def check_same(one: Response, other: Response):
    """Sums and products in another order: 1e-16, of which the chirp makes some 1e-9."""
    assert one.current == pytest.approx(other.current, abs=1e-6, rel=0)
    assert one.speed == pytest.approx(other.speed, abs=1e-4, rel=0)


def steady(deviations, rate, parameters=PARAMETERS):
    """Current and speed at the end of a steady motion [A, rad/s]."""
    omega = rate / parameters.tau
    command = rate * H * np.arange(3001)
    window = window_from(command, speed=omega, position=-omega / parameters.G_prop)
    response = respond(deviations, parameters=parameters, window=window)
    return response.current[0, -1], response.speed[0, -1]


def friction_torque(omega):
    p = PARAMETERS
    return (p.C_m + p.C_u) * omega + np.sign(omega) * p.f_ratio * (p.f_sm + p.f_su)


@pytest.mark.parametrize("form", FORMS)
def test_zeros_change_no_bit(form):
    rng = np.random.default_rng(1)
    m = LANES + 3
    faults = np.stack([random_faults(rng) for _ in range(m)])
    window = window_from(CHIRP.command[:500])
    plain = MonitorModel(PARAMETERS, form).respond(window, faults, 0.4)
    zero = MonitorModel(PARAMETERS, form, unit=Deviations()).respond(
        window, faults, 0.4, deviations=np.zeros((m, N_DEVIATIONS))
    )
    for one, other in zip(plain, zero, strict=True):
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("name", [name for name in NAMES if name != "lift"])
def test_each_deviation_changes_the_response(name):
    """Of a motor that the voltage limits, so that resistance and supply show."""
    p = PARAMETERS.replace({"V_max": 8.0})
    values = dict(zip(NAMES, np.full(N_DEVIATIONS, 0.1), strict=True))
    values |= {"current_delay": 1e-4, "speed_delay": 1e-4, "winding_temperature": 50.0}
    plain, changed = (respond(unit, FAULTS, parameters=p) for unit in (None, {name: values[name]}))
    of_speed = name.startswith("speed_") and name != "speed_loop"
    rows = (plain.speed, changed.speed) if of_speed else (plain.current, changed.current)
    assert rms(rows[1] - rows[0]) > 1e-4 * rms(rows[0])


# Parameters of the actuator that a deviation stands for, and what it makes of them.
AS_PARAMETERS = [
    ("torque_constant", -0.1, ("k_e", "G_M"), 0.9),
    ("winding_temperature", 80.0, ("R_s",), 1.0 + 0.00393 * 80.0),
    ("supply_voltage", -0.3, ("V_max",), 0.7),
    ("viscous_friction", 2.0, ("C_m", "C_u"), 3.0),
    ("inertia", 0.25, ("J_m", "J_u"), 1.25),
    ("friction", -0.2, ("f_sm", "f_su"), 0.8),
    ("backlash", 0.6, ("BLK",), 1.6),
    ("loop_gain", 0.05, ("G_prop",), 1.05),
    ("speed_loop", -0.08, ("GAP",), 0.92),
]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("name", "value", "parameters", "factor"), AS_PARAMETERS)
def test_deviation_of_a_parameter_is_another_parameter(name, value, parameters, factor, form):
    p = PARAMETERS.replace({"V_max": 20.0})
    other = p.replace({n: factor * getattr(p, n) for n in parameters})
    window = CHIRP if form == "fast" else window_from(CHIRP.command[:600])
    responses = [
        respond({name: value}, FAULTS, form=form, parameters=p, window=window),
        respond(None, FAULTS, form=form, parameters=other, window=window),
    ]
    if form == "fast":
        check_same(*responses)
    elif form == "field_oriented":
        # The gains of the current loop follow the nominal resistance, not that of the warm unit.
        assert rms(responses[0].current - responses[1].current) < 0.02
    else:
        # A rounding that moves one switching of the source form moves 0.07 A for a step of 1 us.
        assert rms(responses[0].current - responses[1].current) < 0.01


@pytest.mark.parametrize("phase", "abc")
def test_turns_of_a_phase_are_those_of_a_short_circuit(phase):
    check_same(
        respond({f"turns_{phase}": -0.12}, {"friction": 0.1}),
        respond(None, {"friction": 0.1, f"short_circuit_{phase}": 0.12}),
    )


@pytest.mark.parametrize(("zeta", "phase"), [(0.1, 0.2), (0.3, 0.9)])
def test_own_eccentricity_is_that_of_a_fault_at_its_angle(zeta, phase):
    phi = (2 * phase - 1) * np.pi
    own = {"eccentricity_cos": zeta * np.cos(phi), "eccentricity_sin": zeta * np.sin(phi)}
    check_same(
        respond(own, {"gain": 0.6}),
        respond(None, {"gain": 0.6, "eccentricity": zeta, "eccentricity_phase": phase}),
    )


def test_own_eccentricity_is_added_as_a_vector():
    """Against a fault of the same size in the other direction nothing is left."""
    faults = {"eccentricity": 0.2, "eccentricity_phase": 0.75}
    check_same(respond({"eccentricity_sin": -0.2}, faults), respond())
    doubled = {"eccentricity": 0.4, "eccentricity_phase": 0.75}
    check_same(respond({"eccentricity_sin": 0.2}, faults), respond(None, doubled))


@pytest.mark.parametrize("rate", [0.3, -0.3])
@pytest.mark.parametrize("torque", [0.02, -0.03])
def test_load_torque_acts_against_positive_motion(torque, rate):
    current, speed = steady({"load_torque": torque}, rate)
    assert speed == pytest.approx(rate / PARAMETERS.tau, rel=1e-5)
    expected = (friction_torque(rate / PARAMETERS.tau) + torque) / PARAMETERS.k_e
    assert current == pytest.approx(expected, rel=1e-5)


def test_load_stiffness_is_torque_over_the_angle_of_the_user_shaft():
    p, rate, stiffness = PARAMETERS, 0.3, 0.5
    current, speed = steady({"load_stiffness": stiffness}, rate)
    # The shaft lags by what makes the loops ask for this speed and current.
    lag = (speed + current * p.k_t / p.GAP) / p.G_prop
    torque = stiffness * (rate * 3000 * H - lag)
    plain = friction_torque(rate / p.tau) / p.k_e
    # The current is the mean of a sample, the torque that at its end: 1 in 6000.
    assert current - plain == pytest.approx(torque / p.k_e, rel=2e-3)


@pytest.mark.parametrize("share", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_stribeck_friction_is_a_quarter_of_its_rise_at_its_speed(share, sign):
    p, stribeck_speed = PARAMETERS, 20.0
    omega = sign * share * stribeck_speed
    current, _ = steady({"stribeck_speed": stribeck_speed}, omega * p.tau)
    rise = (1.0 - p.f_ratio) * (p.f_sm + p.f_su)
    more = sign * rise / (1.0 + share**2) ** 2
    expected = (friction_torque(omega) + more) / p.k_e
    # The current is the mean of a sample in which the motion is not quite steady yet.
    assert current == pytest.approx(expected, rel=1e-3)


def test_load_moves_a_motor_that_nothing_drives_once_it_exceeds_the_friction():
    """The ripple of the PWM takes its share of the static friction (M12)."""
    p = PARAMETERS
    held = p.f_sm + p.f_su - p.k_e * p.h_b
    still = window_from(np.zeros(200))
    below, above = (
        respond({"load_torque": factor * held}, window=still).speed for factor in (0.99, 1.01)
    )
    assert not np.any(below)
    assert np.min(above) < 0.0


@pytest.mark.parametrize("quantity", ["current", "speed"])
def test_sensors_show_gain_offset_and_age(quantity):
    true = respond(None, FAULTS)
    values = {"offset": 0.3, "gain": -0.04, "delay": 2e-4}
    shown = respond({f"{quantity}_{name}": value for name, value in values.items()}, FAULTS)
    [row] = getattr(true, quantity)
    # Two samples late; what was before the start is not known.
    late = np.concatenate([row[[0, 0]], row[:-2]])
    assert getattr(shown, quantity)[0] == pytest.approx(0.96 * late + 0.3, rel=1e-12, abs=1e-12)
    other = "speed" if quantity == "current" else "current"
    assert np.array_equal(getattr(shown, other), getattr(true, other))


def test_age_of_a_sensor_may_be_any_part_of_a_sample_and_negative():
    """By linear interpolation; what is early continues as it ends."""
    rows = np.stack([np.arange(20.0) ** 2, np.arange(20.0)])
    for samples in (0.25, 2.5, -0.5, -3.0):
        sensors = np.zeros((2, 6))
        sensors[:, 4:] = samples * H
        seen, _ = sensed((rows, rows), sensors, H)
        t = np.arange(20.0) - samples
        inside = (t >= 0.0) & (t <= 19.0)
        assert seen[0, inside] == pytest.approx(np.interp(t, np.arange(20.0), rows[0])[inside])
        assert seen[1] == pytest.approx(np.maximum(t, 0.0))


def test_corrections_are_of_what_the_sensors_show():
    unit = Deviations(current_gain=0.1, current_delay=2e-4, speed_offset=0.5)
    rng = np.random.default_rng(3)
    corrections = Response(*rng.normal(size=(2, len(CHIRP))))
    model = MonitorModel(PARAMETERS, unit=unit)
    plain = model.respond(CHIRP, healthy_faults())
    corrected = model.respond(CHIRP, healthy_faults(), corrections=corrections)
    for one, other, added in zip(corrected, plain, corrections, strict=True):
        assert one == pytest.approx(other + added, rel=1e-12, abs=1e-12)


def test_individuals_deviate_from_the_unit_each_for_itself():
    """Also where they share a group of lanes."""
    rng = np.random.default_rng(5)
    sigma = {one.name: one.sigma for one in unit_priors(PARAMETERS, 0.01)}
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


def test_hidden_causes_are_the_ends_of_the_vector_and_can_be_simulated():
    assert tuple(one.name for one in hidden_causes(PARAMETERS, 0.01)) == HIDDEN_CAUSES
    for one in hidden_causes(PARAMETERS, 0.01):
        assert one.lowest < one.expected < one.reach <= one.cause.highest
        assert one.sigma < one.reach
        if one.cause.unit == "-":
            assert one.cause.lowest <= one.lowest
        if one.name == "winding_temperature":
            assert 1.0 + COPPER * one.lowest > 0.0


def test_loads_and_sensors_scale_with_the_actuator():
    p = PARAMETERS
    double = p.replace({"T_max": 2 * p.T_max, "I_max": 2 * p.I_max, "omega_max": 2 * p.omega_max})
    names = ("load_torque", "load_stiffness", "current_offset", "speed_offset")
    for priors in (hidden_causes, unit_priors):
        for one, other in zip(priors(p, 0.01), priors(double, 0.01), strict=True):
            scale = 2.0 if one.name in names else 1.0
            assert other.sigma == pytest.approx(scale * one.sigma)
            assert other.reach == pytest.approx(scale * one.reach)
        stiffness = [
            one.sigma
            for travel in (0.01, 0.02)
            for one in priors(p, travel)
            if one.name == "load_stiffness"
        ]
        assert stiffness[0] == pytest.approx(2 * stiffness[1])


def test_what_no_healthy_test_shows_is_not_fitted():
    """Of torque constant, friction, inertia and current gain only the ratios show."""
    fitted = {one.name for one in unit_priors(PARAMETERS, 0.01)}
    assert set(NAMES) - fitted == {
        "torque_constant",
        "winding_temperature",
        "supply_voltage",
        "current_gain",
    }
