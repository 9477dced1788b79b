"""Responses of chapter 4: what physics says of them, and the measures that claims rest on."""

import re

import numpy as np
import pytest

from ema_core.parameters import ActuatorParameters, constants
from ema_study.claims import claims, claims_table
from ema_study.claims.claim import range_agrees
from ema_study.response_figures_of_merit import (
    deviations,
    lags,
    phase_a_is_fed,
    reversal_delays,
    ripple,
    rise_time,
    standstill,
    start_and_rest,
    steady,
)
from ema_study.responses import (
    COMMANDS,
    COMPARED,
    SEVERITIES,
    chirp_comparison,
    noisy_response,
    reference_response,
    reference_responses,
    step_comparison,
    times,
    uncalibrated_comparison,
)


def _step(fault: str):
    return [reference_response(fault, i, "step") for i in range(len(SEVERITIES[fault]))]


def test_first_degree_of_every_fault_but_gain_is_the_healthy_actuator():
    healthy = reference_response("gain", 2, "chirp")
    for fault in set(SEVERITIES) - {"gain"}:
        first = reference_response(fault, 0, "chirp")
        np.testing.assert_array_equal(first.current, healthy.current)


@pytest.mark.parametrize(
    ("fault", "component", "base", "slope"),
    [
        ("friction", "friction", 1.0, 2.0),
        ("backlash", "backlash", 1.0, 99.0),
        ("short_circuit", "short_circuit_a", 0.0, 100.0),
        ("eccentricity", "eccentricity", 0.0, 1.0),
        ("gain", "gain", 0.5, 1.0),
    ],
)
def test_labels_of_degrees_say_what_the_component_amounts_to(fault, component, base, slope):
    for severity in SEVERITIES[fault]:
        assert set(severity.faults) == {component}
        [number] = re.findall(r"[0-9.]+", severity.label)
        assert float(number) == pytest.approx(base + slope * severity.faults[component])


@pytest.mark.parametrize("command", COMMANDS)
def test_responses_begin_at_rest_and_last_half_a_second(command):
    for response in reference_responses("friction", command).values():
        assert response.command[0] == response.position[0] == response.speed[0] == 0.0
        assert times(len(response))[-1] == pytest.approx(0.5)


def test_steady_speed_under_step_balances_voltage_and_friction():
    # The whole voltage drives a pair of phases: V = k_e w + R I with k_t I = f_d + C w.
    p = ActuatorParameters()
    mechanics = constants(p).mechanics
    for severity, response in zip(SEVERITIES["friction"], _step("friction"), strict=True):
        f_d = mechanics.f_d * (1.0 + 2.0 * severity.faults["friction"])
        expected = (p.V_max * p.k_t - p.R_s * f_d) / (p.k_t * p.k_e + p.R_s * mechanics.C)
        # The balance knows no commutation, in which the current falls: it costs 1 to 3 %.
        assert 0.96 * expected < steady(response.speed).mean() < expected


def test_steady_current_under_step_carries_friction():
    p = ActuatorParameters()
    mechanics = constants(p).mechanics
    for severity, response in zip(SEVERITIES["friction"], _step("friction"), strict=True):
        torque = mechanics.f_d * (1.0 + 2.0 * severity.faults["friction"])
        torque += mechanics.C * steady(response.speed).mean()
        # In the commutations three phases share the current, which the equivalent one counts half.
        assert steady(response.current).mean() == pytest.approx(torque / p.k_t, rel=0.15)


def test_backlash_shifts_the_position_by_half_its_growth_and_nothing_else():
    p = ActuatorParameters()
    healthy, *others = _step("backlash")
    for severity, response in zip(SEVERITIES["backlash"][1:], others, strict=True):
        shift = 99.0 * severity.faults["backlash"] * p.BLK / 2.0 * p.tau
        moved = steady(healthy.position) - steady(response.position)
        np.testing.assert_allclose(moved, shift, rtol=1e-9)
        np.testing.assert_array_equal(response.speed, healthy.speed)
        np.testing.assert_array_equal(response.current, healthy.current)


def test_gain_has_no_effect_while_the_controller_is_saturated():
    first, *others = _step("gain")
    for response in others:
        np.testing.assert_array_equal(response.position, first.position)
        np.testing.assert_array_equal(response.current, first.current)


def test_turns_that_are_bypassed_raise_the_steady_speed():
    # Fewer turns have less back-EMF.
    speeds = [steady(response.speed).mean() for response in _step("short_circuit")]
    assert np.all(np.diff(speeds) > 0.0)


def test_noise_is_repeatable_and_zero_noise_is_none():
    again = noisy_response.__wrapped__(10.0)
    np.testing.assert_array_equal(again.current, noisy_response(10.0).current)
    healthy = reference_response("friction", 0, "chirp")
    np.testing.assert_array_equal(noisy_response(0.0).current, healthy.current)


def test_calibration_takes_the_healthy_difference_away():
    before, after = uncalibrated_comparison(), chirp_comparison("none")
    for model in ("fast", "thesis"):
        np.testing.assert_allclose(after.monitor[model], after.reference, atol=1e-9)
        assert np.abs(before.monitor[model] - before.reference).max() > 0.1


def test_printed_equation_of_eccentricity_misses_the_reference_and_the_driven_pair_does_not():
    comparison = chirp_comparison("eccentricity")
    fast, thesis = (
        deviations(comparison.reference, comparison.monitor[model]) for model in ("fast", "thesis")
    )
    assert fast.max() < 5.0 < 10.0 < thesis.min()


def test_step_comparison_has_the_length_of_its_reference():
    comparison = step_comparison(0)
    assert {len(row) for row in comparison.monitor.values()} == {len(comparison.reference)}


def test_compared_degrees_are_those_shown():
    for fault, severity in COMPARED.items():
        assert severity in SEVERITIES[fault]


def test_rise_time_of_a_first_order_lag_is_its_time_constant():
    healthy = reference_response("friction", 0, "step")
    t = times(len(healthy))
    lag = type(healthy)(
        healthy.stamp_ns,
        healthy.sample_period,
        healthy.first_index,
        healthy.command,
        healthy.current,
        healthy.position,
        300.0 * (1.0 - np.exp(-np.maximum(t - 0.01, 0.0) / 0.02)),
    )
    assert rise_time(lag) == pytest.approx(0.02, rel=1e-3)


def test_command_itself_has_no_reversal_delay():
    healthy = reference_response("friction", 0, "chirp")
    ideal = type(healthy)(
        healthy.stamp_ns,
        healthy.sample_period,
        healthy.first_index,
        healthy.command,
        healthy.current,
        healthy.command,
        healthy.speed,
    )
    delays = reversal_delays(ideal)
    assert len(delays) == 7
    # 1 urad of 5 mrad is left within 2 ms of the slowest of the reversals.
    assert np.all((delays >= 0.0) & (delays < 2e-3))
    assert np.all(reversal_delays(healthy) > 2e-3)


def test_ripple_is_the_rms_of_a_quick_sine_and_none_of_a_ramp():
    t = times(5001)
    assert ripple(3.0 * np.sin(2 * np.pi * 2000.0 * t)) == pytest.approx(3.0 / np.sqrt(2), rel=0.02)
    assert ripple(100.0 * t) == pytest.approx(0.0, abs=1e-9)


def test_deviation_of_a_scaled_current_is_its_scale():
    reference = np.sin(2 * np.pi * 10.0 * times(5000))
    np.testing.assert_allclose(deviations(reference, 0.9 * reference), 10.0, rtol=1e-6)


def test_phase_a_is_fed_two_thirds_of_a_turn():
    fed = phase_a_is_fed(reference_response("friction", 0, "step"))
    assert steady(fed.astype(float)).mean() == pytest.approx(2 / 3, abs=0.02)


def test_standstill_counts_time():
    healthy = reference_response("friction", 0, "step")
    # The motor stands until the step at 10 ms.
    assert standstill(healthy) == pytest.approx(0.01, abs=5e-4)


def test_every_claim_has_a_figure_of_chapter_4_or_6_and_a_measure():
    found = claims()
    assert len(found) == 40
    for claim in found:
        assert claim.figure.startswith(("4.", "6."))
        assert any(letter.isdigit() for letter in claim.ours)
    table = claims_table()
    assert set(table.agrees) == {"yes", "no"}
    assert (table.agrees == "yes").sum() == sum(claim.agrees for claim in found)


@pytest.mark.parametrize(
    ("figure", "words", "agrees"),
    [
        ("4.4", "highest speed", True),
        # A constant torque does not change the time constant of a linear motor.
        ("4.4", "time constant", False),
        ("4.15", "speed and current", True),
        ("4.18", "70 to 100 %", True),
        ("4.40", "7 % at the start", False),
        # It does not reach the claimed 12 %, so it is not the claimed range.
        ("4.6", "2 to 12 %", False),
        ("4.14", "only the start", True),
        ("4.43", "not affected", True),
    ],
)
def test_claims_that_physics_decides(figure, words, agrees):
    [claim] = [one for one in claims() if one.figure == figure and words in one.claim]
    assert claim.agrees is agrees


@pytest.mark.parametrize(
    ("found", "agrees"),
    [
        ([1.0, 6.0, 3.0], True),
        ([2.0, 7.5, 3.0], True),  # a point above 1, a quarter above 6
        ([2.1, 6.0, 3.0], False),
        ([1.0, 4.4, 3.0], False),
        ([1.0, 7.6, 3.0], False),
    ],
)
def test_a_claimed_range_is_judged_by_both_of_its_ends(found, agrees):
    assert range_agrees(np.array(found), (1.0, 6.0)) is agrees


def test_lag_is_the_share_that_is_missing_and_none_before_the_motion():
    healthy, worst = (reference_response("backlash", i, "step") for i in (0, -1))
    short = lags(healthy, worst)
    at_start, later = start_and_rest(short)

    moving = healthy.position > 0.0
    assert not short[~moving].any()
    # It stands until half of its play is passed, then lacks that, ever less of the way.
    assert at_start.max() == pytest.approx(1.0)
    assert np.all(np.diff(later) < 0.0)
    assert short[-1] == pytest.approx(1.0 - worst.position[-1] / healthy.position[-1])
