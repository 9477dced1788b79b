"""Static calibration: what the model misses on a healthy actuator."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.faults import healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.calibration import Calibration
from ema_monitor.healthy_fit import calibrate
from ema_monitor.model import FORMS, MonitorModel
from ema_monitor.residual import band_limited, rms
from ema_monitor.window import Window

PARAMETERS = ActuatorParameters()
H = 1e-4


def changed(window: Window, **columns) -> Window:
    return replace(window, telemetry=replace(window.telemetry, **columns))


def expected_current(calibration: Calibration, window: Window):
    modelled = calibration.model().respond(window, healthy_faults(), window.play or 0.0)
    return calibration.apply(modelled)[0]


@pytest.fixture
def synthetic(healthy_windows):
    """Window whose current is the healthy model's with a lift of 0.2 A and noise."""
    window = healthy_windows[0]
    current = MonitorModel(PARAMETERS).respond(window, healthy_faults(), window.play)[0]

    def make(sigma=0.0, seed=0) -> Window:
        noise = np.random.default_rng(seed).normal(0.0, sigma, len(current))
        measured = current + 0.2 * lift_shape(current, PARAMETERS) + noise
        return changed(window, current=np.append(window.telemetry.current[0], measured))

    return make


@pytest.mark.parametrize("form", FORMS)
def test_calibrated_model_is_exact_on_the_window_it_was_made_from(
    healthy_windows, description, form
):
    window = healthy_windows[1]
    calibration = calibrate([window], description, form)
    # The residual is added again to what it was taken from: rounding.
    assert expected_current(calibration, window) == pytest.approx(window.current, abs=1e-12)
    assert calibration.windows == 1
    assert np.isnan(calibration.healthy_rms)


@pytest.mark.parametrize("form", FORMS)
def test_residuals_average_to_zero(healthy_windows, description, form):
    windows = healthy_windows if form == "fast" else healthy_windows[:2]
    calibration = calibrate(windows, description, form)
    residuals = [w.current - expected_current(calibration, w) for w in windows]
    assert np.mean(residuals, axis=0) == pytest.approx(0.0, abs=1e-12)
    assert calibration.windows == len(windows)


def test_lift_is_fitted_for_the_fast_form_only(healthy_windows, description):
    # The mean ripple of the idle phase, regulated about zero within a band of 0.5 A.
    assert calibrate(healthy_windows[:1], description).lift == pytest.approx(0.13, abs=0.01)
    assert calibrate(healthy_windows[:1], description, "source").lift == 0.0


def test_lift_is_found_exactly(synthetic, description):
    calibration = calibrate([synthetic()], description)
    assert calibration.lift == pytest.approx(0.2, rel=1e-12)
    assert calibration.correction == pytest.approx(0.0, abs=1e-12)


def test_lift_has_the_sign_of_the_current_outside_the_band():
    h_b = PARAMETERS.h_b
    currents = np.array([-9.0, -h_b, -h_b / 4, 0.0, h_b / 2, h_b, 9.0])
    assert list(lift_shape(currents, PARAMETERS)) == [-1.0, -1.0, -0.25, 0.0, 0.5, 1.0, 1.0]


@pytest.mark.parametrize("windows", [2, 8])
def test_healthy_rms_is_that_of_another_window(synthetic, description, windows):
    sigma = 0.3
    made = [synthetic(sigma, seed) for seed in range(windows)]
    calibration = calibrate(made, description)
    alone = rms(band_limited(np.random.default_rng(99).normal(0.0, sigma, 200_000), H))
    # Against the mean of n windows another one also shows what is left of the noise in that mean.
    expected = alone * np.sqrt(1.0 + 1.0 / windows)
    # Some 5000 / 15 independent values a window: 4 % for two windows, of which one is independent.
    assert calibration.healthy_rms == pytest.approx(expected, rel=0.12)


def test_model_starts_where_the_window_says_the_motor_stands(healthy_windows, description):
    """Without that knowledge it is centred in its play."""
    window = healthy_windows[0]
    one = calibrate([replace(window, play=None)], description)
    other = calibrate([replace(window, play=0.0)], description)
    assert one.calibration_id == other.calibration_id
    assert one.calibration_id != calibrate([window], description).calibration_id


def test_calibration_fits_its_own_windows(calibration, healthy_windows, description):
    for window in healthy_windows:
        assert calibration.unit_mismatch(description) == ""
        assert calibration.shape_mismatch(window) == ""
        assert calibration.command_mismatch(window) == ""


def test_other_serial_number_is_a_mismatch(calibration):
    reason = calibration.unit_mismatch(ActuatorDescription(serial_number="SIM-0002"))
    assert "'SIM-0002'" in reason
    assert "'SIM-0001'" in reason


@pytest.mark.parametrize("name", list(PARAMETERS.as_mapping()))
def test_any_other_parameter_is_a_mismatch(calibration, name):
    value = PARAMETERS.as_mapping()[name]
    other = value + 1 if name == "P" else 1.001 * value or 1e-3
    described = ActuatorDescription(parameters=PARAMETERS.replace({name: other}))
    reason = calibration.unit_mismatch(described)
    assert f"{name} = {other:g}" in reason
    assert f"{value:g}" in reason
    assert ";" not in reason


def test_all_that_is_different_is_named(calibration):
    described = ActuatorDescription(
        serial_number="X", parameters=PARAMETERS.replace({"R_s": 2.2, "k_e": 0.07})
    )
    reason = calibration.unit_mismatch(described)
    assert reason.count(";") == 2
    assert "R_s" in reason
    assert "k_e" in reason


def test_name_of_the_place_does_not_matter(calibration):
    """A unit keeps its calibration when it is fitted elsewhere."""
    assert calibration.unit_mismatch(ActuatorDescription(actuator_id="rudder")) == ""


def test_other_sample_period_is_a_mismatch(calibration, healthy_windows):
    slower = changed(healthy_windows[0], sample_period=2e-4)
    reason = calibration.shape_mismatch(slower)
    assert "0.0002 s" in reason
    assert "0.0001 s" in reason


def test_other_length_is_a_mismatch(calibration, healthy_windows):
    shorter = replace(healthy_windows[0], telemetry=healthy_windows[0].telemetry.part(0, 5000))
    reason = calibration.shape_mismatch(shorter)
    assert "4999 samples" in reason
    assert "5000" in reason


@pytest.mark.parametrize(("share", "fits"), [(0.0045, True), (0.0055, False)])
def test_other_command_is_a_mismatch(calibration, healthy_windows, share, fits):
    """Half a percent of the command's rms is the limit."""
    window = healthy_windows[0]
    offset = share * rms(window.command)
    reason = calibration.command_mismatch(changed(window, command=window.command + offset))
    assert (reason == "") == fits
    if not fits:
        assert f"by {offset:.3g} rad" in reason


@pytest.mark.parametrize("shift", [-25, -1, 0, 1, 40])
def test_window_seen_to_begin_later_or_earlier_is_aligned(calibration, shift):
    # A tone by which the two can be laid over each other only one way.
    command = 1e-3 * np.sin(2 * np.pi * (np.arange(-100, 5101) / 5000.0) ** 2 * 15.0)
    n = len(calibration.correction)
    own = replace(calibration, command=command[100 : 101 + n])
    rows = (np.zeros(n + 1) for _ in range(3))
    window = Window(Telemetry(0, H, 0, command[100 + shift : 101 + n + shift], *rows), 1.0)
    assert own.alignment(window) == shift
    assert own.command_mismatch(window) == ""
    # Where both windows have the sample, its correction is that of the same moment.
    corrected = own.apply(np.zeros(n), shift)
    inside = np.arange(max(0, -shift), n - max(0, shift))
    np.testing.assert_array_equal(corrected[inside], own.correction[inside + shift])


@pytest.mark.parametrize("period", [1.25e-4, 2.5e-4, 1e-5, 1e-4])
def test_step_divides_the_sample_period(description, period):
    """8 kHz is no multiple of the form's 20 us; the longest step below it that fits is taken."""
    n = 40
    command = np.concatenate([np.linspace(0, 2e-3, n // 2), np.linspace(2e-3, 0, n // 2)])
    rows = (np.zeros(n), command, np.ones(n))
    window = Window(Telemetry(0, period, 1, command, *rows), 0.0)
    calibration = calibrate([window], replace(description, sample_period=period))
    steps = period / calibration.dt
    assert steps == pytest.approx(round(steps))
    assert calibration.dt <= FORMS["fast"] * (1 + 1e-9) < period / (round(steps) - 1 or 1e-9)


def test_nothing_to_calibrate_on_is_refused(description):
    with pytest.raises(ValueError, match="at least one healthy window"):
        calibrate([], description)


def test_windows_of_another_command_are_refused(healthy_windows, description):
    other = changed(healthy_windows[1], command=1.01 * healthy_windows[1].command)
    with pytest.raises(ValueError, match=r"window 2: it has another command .* rad rms"):
        calibrate([*healthy_windows[:2], other], description)


def test_windows_of_another_length_are_refused(healthy_windows, description):
    other = replace(healthy_windows[1], telemetry=healthy_windows[1].telemetry.part(0, 4000))
    with pytest.raises(ValueError, match=r"window 1: it has 3999 samples .* first 5000"):
        calibrate([healthy_windows[0], other], description)


def test_windows_of_another_sample_period_are_refused(healthy_windows, description):
    other = changed(healthy_windows[1], sample_period=2e-4)
    with pytest.raises(ValueError, match=r"0\.0002 s, the first 5000 of 0\.0001 s"):
        calibrate([healthy_windows[0], other], description)


def test_model_has_the_parameters_of_the_unit(description, healthy_windows):
    parameters = PARAMETERS.replace({"R_s": 3.0})
    unit = replace(description, serial_number="N7", parameters=parameters)
    calibration = calibrate(healthy_windows[:1], unit)
    assert (calibration.serial_number, calibration.parameters) == ("N7", parameters)
    assert calibration.model().parameters == parameters


def test_window_without_excitation_is_no_calibration(description):
    columns = (np.full(11, value) for value in (5e-6, 0.1, 0.0, 0.0))
    window = Window(Telemetry(0, H, 0, *columns), 0.0)
    with pytest.raises(ValueError, match=r"window 0: no excitation"):
        calibrate([window], description)
