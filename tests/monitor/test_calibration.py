"""What a calibration belongs to, and how it is laid over a window."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.alignment import shift_if_same
from ema_monitor.model.deviations import Deviations
from ema_monitor.model.monitor_model import MonitorModel, Response
from ema_monitor.windows.band import rms
from ema_monitor.windows.window import Window

from .windows import changed

PARAMETERS = ActuatorParameters()
H = 1e-4


def test_calibration_fits_its_own_windows(calibration, healthy_windows, description):
    for window in healthy_windows:
        assert calibration.unit_mismatch(description) == ""
        assert calibration.shape_mismatch(window) == ""
        assert calibration.reference(window).knows_command


@pytest.mark.parametrize("name", [name for name in PARAMETERS.as_mapping() if name != "omega_c"])
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


def test_other_sample_period_is_a_mismatch(calibration, healthy_windows):
    slower = changed(healthy_windows[0], sample_period=2e-4)
    reason = calibration.shape_mismatch(slower)
    assert "0.0002 s" in reason
    assert "0.0001 s" in reason


@pytest.mark.parametrize(("share", "known"), [(0.0045, True), (0.0055, False)])
def test_other_command_has_no_correction_and_the_wider_scatter(
    calibration, healthy_windows, share, known
):
    """Half a percent of the command's rms is the limit."""
    window = healthy_windows[0]
    other = changed(window, command=window.command + share * rms(window.command))
    reference = calibration.reference(other)
    assert reference.knows_command == known
    for row, correction in zip(
        reference.corrections,
        (calibration.correction, calibration.speed_correction),
        strict=True,
    ):
        assert np.array_equal(row, correction if known else np.zeros(len(other)))
    healthy = (calibration.healthy_rms, calibration.healthy_speed_rms)
    alone = (calibration.model_rms, calibration.model_speed_rms)
    assert reference.scatter == (healthy if known else alone)
    assert all(a > b for a, b in zip(alone, healthy, strict=True))


@pytest.mark.parametrize("shift", [-25, -1, 0, 1, 40])
def test_window_seen_to_begin_later_or_earlier_is_aligned(calibration, shift):
    # A tone by which the two can be laid over each other only one way.
    command = 1e-3 * np.sin(2 * np.pi * (np.arange(-100, 5101) / 5000.0) ** 2 * 15.0)
    n = len(calibration.correction)
    own = replace(calibration, command=command[100 : 101 + n])
    rows = (np.zeros(n + 1) for _ in range(3))
    window = Window(Telemetry(0, H, 0, command[100 + shift : 101 + n + shift], *rows), 1.0)
    assert shift_if_same(window.command, own.command, window.telemetry.sample_period) == shift
    # Where both windows have the sample, its correction is that of the same moment.
    expected = own.expect(Response(np.zeros((2, n)), np.zeros((2, n))), window)
    inside = np.arange(max(0, -shift), n - max(0, shift))
    for rows, correction in zip(expected, (own.correction, own.speed_correction), strict=True):
        for row in rows:
            np.testing.assert_array_equal(row[inside], correction[inside + shift])


def test_corrections_are_added_to_every_individual(calibration, healthy_windows):
    n = len(calibration.correction)
    rng = np.random.default_rng(2)
    response = Response(rng.normal(size=(3, n)), rng.normal(size=(3, n)))
    expected = calibration.expect(response, healthy_windows[0])
    for i in range(3):
        assert np.array_equal(expected.current[i], response.current[i] + calibration.correction)
        assert np.array_equal(expected.speed[i], response.speed[i] + calibration.speed_correction)


def test_model_is_the_nominal_one_with_the_structural_figures(calibration, healthy_windows):
    """Motor and user shaft alike, and nothing else is changed."""
    p = PARAMETERS
    deviations = Deviations(lift=0.2, friction=0.1, inertia=-0.1, backlash=0.5, loop_gain=0.02)
    unit = replace(calibration, unit=deviations)
    scales = {"f_sm": 1.1, "f_su": 1.1, "J_m": 0.9, "J_u": 0.9, "BLK": 1.5, "G_prop": 1.02}
    changed_parameters = p.replace({name: x * getattr(p, name) for name, x in scales.items()})
    model = MonitorModel(changed_parameters, unit=Deviations(lift=0.2))
    faults = fault_vector({"friction": 0.1, "short_circuit_b": 0.3})
    for mine, other in zip(
        unit.model().respond(healthy_windows[0], faults, 1.0),
        model.respond(healthy_windows[0], faults, 1.0),
        strict=True,
    ):
        # The products are rounded in another order; a chirp of 100 Hz makes some 1e-9 of that.
        assert mine == pytest.approx(other, abs=1e-6)
    assert unit.parameters == p
    assert unit.unit_parameters.as_mapping() == pytest.approx(changed_parameters.as_mapping())
