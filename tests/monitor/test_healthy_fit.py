"""Calibrating: what healthy windows tell of a unit."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import LEAST_SCATTER, Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.model.deviations import NAMES, Deviations, unit_priors
from ema_monitor.model.monitor_model import FORMS, FORMS_OF_DRIVES, MonitorModel
from ema_monitor.windows.band import band_limited, rms
from ema_monitor.windows.window import Window

from .windows import answered, changed, window_from

PARAMETERS = ActuatorParameters()
H = 1e-4


def expected(calibration: Calibration, window: Window):
    """Current and speed of the calibrated healthy model."""
    response = calibration.model().respond(window, healthy_faults(), window.play or 0.0)
    return np.concatenate(calibration.expect(response, window))


def seen(window: Window):
    return np.stack([window.current, window.telemetry.speed[1:]])


def scaled(friction: float, inertia: float, parameters=PARAMETERS, **others) -> ActuatorParameters:
    scales = {"f_sm": friction, "f_su": friction, "J_m": inertia, "J_u": inertia, **others}
    return parameters.replace({n: scale * getattr(parameters, n) for n, scale in scales.items()})


def made_by(parameters: ActuatorParameters, window: Window, lift=0.0, sigma=0.0, seed=0) -> Window:
    """What the model of a unit answers in a window, with noise of the current."""
    response = MonitorModel(parameters, unit=Deviations(lift=lift)).respond(
        window, healthy_faults(), window.play or 0.0
    )
    current, speed = response.current[0], response.speed[0]
    noise = np.random.default_rng(seed).normal(0.0, sigma, len(current))
    return answered(window, current + noise, speed)


@pytest.mark.parametrize("form", FORMS_OF_DRIVES["six_step"])
def test_calibrated_model_is_exact_on_the_window_it_was_made_from(
    healthy_windows, description, form
):
    window = healthy_windows[1]
    calibration = calibrate_model([window], description, form)
    # The residual is added again to what it was taken from: rounding of amperes and 100 rad/s.
    assert expected(calibration, window) == pytest.approx(seen(window), abs=1e-11)
    assert calibration.windows == 1
    assert np.isnan(calibration.healthy_rms)
    assert np.isnan(calibration.healthy_speed_rms)


@pytest.mark.parametrize(
    ("lift", "friction", "inertia"), [(0.2, 1.04, 0.97), (0.05, 0.9, 1.1), (0.13, 1.0, 1.0)]
)
def test_structure_of_a_unit_is_found(healthy_windows, description, lift, friction, inertia):
    """To what the prior pulls, which is worth a hundredth of an ampere."""
    window = made_by(scaled(friction, inertia), healthy_windows[0], lift)
    calibration = calibrate_model([window], description)
    assert calibration.unit.lift == pytest.approx(lift, rel=0.01)
    assert 1 + calibration.unit.friction == pytest.approx(friction, rel=3e-3)
    assert 1 + calibration.unit.inertia == pytest.approx(inertia, rel=3e-3)
    # What is left for the corrections, as against some 2.5 A and 90 rad/s.
    assert rms(calibration.correction) < 5e-3
    assert rms(calibration.speed_correction) < 0.05


def test_structure_of_the_reference_actuator_is_nominal(calibration):
    """Its lift is the mean ripple of the idle phase, regulated within a band of 0.5 A."""
    assert calibration.unit.lift == pytest.approx(0.13, abs=0.01)
    assert 1 + calibration.unit.friction == pytest.approx(1.0, abs=0.01)
    assert 1 + calibration.unit.inertia == pytest.approx(1.0, abs=0.01)


# Torque constant, resistance, inductance, friction, inertia and viscous friction of a unit. In the
# last one the drive has another torque constant in its scale, too, which changes the loop's gain.
UNITS = [
    {"k_e": 0.96, "R_s": 1.05, "L_s": 0.95, "f_sm": 1.05, "f_su": 0.97, "J_m": 1.04, "J_u": 1.04},
    {"k_e": 1.05, "R_s": 0.95, "L_s": 1.05, "f_sm": 1.05, "f_su": 1.05, "J_m": 0.96, "C_m": 1.05},
    {"k_e": 0.95, "k_t": 0.95, "L_s": 1.05, "f_sm": 0.95, "f_su": 0.95, "J_m": 1.05, "C_u": 0.95},
]


@pytest.mark.slow
@pytest.mark.parametrize("unit", range(len(UNITS)))
def test_unit_off_its_data_sheet_shows_friction_and_inertia_over_torque_constant(
    stirred_window, description, unit
):
    scales = UNITS[unit]
    plant = PARAMETERS.replace({n: s * getattr(PARAMETERS, n) for n, s in scales.items()})
    windows = [stirred_window({}, seed, plant) for seed in range(10 * unit, 10 * unit + 3)]
    calibration = calibrate_model(windows, description)

    def over_torque_constant(*names):
        ratio = sum(getattr(plant, n) for n in names) / sum(getattr(PARAMETERS, n) for n in names)
        return ratio / scales["k_e"]

    # 0.4 % are wrong on a nominal actuator; 5 % of loop gain or viscous friction add the rest.
    assert 1 + calibration.unit.friction == pytest.approx(
        over_torque_constant("f_sm", "f_su"), rel=0.015
    )
    assert 1 + calibration.unit.inertia == pytest.approx(
        over_torque_constant("J_m", "J_u"), rel=0.015
    )


def test_what_the_windows_do_not_tell_stays_nominal(description):
    """At constant speed any inertia does; only friction and lift are seen."""
    p, rate, n = scaled(1.04, 1.3), 0.3, 1000
    omega = rate / p.tau
    torque = (p.C_m + p.C_u) * omega + p.f_ratio * (p.f_sm + p.f_su)
    # The position lags by what makes the loops ask for this speed and current from the start, and
    # by the half step that the model reads its command late.
    lag = (omega + torque / p.k_e * p.k_t / p.GAP) / p.G_prop + rate * FORMS["fast"] / 2
    still = window_from(rate * H * np.arange(n + 1), speed=omega, position=-lag, play=1.0)
    window = made_by(p, still, 0.2)
    position = window.command - lag
    window = replace(window, telemetry=replace(window.telemetry, position=position))
    assert window.telemetry.speed == pytest.approx(omega, rel=1e-9)
    calibration = calibrate_model([window], description)
    priors = {one.name: one for one in unit_priors(PARAMETERS, window.excitation)}
    index = NAMES.index("inertia")
    assert calibration.unit.inertia == pytest.approx(0.0, abs=1e-3)
    assert calibration.unit_covariance[index, index] == pytest.approx(
        priors["inertia"].sigma ** 2, rel=1e-2
    )
    # Friction, load and offset share what a constant current tells, as far as each may be expected.
    for name, prior in priors.items():
        assert abs(getattr(calibration.unit, name) - prior.expected) < 3.5 * prior.sigma, name
    assert rms(calibration.correction) < 0.01
    assert calibration.unit.friction > 0.005


def test_source_form_has_corrections_only(healthy_windows, description):
    """The thesis calibrates by addition alone."""
    calibration = calibrate_model(healthy_windows[:1], description, "source")
    assert calibration.unit.lift == 0.0
    assert (1 + calibration.unit.friction, 1 + calibration.unit.inertia) == (1.0, 1.0)
    assert rms(calibration.correction) > 0.05


def test_fast_form_can_be_calibrated_by_corrections_alone(healthy_windows, description):
    window = healthy_windows[0]
    calibration = calibrate_model([window], description, structural=False)
    assert calibration.unit.lift == 0.0
    assert (1 + calibration.unit.friction, 1 + calibration.unit.inertia) == (1.0, 1.0)
    assert expected(calibration, window) == pytest.approx(seen(window), abs=1e-11)
    # What the fit explains by lift and friction is left to the corrections.
    fitted = calibrate_model([window], description)
    assert rms(calibration.correction) > 1.2 * rms(fitted.correction)


@pytest.mark.parametrize("windows", [2, 8])
def test_healthy_rms_is_that_of_another_window(healthy_windows, description, windows):
    sigma = 0.3
    made = [made_by(PARAMETERS, healthy_windows[0], 0.13, sigma, seed) for seed in range(windows)]
    calibration = calibrate_model(made, description)
    alone = rms(band_limited(np.random.default_rng(99).normal(0.0, sigma, 200_000), H))
    # Against the mean of n windows another one also shows what is left of the noise in that mean.
    # Some 5000 / 15 independent values a window: 4 % for two windows, of which one is independent.
    assert calibration.healthy_rms == pytest.approx(alone * np.sqrt(1.0 + 1.0 / windows), rel=0.12)
    # The speed is that of the model, always the same.
    assert np.isnan(calibration.healthy_speed_rms)


def test_equal_windows_tell_no_scatter(healthy_windows, description):
    calibration = calibrate_model([healthy_windows[0]] * 3, description)
    assert np.isnan(calibration.healthy_rms)
    assert calibration.windows == 3
    assert LEAST_SCATTER > 0.0


def test_model_starts_where_the_window_says_the_motor_stands(healthy_windows, description):
    """Without that knowledge it is centred in its play."""
    window = healthy_windows[0]
    one = calibrate_model([replace(window, play=None)], description)
    other = calibrate_model([replace(window, play=0.0)], description)
    assert one.calibration_id == other.calibration_id
    assert one.calibration_id != calibrate_model([window], description).calibration_id


@pytest.mark.parametrize("period", [1.25e-4, 2.5e-4, 1e-5, 1e-4])
def test_step_divides_the_sample_period(description, period):
    """8 kHz is no multiple of the form's 20 us; the longest step below it that fits is taken."""
    n = 40
    command = np.concatenate([np.linspace(0, 2e-3, n // 2), np.linspace(2e-3, 0, n // 2)])
    rows = (np.zeros(n), command, np.zeros(n))
    window = Window(Telemetry(0, period, 1, command, *rows), 0.0)
    dt = period / np.ceil(period / FORMS["fast"] - 1e-6)
    response = MonitorModel(PARAMETERS, dt=float(dt)).respond(window, healthy_faults())
    window = answered(window, response.current[0], response.speed[0])
    calibration = calibrate_model([window], replace(description, sample_period=period))
    steps = period / calibration.dt
    assert steps == pytest.approx(round(steps))
    assert calibration.dt <= FORMS["fast"] * (1 + 1e-9) < period / (round(steps) - 1 or 1e-9)


def test_nothing_to_calibrate_on_is_refused(description):
    with pytest.raises(ValueError, match="at least one healthy window"):
        calibrate_model([], description)


def test_windows_of_another_sample_period_are_refused(healthy_windows, description):
    other = changed(healthy_windows[1], sample_period=2e-4)
    with pytest.raises(ValueError, match=r"window 1: .* 0\.0002 s, the first of 0\.0001 s"):
        calibrate_model([healthy_windows[0], other], description)


def test_window_without_excitation_is_no_calibration(description):
    columns = (np.full(11, value) for value in (5e-6, 0.1, 0.0, 0.0))
    window = Window(Telemetry(0, H, 0, *columns), 0.0)
    with pytest.raises(ValueError, match=r"window 0: no excitation"):
        calibrate_model([window], description)
