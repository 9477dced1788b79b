# SPDX-License-Identifier: Apache-2.0
"""Responses of chapter 4, compared with physics and with the claims of the thesis."""

import numpy as np

from ema_core.description import SAMPLE_PERIOD
from ema_core.parameters import ActuatorParameters, constants
from ema_study.responses import (
    COMMANDS,
    SEVERITIES,
    chirp_currents,
    reference_responses,
    uncalibrated_currents,
)


def _step(fault: str):
    return list(reference_responses(fault, "step").values())


def _chirp(fault: str):
    return list(reference_responses(fault, "chirp").values())


def steady(values):
    """Return the last tenth of a second."""
    return values[-round(0.1 / SAMPLE_PERIOD) :]


def rise_time(response):
    """Return the time from the step until the speed passes 1 - 1/e of its steady mean [s]."""
    reached = (1.0 - np.exp(-1.0)) * steady(response.speed).mean()
    return SAMPLE_PERIOD * np.argmax(response.speed >= reached) - COMMANDS["step"].start_time


def test_steady_speed_after_a_step_balances_voltage_and_friction():
    # The whole voltage drives a pair of phases: V = k_e w + R I with k_t I = f_d + C w.
    p = ActuatorParameters()
    mechanics = constants(p).mechanics
    for severity, response in zip(SEVERITIES["friction"].values(), _step("friction"), strict=True):
        f_d = mechanics.f_d * (1.0 + 2.0 * severity["friction"])
        expected = (p.V_max * p.k_t - p.R_s * f_d) / (p.k_t * p.k_e + p.R_s * mechanics.C)
        # The balance neglects commutation, in which the current drops: it costs 1 to 3 %.
        assert 0.96 * expected < steady(response.speed).mean() < expected


def test_backlash_shifts_the_position_by_half_its_growth_and_changes_nothing_else():
    p = ActuatorParameters()
    healthy, *faulty = _step("backlash")
    _, *severities = SEVERITIES["backlash"].values()
    for severity, response in zip(severities, faulty, strict=True):
        shift = 99.0 * severity["backlash"] * p.BLK / 2.0 * p.tau
        moved = steady(healthy.position) - steady(response.position)
        np.testing.assert_allclose(moved, shift, rtol=1e-9)
        np.testing.assert_array_equal(response.speed, healthy.speed)
        np.testing.assert_array_equal(response.current, healthy.current)


def test_gain_has_no_effect_while_the_controller_is_saturated():
    first, *faulty = _step("gain")
    for response in faulty:
        np.testing.assert_array_equal(response.position, first.position)
        np.testing.assert_array_equal(response.current, first.current)


def test_short_circuited_turns_raise_the_steady_speed():
    # Fewer turns have less back-EMF.
    speeds = [steady(response.speed).mean() for response in _step("short_circuit")]
    assert np.all(np.diff(speeds) > 0.0)


def test_calibration_removes_the_healthy_difference():
    before, after = uncalibrated_currents(), chirp_currents("none")
    for model in ("fast", "thesis"):
        np.testing.assert_allclose(after.monitor[model], after.reference, atol=1e-9)
        assert np.abs(before.monitor[model] - before.reference).max() > 0.1


def test_friction_does_not_change_the_time_constant():
    # Figure 4.4: a constant torque lowers the speed of a linear motor, not its time constant.
    times_s = [rise_time(response) for response in _step("friction")]
    speeds = [steady(response.speed).mean() for response in _step("friction")]
    assert np.all(np.diff(times_s) <= 0.0)
    assert np.all(np.diff(speeds) < 0.0)


def test_backlash_raises_the_peak_current_by_70_to_100_percent():
    # Figure 4.18.
    healthy, *_, worst = (np.abs(response.current).max() for response in _chirp("backlash"))
    assert 1.7 <= worst / healthy <= 2.0


def test_eccentricity_and_short_circuit_make_speed_and_current_ripple():
    # Figures 4.23, 4.24, 4.36 and 4.37.
    for fault in ("short_circuit", "eccentricity"):
        for quantity in ("speed", "current"):
            ripples = [steady(getattr(response, quantity)).std() for response in _step(fault)]
            assert np.all(np.diff(ripples) > 0.0)
