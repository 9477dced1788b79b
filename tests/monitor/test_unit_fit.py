# SPDX-License-Identifier: Apache-2.0
"""Fit of a unit to its healthy windows, with one command or several."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike

from ema_core.commands import THESIS_CHIRP
from ema_core.faults import healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.model.deviations import NAMES, Deviations, unit_priors
from ema_monitor.model.monitor_model import FORMS, MonitorModel
from ema_monitor.windows.band import band_limited, rms

from .windows import answered, changed, window_from

PARAMETERS = ActuatorParameters()
H = 1e-4
T = H * np.arange(5001)
CHIRP = np.concatenate([[0.0], THESIS_CHIRP.sample(H)])
SINE = 5e-3 * np.sin(2 * np.pi * 7.0 * T)
# A ramp back and forth with dwells, at a tenth of the highest speed.
RAMP = np.interp(T, [0.0, 0.05, 0.2, 0.25, 0.4, 0.5], [0.0, 0.0, 0.03, 0.03, 0.0, 0.0])

# Each about two sigma of the expected deviation of a unit.
UNITS = {
    "load_torque": 0.01,
    "viscous_friction": 0.8,
    "inertia": 0.1,
    "friction": -0.1,
    "stribeck_speed": 4.0,
    "loop_delay": 2e-5,
    "backlash": 0.05,
    "loop_gain": 0.04,
    "speed_loop": -0.06,
    "turns_b": -0.03,
    "eccentricity_cos": 0.04,
    "current_offset": 0.1,
    "speed_offset": 0.5,
    "speed_gain": 0.005,
    "current_delay": 1e-4,
    "speed_delay": 5e-5,
}


def moved_by(model, command, noise: ArrayLike = 0.0):
    """Return the window of a healthy model under a command, with the position from its speed."""
    window = window_from(command)
    [current], [speed] = model.respond(window, healthy_faults())
    position = PARAMETERS.tau * H * np.cumsum(np.append(0.0, speed))
    return changed(answered(window, current + np.asarray(noise), speed), position=position)


def made_by(unit, command, sigma=0.01, seed=0):
    """Return the window of a unit under a command, with noise of the current."""
    noise = np.random.default_rng(seed).normal(0.0, sigma, len(command) - 1)
    return moved_by(MonitorModel(PARAMETERS, unit=unit), command, noise)


def missed(calibration, window):
    """Return the errors of the calibrated healthy model in current and speed."""
    response = calibration.model().respond(window, healthy_faults(), window.play or 0.0)
    expected = calibration.expect(response, window)
    return np.stack(
        [window.current - expected.current[0], window.telemetry.speed[1:] - expected.speed[0]]
    )


def sigma_of(calibration, name):
    index = NAMES.index(name)
    return np.sqrt(calibration.unit_covariance[index, index])


@pytest.fixture(scope="module")
def of_several(description):
    unit = Deviations(lift=0.15, friction=0.06, inertia=-0.05, stribeck_speed=3.0)
    commands = (CHIRP, CHIRP, SINE, RAMP, SINE)
    windows = [made_by(unit, command, 0.02, seed) for seed, command in enumerate(commands)]
    return unit, windows, calibrate_model(windows, description)


@pytest.mark.parametrize("name", UNITS)
def test_deviation_of_a_unit_is_identified(description, name):
    """Its error is within the reported sigma, with windows of three commands.

    If a deviation is not worth fitting, sigma includes the omitted deviation and the prior.
    """
    unit = Deviations(lift=0.125, **{name: UNITS[name]})
    windows = [made_by(unit, command) for command in (CHIRP, SINE, RAMP)]
    calibration = calibrate_model(windows, description)
    prior = next(prior for prior in unit_priors(PARAMETERS, 0.03) if prior.name == name)
    sigma = sigma_of(calibration, name)
    value = getattr(calibration.unit, name)
    assert abs(value - UNITS[name]) < 3.0 * sigma
    left_out = 0.0 if value else UNITS[name]
    assert sigma <= 1.001 * np.hypot(prior.sigma, left_out)
    # The corrections contain only noise in the band.
    assert calibration.model_rms < 0.01


def test_several_commands_give_one_unit(of_several):
    unit, windows, calibration = of_several
    assert calibration.windows == 5
    for name in ("lift", "friction", "inertia", "stribeck_speed"):
        error = getattr(calibration.unit, name) - getattr(unit, name)
        assert abs(error) < 3.0 * sigma_of(calibration, name), name
    # Only the first command has a correction.
    assert np.array_equal(calibration.command, windows[0].command)
    knows = [calibration.reference(window).knows_command for window in windows]
    assert knows == [True, True, False, False, False]
    for window in windows:
        assert rms(missed(calibration, window)[0]) < 0.025


def test_second_command_determines_what_the_first_leaves_open(of_several, description):
    """A ramp travels further, and at constant speed."""
    _, windows, calibration = of_several
    chirp_alone = calibrate_model(windows[:2], description)
    for name in ("load_stiffness", "speed_gain"):
        assert sigma_of(calibration, name) < 0.9 * sigma_of(chirp_alone, name), name


def test_deviation_that_the_windows_do_not_show_keeps_its_prior(description):
    """A ramp of one speed does not separate viscous from dry friction and hardly shows play."""
    calibration = calibrate_model([made_by(Deviations(lift=0.125), RAMP)], description)
    priors = {prior.name: prior for prior in unit_priors(PARAMETERS, 0.03)}
    for name in ("backlash", "viscous_friction"):
        assert sigma_of(calibration, name) > 0.5 * priors[name].sigma, name
    for name, prior in priors.items():
        assert abs(getattr(calibration.unit, name) - prior.expected) < prior.sigma, name
        assert sigma_of(calibration, name) <= 1.001 * prior.sigma, name


def test_fit_at_a_bound_is_refused_with_name_and_value(description):
    """The description belongs to another actuator, whose friction is three times as high."""
    window = moved_by(MonitorModel(PARAMETERS.replace({"f_sm": 3.0 * PARAMETERS.f_sm})), CHIRP)
    with pytest.raises(ValueError, match="drives friction of the unit to its bound 1: ") as error:
        calibrate_model([window], description)
    message = str(error.value)
    assert "expected about 0 ± 0.1" in message
    assert "do the parameters belong to this actuator" in message
    assert "the units and signs of the columns right?" in message


@pytest.mark.parametrize(("name", "scale"), [("J_m", 5.0), ("f_sm", 7.0)])
def test_description_of_another_actuator_is_refused(description, name, scale):
    """It is refused before any fit if the current exceeds what units deviate by."""
    p = PARAMETERS.replace({name: scale * getattr(PARAMETERS, name)})
    with pytest.raises(
        ValueError, match=r"current is [12]\.\d+ times what the model expects: is its unit, or"
    ):
        calibrate_model([moved_by(MonitorModel(p), CHIRP)], description)


def test_example_values_left_in_a_description_are_named(description):
    """Only torque constant, inertia and limits of the actual motor were entered."""
    p = PARAMETERS
    strong = p.replace({"J_m": 10.0 * p.J_m, "k_t": 10.0 * p.k_t, "k_e": 10.0 * p.k_e})
    window = made_by(Deviations(), CHIRP)
    half = replace(description, parameters=strong)
    with pytest.raises(ValueError, match="still have the values of the built-in example") as error:
        calibrate_model([window], half)
    named = str(error.value).partition("the built-in example: ")[2]
    assert {"R_s = 2.13", "GAP = 0.05"} <= set(named.split(", "))
    assert not any(name in named for name in ("J_m", "k_t", "omega_c"))


@pytest.mark.parametrize(
    ("column", "factor", "message"),
    [
        ("current", -1.0, r"is -1\.\d+ times .*: is its sign reversed?"),
        ("speed", 30.0 / np.pi, r"is 9\.\d+ times what the model expects: is it in rpm?"),
        ("position", 180.0 / np.pi, "is it in degrees?"),
        (
            "current",
            -1000.0,
            "is its sign reversed, and are these thousandths read as whole units?",
        ),
        ("speed", PARAMETERS.tau, "was the gear ratio applied twice, or not at all?"),
        ("speed", 4.0, "is its unit, or the gear ratio, right?"),
        ("current", 0.0, r"little to do with .* \(correlation 0.00\): is it another column?"),
    ],
)
def test_wrong_column_is_refused_with_the_mistake(description, column, factor, message):
    window = made_by(Deviations(lift=0.125), CHIRP)
    wrong = changed(window, **{column: factor * getattr(window.telemetry, column)})
    words = rf"healthy actuator as described: the {column} .*{message.removesuffix('?')}[?]$"
    with pytest.raises(ValueError, match=words):
        calibrate_model([wrong], description)


@pytest.mark.parametrize("windows", [1, 2])
def test_equal_windows_are_fitted_exactly_and_show_no_scatter(
    healthy_windows, description, windows
):
    window = healthy_windows[1]
    calibration = calibrate_model(windows * [window], description)
    assert missed(calibration, window) == pytest.approx(0.0, abs=1e-11)
    assert calibration.windows == windows
    assert np.isnan([calibration.healthy_rms, calibration.healthy_speed_rms]).all()


def test_structure_of_the_reference_actuator_is_nominal(calibration):
    """Its lift is the mean ripple of the idle phase, regulated within a band of 0.5 A."""
    assert calibration.unit.lift == pytest.approx(0.13, abs=0.01)
    assert 1 + calibration.unit.friction == pytest.approx(1.0, abs=0.01)
    assert 1 + calibration.unit.inertia == pytest.approx(1.0, abs=0.01)


# In the last case, the drive also has another torque constant in its scale, which changes the gain
# of the loop.
@pytest.mark.slow
@pytest.mark.parametrize(
    "scales",
    [
        {
            "k_e": 0.96,
            "R_s": 1.05,
            "L_s": 0.95,
            "f_sm": 1.05,
            "f_su": 0.97,
            "J_m": 1.04,
            "J_u": 1.04,
        },
        {
            "k_e": 0.95,
            "k_t": 0.95,
            "L_s": 1.05,
            "f_sm": 0.95,
            "f_su": 0.95,
            "J_m": 1.05,
            "C_u": 0.95,
        },
    ],
)
def test_unit_off_its_data_sheet_shows_friction_and_inertia_over_torque_constant(
    stirred_window, description, scales
):
    plant = PARAMETERS.replace({n: s * getattr(PARAMETERS, n) for n, s in scales.items()})
    calibration = calibrate_model([stirred_window({}, n, plant) for n in range(2)], description)

    def over_torque_constant(*names):
        ratio = sum(getattr(plant, n) for n in names) / sum(getattr(PARAMETERS, n) for n in names)
        return ratio / scales["k_e"]

    # A nominal actuator has errors of 0.4 %; 5 % of loop gain or viscous friction add the rest.
    friction, inertia = over_torque_constant("f_sm", "f_su"), over_torque_constant("J_m", "J_u")
    assert 1 + calibration.unit.friction == pytest.approx(friction, rel=0.015)
    assert 1 + calibration.unit.inertia == pytest.approx(inertia, rel=0.015)


@pytest.mark.parametrize(("form", "structural"), [("source", True), ("fast", False)])
def test_model_can_be_calibrated_by_corrections_alone(
    healthy_windows, description, calibration, form, structural
):
    """As in the thesis, the corrections replace the fit by lift and friction."""
    window = healthy_windows[0]
    added = calibrate_model([window], description, form, structural=structural)
    assert added.unit == Deviations()
    assert missed(added, window) == pytest.approx(0.0, abs=1e-11)
    assert rms(added.correction) > max(0.05, 1.2 * rms(calibration.correction))


@pytest.mark.parametrize("windows", [2, 8])
def test_healthy_rms_is_that_of_another_window(description, windows):
    sigma = 0.3
    noisy = [made_by(Deviations(lift=0.13), CHIRP, sigma, seed) for seed in range(windows)]
    calibration = calibrate_model(noisy, description)
    alone = rms(band_limited(np.random.default_rng(99).normal(0.0, sigma, 200_000), H))
    # A further window also differs by the remaining noise in the mean of n windows. A window has
    # about 5000 / 15 independent values: 4 % for two windows if one is independent.
    assert calibration.healthy_rms == pytest.approx(alone * np.sqrt(1.0 + 1.0 / windows), rel=0.12)
    # The speed is the speed of the model, always the same.
    assert np.isnan(calibration.healthy_speed_rms)


def test_model_starts_at_the_position_in_the_play_of_the_window(healthy_windows, description):
    """If the position is unknown, the model starts at the centre of its play."""
    window = healthy_windows[0]
    unknown = calibrate_model([replace(window, play=None)], description)
    centred = calibrate_model([replace(window, play=0.0)], description)
    assert unknown.calibration_id == centred.calibration_id
    assert unknown.calibration_id != calibrate_model([window], description).calibration_id


@pytest.mark.parametrize("period", [1.25e-4, 2.5e-4, 1e-5])
def test_step_divides_the_sample_period(description, period):
    """8 kHz is no multiple of the form's 20 us; the longest fitting step below is used."""
    steps = np.ceil(period / FORMS["fast"] - 1e-6)
    command = 2e-3 * (1.0 - np.abs(np.linspace(-1.0, 1.0, 40)))
    window = changed(window_from(command, sample_period=period), position=command)
    response = MonitorModel(PARAMETERS, dt=period / steps).respond(window, healthy_faults())
    window = answered(window, response.current[0], response.speed[0])
    calibration = calibrate_model([window], replace(description, sample_period=period))
    assert calibration.dt == pytest.approx(period / steps)


def test_calibration_without_windows_is_refused(description):
    with pytest.raises(ValueError, match="at least one healthy window"):
        calibrate_model([], description)


def test_windows_of_another_sample_period_are_refused(healthy_windows, description):
    resampled = changed(healthy_windows[1], sample_period=2e-4)
    with pytest.raises(ValueError, match=r"window 1: .* 0\.0002 s, in the first window 0\.0001 s"):
        calibrate_model([healthy_windows[0], resampled], description)


def test_window_without_excitation_gives_no_calibration(description):
    with pytest.raises(ValueError, match=r"window 0: no excitation"):
        calibrate_model([window_from(np.full(11, 5e-6))], description)
