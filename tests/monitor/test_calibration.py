# SPDX-License-Identifier: Apache-2.0
"""Match of a calibration with a unit, and its alignment with a window."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.alignment import difference_at, moved, shift_between, shift_if_same
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.model.deviations import Deviations
from ema_monitor.model.monitor_model import MonitorModel, Response
from ema_monitor.reason_texts import differences_text
from ema_monitor.windows.band import rms
from ema_monitor.windows.trigger import TriggerSettings, WindowTrigger
from ema_monitor.windows.window import Window

from .windows import changed

PARAMETERS = ActuatorParameters()
H = 1e-4


@pytest.mark.parametrize("name", [name for name in PARAMETERS.as_mapping() if name != "omega_c"])
def test_any_different_parameter_is_a_mismatch(calibration, name):
    value = PARAMETERS.as_mapping()[name]
    different = value + 1 if name == "P" else 1.001 * value or 1e-3
    described = ActuatorDescription(parameters=PARAMETERS.replace({name: different}))
    differences = calibration.unit_mismatch(described)
    assert differences == ((name, different, value),)
    words = f"the actuator has {name} = {different:g}, the calibration {value:g}"
    assert differences_text(differences) == words


def test_all_differences_are_named(calibration):
    described = ActuatorDescription(
        serial_number="X", parameters=PARAMETERS.replace({"R_s": 2.2, "k_e": 0.07})
    )
    differences = calibration.unit_mismatch(described)
    assert {name for name, _, _ in differences} == {"serial_number", "R_s", "k_e"}
    assert differences_text(differences).count(";") == 2


@pytest.mark.parametrize(("share", "has_correction"), [(0.0045, True), (0.0055, False)])
def test_other_command_has_no_correction_and_a_wider_scatter(
    calibration, healthy_windows, share, has_correction
):
    """The limit is half a per cent of the rms of the command."""
    window = healthy_windows[0]
    varied = changed(window, command=window.command + share * rms(window.command))
    reference = calibration.reference(varied)
    assert reference.knows_command == has_correction
    for row, correction in zip(
        reference.corrections, (calibration.correction, calibration.speed_correction), strict=True
    ):
        assert np.array_equal(row, correction if has_correction else np.zeros(len(varied)))
    healthy = (calibration.healthy_rms, calibration.healthy_speed_rms)
    alone = (calibration.model_rms, calibration.model_speed_rms)
    assert reference.scatter == (healthy if has_correction else alone)
    assert all(a > b for a, b in zip(alone, healthy, strict=True))


@pytest.mark.parametrize("shift", [-25, -1, 0, 1, 40])
def test_window_that_begins_later_or_earlier_is_aligned(calibration, shift):
    # A tone with a unique alignment.
    command = 1e-3 * np.sin(2 * np.pi * (np.arange(-100, 5101) / 5000.0) ** 2 * 15.0)
    n = len(calibration.correction)
    shifted = replace(calibration, command=command[100 : 101 + n])
    rows = (np.zeros(n + 1) for _ in range(3))
    window = Window(Telemetry(0, H, 0, command[100 + shift : 101 + n + shift], *rows), 1.0)
    assert shift_if_same(window.command, shifted.command, window.telemetry.sample_period) == shift
    # A sample of both windows has the correction of the same moment.
    expected = shifted.expect(Response(np.zeros((2, n)), np.zeros((2, n))), window)
    inside = np.arange(max(0, -shift), n - max(0, shift))
    corrections = shifted.correction, shifted.speed_correction
    for rows, correction in zip(expected, corrections, strict=True):
        for row in rows:
            np.testing.assert_array_equal(row[inside], correction[inside + shift])


def test_model_is_the_nominal_one_with_the_structural_parameters(calibration, healthy_windows):
    """Motor and user shaft have the same factors, and nothing else is changed."""
    p = PARAMETERS
    deviations = Deviations(lift=0.2, friction=0.1, inertia=-0.1, backlash=0.5, loop_gain=0.02)
    unit = replace(calibration, unit=deviations)
    scales = {"f_sm": 1.1, "f_su": 1.1, "J_m": 0.9, "J_u": 0.9, "BLK": 1.5, "G_prop": 1.02}
    changed_parameters = p.replace({name: x * getattr(p, name) for name, x in scales.items()})
    model = MonitorModel(changed_parameters, unit=Deviations(lift=0.2))
    faults = fault_vector({"friction": 0.1, "short_circuit_b": 0.3})
    for actual, expected in zip(
        unit.model().respond(healthy_windows[0], faults, 1.0),
        model.respond(healthy_windows[0], faults, 1.0),
        strict=True,
    ):
        # The products are rounded in a different order; a chirp of 100 Hz amplifies this to about
        # 1e-9.
        assert actual == pytest.approx(expected, abs=1e-6)
    assert unit.parameters == p
    assert unit.unit_parameters.as_mapping() == pytest.approx(changed_parameters.as_mapping())


CHIRP = 1e-3 * np.sin(2 * np.pi * 15.0 * (np.arange(1000) / 1000.0) ** 2)


@pytest.mark.parametrize("shift", [-60, -7, 0, 1, 60])
def test_shift_is_measured_under_noise(shift):
    command = CHIRP[100 + shift : 800 + shift] + np.random.default_rng(1).normal(0, 1e-6, 700)
    reference = CHIRP[100:800]
    assert shift_between(command, reference, 1e-4) == shift
    # The residual is the noise.
    assert difference_at(command, reference, shift) == pytest.approx(1e-6, rel=0.1)


@pytest.mark.parametrize("shift", [-2, 0, 1])
def test_slow_streams_with_few_samples_are_aligned(shift):
    """For 100 samples at 200 Hz, shifts of 60 would leave nothing to compare."""
    slow = CHIRP[::9][:111]
    command = slow[5 + shift : 105 + shift] + np.random.default_rng(1).normal(0, 1e-4, 100)
    assert shift_between(command, slow[5:105], 5e-3) == shift


def test_shifted_row_repeats_its_ends():
    row = np.array([1.0, 2.0, 3.0])
    assert moved(row, 1).tolist() == [2.0, 3.0, 3.0]
    assert moved(row, -1).tolist() == [1.0, 1.0, 2.0]
    assert moved(row, 0).tolist() == row.tolist()


def test_windows_with_a_noisy_command_are_aligned_before_averaging(
    healthy_windows, description, calibration
):
    """Their starts have jitter, their currents do not."""
    rng = np.random.default_rng(5)
    jittered = []
    for window in healthy_windows:
        t = window.telemetry
        rest = 800
        command = np.concatenate([np.full(rest, t.command[0]), t.command, np.full(300, 0.0)])
        current, position, speed = (
            np.pad(column, (rest, 300), "edge") for column in (t.current, t.position, t.speed)
        )
        noisy = command + rng.normal(0.0, 3e-7, len(command))
        stream = Telemetry(0, t.sample_period, 1, noisy, current, position, speed)
        trigger = WindowTrigger(description.parameters, TriggerSettings(threshold=2.5e-6))
        [detected] = [event for event in trigger.feed(stream) if isinstance(event, Window)]
        jittered.append(Window(detected.telemetry, window.play))
    starts = {window.telemetry.first_index for window in jittered}
    assert len(starts) > 1
    # A misalignment of one sample would show as scatter at each reversal.
    assert calibrate_model(jittered, description).healthy_rms < 1.3 * calibration.healthy_rms
