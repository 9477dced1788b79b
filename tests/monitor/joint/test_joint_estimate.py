# SPDX-License-Identifier: Apache-2.0
"""Records of a joint with known truth, from calibration to faults, causes and verdict."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.faults import BACKLASH, FAULT_NAMES, FRICTION
from ema_monitor import quantities as of
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.identification.estimate import INVERSE_DYNAMICS, Estimate, Verdict
from ema_monitor.identification.joint_estimate import comparable_record, identify_record
from ema_monitor.joint.comparison import Judgement
from ema_monitor.joint.record import JointRecord
from ema_monitor.joint.wording import finding
from ema_monitor.reasons import StatedReason
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import Refusal, TriggerSettings
from ema_monitor.windows.window import Window

from .plant import Joint, Motion, Sensors, described, healthy_telemetry, telemetry_of, tones
from .plant import window_of as window

LATER = 60
"""Day of the tests."""

PLAIN = Joint(gravity=0.4)
WITH_PLAY = Joint(play=0.004, wind_up=0.002)
MOTOR_SPEED = Sensors(speed=True)
LIGHT = Joint(inertia=1e-4)
NOISY = Sensors(noise=0.1)


def calibrated(
    joint: Joint = PLAIN,
    sensors: Sensors | None = None,
    description: ActuatorDescription | None = None,
) -> JointCalibration:
    records = healthy_telemetry(joint, sensors)
    return calibrate_joint(list(map(window, records)), description or described(sensors))


def measured(joint: Joint, sensors: Sensors | None = None, motion: Motion | None = None, **where):
    """Return the window of a test."""
    motion = tones() if motion is None else motion
    return window(
        telemetry_of(joint, motion, sensors or Sensors(), seed=9, **{"day": LATER, **where})
    )


@pytest.fixture(scope="module")
def plain() -> JointCalibration:
    return calibrated()


@pytest.fixture(scope="module")
def with_play() -> JointCalibration:
    return calibrated(WITH_PLAY, MOTOR_SPEED)


def estimate(calibration: JointCalibration, joint: Joint, **how: Any) -> Estimate:
    return identify_record(measured(joint, **how), described(how.get("sensors")), calibration)


def judgement(result: Estimate, name: str) -> Judgement:
    assert result.comparison is not None
    return result.comparison[name].judgement


# Verdicts


def test_healthy_record_is_valid_and_unchanged(plain):
    result = estimate(plain, PLAIN)
    assert (result.verdict, result.valid, result.algorithm) == (
        Verdict.VALID,
        True,
        INVERSE_DYNAMICS,
    )
    assert result.calibration_windows == 9
    assert judgement(result, of.FRICTION) is Judgement.UNCHANGED
    assert not result.causes
    assert result.insignificant[FRICTION]
    assert result.faults.friction == pytest.approx(0.0, abs=0.02)
    # Quantities that no record shows are absent, not healthy.
    for name in set(FAULT_NAMES) - {"friction"}:
        assert math.isnan(getattr(result.faults, name)), name
        assert result.unobservable[FAULT_NAMES.index(name)], name


@pytest.mark.parametrize("factor", [1.15, 1.3, 2.0, 0.8])
def test_increased_friction_is_the_fault_friction(plain, factor):
    result = estimate(plain, PLAIN.times(coulomb=factor))
    assert result.verdict == Verdict.DEPARTED
    assert result.comparison is not None
    friction = result.comparison[of.FRICTION]
    assert friction.judgement is Judgement.CHANGED
    # The days scatter by 1 % and the record by half of that: three standard deviations of both.
    assert friction.change == pytest.approx(factor - 1.0, abs=0.035)
    # The ratio is 1 + 2 k, and reduced friction is not a fault.
    assert result.faults.friction == pytest.approx(max(factor - 1.0, 0.0) / 2.0, abs=0.018)
    assert result.insignificant[FRICTION] == (factor < 1.0)
    sigma = (friction.high - friction.low) / (2.0 * 1.645)
    assert math.sqrt(result.covariance[FRICTION, FRICTION]) == pytest.approx(sigma / 2.0)
    assert "Coulomb friction" in result.reason


CAUSES = {
    "torque": ({"torque": 0.9}, "torque_constant", -0.1, 0.01),
    "viscous": ({"viscous": 2.0}, "viscous_friction", 1.0, 0.18),
    "inertia": ({"inertia": 1.3}, "inertia", 0.3, 0.02),
}


@pytest.mark.parametrize(("factors", "cause", "size", "within"), CAUSES.values(), ids=CAUSES)
def test_change_that_is_not_a_fault_is_a_cause(plain, factors, cause, size, within):
    result = estimate(plain, PLAIN.times(**factors))
    assert result.verdict == Verdict.DEPARTED
    (named,) = result.causes
    assert named.name == cause
    assert named.value == pytest.approx(size, abs=within)
    assert abs(named.value - size) < 4.0 * named.sigma
    assert judgement(result, of.FRICTION) is Judgement.UNCHANGED


@pytest.mark.parametrize(
    ("tau", "k_t", "lead", "unit"),
    [
        (1.0, 1.0, 0.0, "A"),
        (0.01, 0.05, 0.01, "A"),
        (1.0, 0.05, 0.0, "N.m"),
        (0.01, 0.05, 0.0, "N.m"),
        (1.0, 0.05, 0.01, "N"),
        (1.0, 1.0, 0.01, "N"),
    ],
)
def test_load_is_reported_in_the_recorded_unit_of_the_effort(tau, k_t, lead, unit):
    joint = Joint()
    plain = described()
    parameters = plain.parameters.replace({"tau": tau, "k_t": k_t, "lead": lead})
    acquisition = replace(plain.acquisition, effort_unit=unit)
    description = replace(plain, parameters=parameters, acquisition=acquisition)
    calibration = calibrated(joint, description=description)
    result = identify_record(measured(replace(joint, load=0.3)), description, calibration)
    (cause,) = result.causes
    assert cause.name == "load_torque"
    # 0.2 A more at the motor; the scatter of 1 % of friction is 0.01 A.
    assert cause.value == pytest.approx(0.2 * k_t, abs=0.015 * k_t)
    assert result.comparison is not None
    load = result.comparison[of.LOAD]
    sizes = {"A": 1.0, "N.m": k_t / tau, "N": k_t / tau * 2.0 * math.pi / max(lead, 1e-9)}
    assert load.unit == unit
    assert load.change == pytest.approx(0.2 * sizes[unit], rel=0.1)


def test_rivals_are_neither_faults_nor_causes():
    """All effort is friction, so that a change of torque per ampere would look the same."""
    joint = Joint(inertia=0.0004, viscous=0.0, load=0.0)
    calibration = calibrated(joint)
    result = estimate(calibration, joint.times(coulomb=1.3))
    assert result.verdict == Verdict.DEPARTED
    assert result.comparison is not None
    assert result.comparison.changed
    for name in (of.FRICTION, of.TORQUE):
        assert judgement(result, name) is not Judgement.UNCHANGED
    assert not result.causes
    assert math.isnan(result.faults.friction)
    assert "cannot be distinguished" in result.reason


# Play and tracking


def test_play_between_motor_and_joint_is_backlash(with_play):
    assert judgement(estimate(with_play, WITH_PLAY, sensors=MOTOR_SPEED), of.PLAY) is (
        Judgement.UNCHANGED
    )
    result = estimate(with_play, WITH_PLAY.times(play=2.0), sensors=MOTOR_SPEED)
    assert result.verdict == Verdict.DEPARTED
    assert result.comparison is not None
    play = result.comparison[of.PLAY]
    assert play.judgement is Judgement.CHANGED
    # Lost motion of 4 mrad of play and 2 mrad of wind-up becomes 10 mrad.
    assert play.change == pytest.approx(4.0 / 6.0, rel=0.05)
    assert result.faults.backlash > 0.0
    assert not result.insignificant[BACKLASH]


def test_play_is_not_judged_without_the_speed_of_the_motor(plain):
    result = estimate(plain, PLAIN.times(coulomb=1.3))
    assert result.comparison is not None
    play = result.comparison[of.PLAY]
    assert play.judgement is Judgement.NOT_JUDGED
    assert "needs the speed of the motor" in play.reason
    assert math.isnan(result.faults.backlash)


def test_play_is_not_judged_if_both_sensors_are_on_one_side():
    joint = Joint()
    result = estimate(calibrated(joint, MOTOR_SPEED), joint, sensors=MOTOR_SPEED)
    assert result.comparison is not None
    assert "both sensors are on one side" in result.comparison[of.PLAY].reason


def test_wind_up_by_friction_is_not_play(with_play):
    """Friction of 1.6 times the healthy value adds wind-up of 20 % of the lost motion."""
    result = estimate(with_play, WITH_PLAY.times(coulomb=1.6), sensors=MOTOR_SPEED)
    assert judgement(result, of.PLAY) is Judgement.UNCHANGED
    assert judgement(result, of.FRICTION) is Judgement.CHANGED


def test_load_that_closes_the_play_does_not_change_it(with_play):
    closed = replace(WITH_PLAY, play=0.0, wind_up=0.0005, load=1.4)
    result = estimate(with_play, closed, sensors=MOTOR_SPEED)
    assert result.comparison is not None
    play = result.comparison[of.PLAY]
    assert (play.judgement, play.reason) == (Judgement.NOT_JUDGED, "a load closes the play")
    assert judgement(result, of.LOAD) is Judgement.CHANGED


def test_tracking_lag_is_the_delay_of_the_position_behind_the_command(plain):
    result = estimate(plain, PLAIN, sensors=Sensors(tracking_lag=0.04))
    assert result.comparison is not None
    lag = result.comparison[of.TRACKING]
    assert lag.judgement is Judgement.CHANGED
    assert lag.change == pytest.approx(1.0, abs=0.05)
    assert judgement(result, of.FRICTION) is Judgement.UNCHANGED


def test_tracking_is_not_judged_without_a_command():
    sensors = Sensors(command=False)
    result = estimate(calibrated(PLAIN, sensors), PLAIN, sensors=sensors)
    assert result.verdict == Verdict.VALID
    assert result.comparison is not None
    assert result.comparison[of.TRACKING].judgement is Judgement.NOT_JUDGED
    assert "no position command" in result.comparison[of.TRACKING].reason


@pytest.mark.parametrize(
    ("of_healthy", "of_record", "reason"),
    [
        ("none", "moves", "the healthy records have no position command"),
        ("rests", "moves", "the position command of the healthy records does not move enough"),
        ("moves", "none", "there is no position command"),
        ("moves", "rests", "the position command does not move enough"),
    ],
)
def test_reason_for_unjudged_tracking_names_the_missing_command(of_healthy, of_record, reason):
    def with_command(record: Window, kind: str) -> Window:
        command = record.telemetry.command
        changed = {"none": np.empty(0), "rests": np.zeros(len(command)), "moves": command}
        return replace(record, telemetry=replace(record.telemetry, command=changed[kind]))

    healthy = [with_command(window(record), of_healthy) for record in healthy_telemetry(PLAIN)]
    calibration = calibrate_joint(healthy, described())
    result = identify_record(
        with_command(measured(PLAIN), of_record), described(), calibration, force=True
    )
    assert result.comparison is not None
    assert result.comparison[of.TRACKING].judgement is Judgement.NOT_JUDGED
    assert result.comparison[of.TRACKING].reason == reason


def test_record_without_the_measured_speed_shows_no_play():
    healthy = calibrated(WITH_PLAY, MOTOR_SPEED)
    record = measured(WITH_PLAY, MOTOR_SPEED)
    without = replace(record, telemetry=replace(record.telemetry, speed=np.empty(0)))
    result = identify_record(without, described(MOTOR_SPEED), healthy)
    assert result.comparison is not None
    assert result.comparison[of.FRICTION].is_judged
    assert result.comparison[of.PLAY].judgement is Judgement.NOT_JUDGED
    assert result.comparison[of.PLAY].reason == "too few reversals, or no measured speed"


def test_record_with_a_gap_in_the_measured_speed_is_refused():
    healthy = calibrated(WITH_PLAY, MOTOR_SPEED)
    record = measured(WITH_PLAY, MOTOR_SPEED)
    speed = record.telemetry.speed.copy()
    speed[100] = np.nan
    with_gap = replace(record, telemetry=replace(record.telemetry, speed=speed))
    result = identify_record(with_gap, described(MOTOR_SPEED), healthy)
    assert result.verdict == Verdict.REFUSED
    assert "the speed is missing in some samples" in result.reason


# Other motion and model-free figures


def test_noise_of_the_effort_departs_in_a_figure_though_no_quantity_has_changed(plain):
    result = estimate(plain, PLAIN, sensors=Sensors(noise=0.1))
    assert result.verdict == Verdict.DEPARTED
    assert result.comparison is not None
    assert not result.comparison.changed
    assert "effort_roughness" in {figure.name for figure in result.comparison.figures}
    # The noise doubles. Half of the differences of the effort within 0.01 s is motion.
    roughness = next(
        figure.ratio for figure in result.comparison.figures if figure.name == "effort_roughness"
    )
    assert 1.5 < roughness < 2.0


def test_figures_of_another_motion_are_not_compared(plain):
    motion = tones(speed=0.7)
    result = estimate(plain, PLAIN, sensors=Sensors(noise=0.1), motion=motion)
    assert result.verdict == Verdict.VALID
    assert result.comparison is not None
    assert not result.comparison.figures


@pytest.mark.parametrize("speed", [0.4, 1.8])
def test_much_slower_or_faster_motion_is_not_judged(plain, speed):
    result = estimate(plain, PLAIN, motion=tones(speed=speed))
    assert (result.verdict, result.valid) == (Verdict.REFUSED, False)
    assert "expected 0.5 to 1.6 times" in result.reason
    found_speed = re.search(r"the speed is ([\d.]+) times", result.reason)
    assert found_speed is not None
    # The filter smooths faster motion more, and slower motion less.
    assert float(found_speed[1]) == pytest.approx(speed, rel=0.05)
    assert result.comparison is not None
    assert not result.comparison.judged
    assert {quantity.reason for quantity in result.comparison.quantities} == {result.reason}
    assert np.all(np.isnan(np.asarray(result.faults)))


@pytest.mark.parametrize(("speed", "size"), [(0.7, 1.0), (1.3, 1.0), (1.0, 0.7), (1.0, 1.3)])
def test_different_motion_within_the_range_gives_the_same_friction(plain, speed, size):
    motion = tones(speed=speed, size=size)
    result = estimate(plain, PLAIN.times(coulomb=1.3), motion=motion)
    assert result.comparison is not None
    assert result.comparison[of.FRICTION].change == pytest.approx(0.3, abs=0.035)
    assert judgement(result, of.FRICTION) is Judgement.CHANGED
    assert estimate(plain, PLAIN, motion=motion).verdict == Verdict.VALID


def test_record_of_another_rate_is_accepted_up_to_the_band_of_the_filter(plain):
    fine = measured(PLAIN, motion=tones(h=0.002))
    assert identify_record(fine, described(), plain).verdict == Verdict.VALID
    coarse = measured(PLAIN, motion=tones(200.0, h=0.2))
    result = identify_record(coarse, described(), plain)
    assert result.verdict == Verdict.REFUSED
    # 0.24 over the cut-off of 2.125 Hz.
    assert "the sample period is 0.2 s, at most 0.113 s can be compared" in result.reason


def test_record_of_another_rate_is_not_used_as_an_example_of_its_state(plain):
    """Its figures depend on the rate; its quantities are compared as usual."""
    record = comparable_record(measured(PLAIN, motion=tones(h=0.002)), described(), plain)
    assert isinstance(record, JointRecord)
    assert (record.figures, record.parts) == ({}, ())
    baseline = plain.baseline
    for number in range(3):
        late = replace(record, stamp_ns=record.stamp_ns + number * 10**15)
        baseline = baseline.with_record("dry", late)
    result = estimate(replace(plain, baseline=baseline), PLAIN)
    assert result.verdict == Verdict.VALID
    assert result.comparison is not None
    assert not result.comparison.states


# Refused records


def test_short_record_is_refused_with_its_strokes_or_rows(plain):
    for seconds, words in ((3.0, "at least 3 in each direction"), (0.8, "rows of steady motion")):
        result = estimate(plain, PLAIN, motion=tones(seconds))
        assert result.verdict == Verdict.REFUSED
        assert words in result.reason or "rows of steady motion" in result.reason
        assert result.comparison is not None
        assert len(result.comparison.quantities) == len(of.QUANTITIES)
        assert not result.comparison.judged


def test_short_end_of_a_motion_with_too_few_strokes_is_skipped(plain):
    window = replace(measured(PLAIN, motion=tones(3.0)), is_remainder=True)
    result = identify_record(window, described(), plain)
    assert result.verdict == Verdict.SKIPPED
    assert "rows of steady motion" in result.reason


def seized(**columns: np.ndarray) -> Window:
    """Return the record of a joint that seizes, as the monitor cuts it from the telemetry."""
    whole = measured(PLAIN).telemetry
    step = 2.0 * np.pi / 4096.0
    noise = step * np.random.default_rng(2).integers(0, 2, len(whole))
    whole = replace(whole, position=0.2 + noise, **columns)
    finder = WindowFinder(TriggerSettings(), described())
    [segment] = [*finder.feed(whole), *finder.finish()]
    assert isinstance(segment, Segment)
    assert isinstance(segment.window, Window)
    return segment.window


@pytest.mark.parametrize(("unit", "shown"), [("A", "A"), ("N.m", "N.m")])
def test_blocked_shaft_is_a_failure(plain, unit, shown):
    result = identify_record(seized(), described(), replace(plain, effort_unit=unit))
    assert (result.verdict, result.valid) == (Verdict.FAILED, False)
    assert "a blocked shaft, an open phase or a frozen sensor" in result.reason
    assert re.search(rf"at an effort of [\d.]+ {shown}:", result.reason)


def test_joint_that_is_not_driven_has_not_failed(plain):
    n = len(measured(PLAIN).telemetry)
    off = identify_record(seized(current=np.full(n, 0.02)), described(), plain)
    assert off.verdict == Verdict.REFUSED
    assert "is the drive off, a brake applied or a phase open?" in off.reason
    small = 0.1 * measured(PLAIN).telemetry.command
    stiction = replace(seized(), telemetry=replace(seized().telemetry, command=small))
    assert identify_record(stiction, described(), plain).verdict == Verdict.REFUSED
    rests = replace(seized(), telemetry=replace(seized().telemetry, command=np.zeros(n)))
    assert identify_record(rests, described(), plain).verdict == Verdict.REFUSED


@pytest.mark.parametrize(
    ("how", "verdict"),
    [
        ({}, Verdict.REFUSED),
        ({"is_dropped": True}, Verdict.SKIPPED),
        ({"is_cut_off": True}, Verdict.SKIPPED),
    ],
)
def test_refused_window_keeps_its_reason(plain, how, verdict):
    result = identify_record(Refusal(1, 2, StatedReason("some reason"), **how), described(), plain)
    assert (result.verdict, result.reason, result.valid) == (verdict, "some reason", False)


def test_missing_columns_are_named(plain, with_play):
    record = measured(PLAIN)
    blind = window(replace(record.telemetry, current=np.empty(0)))
    result = identify_record(blind, described(), plain)
    assert "no effort (current or torque) is measured" in result.reason
    lost = telemetry_of(WITH_PLAY, tones(), MOTOR_SPEED, day=LATER)
    lost = replace(lost, speed=np.full(len(lost), math.nan))
    result = identify_record(window(lost), described(MOTOR_SPEED), with_play)
    assert result.verdict == Verdict.REFUSED
    assert "the speed is missing in some samples" in result.reason


def test_calibration_of_another_unit_is_refused_unless_forced(plain):
    unit = replace(described(), serial_number="J2")
    record = measured(PLAIN.times(coulomb=1.3))
    result = identify_record(record, unit, plain)
    assert result.verdict == Verdict.REFUSED
    assert "the calibration does not fit" in result.reason
    assert "'J2'" in result.reason
    forced = identify_record(record, unit, plain, force=True)
    assert forced.verdict == Verdict.DEPARTED
    assert forced.reason.startswith("forced although ")
    assert forced.faults.friction == pytest.approx(0.15, abs=0.018)


# A late effort


def late(joint: Joint, lag_s: float) -> Window:
    record = measured(joint)
    telemetry = record.telemetry
    t = telemetry.sample_period * np.arange(len(telemetry))
    return replace(
        record, telemetry=replace(telemetry, current=np.interp(t - lag_s, t, telemetry.current))
    )


@pytest.mark.parametrize("lag_ms", [-20, 10, 50, 100])
@pytest.mark.parametrize("viscous", [1.0, 2.0])
def test_late_effort_is_reported_and_not_mistaken_for_viscous_friction(plain, lag_ms, viscous):
    result = identify_record(late(PLAIN.times(viscous=viscous), 1e-3 * lag_ms), described(), plain)
    assert result.comparison is not None
    changed = {quantity.name for quantity in result.comparison.changed}
    assert changed == ({of.VISCOUS} if viscous > 1.0 else set())
    [amount, way] = re.findall(r"The effort is (\d+) ms (later|earlier) than", result.reason)[0]
    assert int(amount) == pytest.approx(abs(lag_ms), abs=3)
    assert way == ("later" if lag_ms > 0 else "earlier")


def test_changed_friction_is_not_mistaken_for_a_lag(plain):
    for factor in (0.8, 1.3, 2.0):
        assert "The effort is" not in estimate(plain, PLAIN.times(coulomb=factor)).reason
    assert "The effort is" not in estimate(plain, PLAIN.times(viscous=2.0)).reason


# Another unit


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1e3, "thousandths read as whole units"),
        (1e-3, "whole units read as thousandths"),
        (-1.0, "is its sign reversed"),
        (17.0, "a wrong unit or sign, or a failed sensor"),
    ],
)
def test_factor_of_the_effort_is_named(plain, factor, words):
    record = measured(PLAIN)
    telemetry = replace(record.telemetry, current=factor * record.telemetry.current)
    refused = identify_record(replace(record, telemetry=telemetry), described(), plain)
    assert refused.verdict == Verdict.REFUSED
    assert words in refused.reason
    ratio = re.findall(r"the effort is (\S+) times", refused.reason)[0]
    assert float(ratio) == pytest.approx(factor, rel=0.1)


def with_effort(record: Window, current: np.ndarray) -> Window:
    return replace(record, telemetry=replace(record.telemetry, current=current))


@pytest.mark.parametrize("value", [0.0, 0.3, -7.0, 1e4])
@pytest.mark.parametrize("h", [0.01, 0.02])
def test_constant_effort_is_refused_as_a_failed_sensor(plain, value, h):
    record = measured(PLAIN, motion=tones(h=h))
    dead = with_effort(record, np.full(len(record.telemetry), value))
    refused = identify_record(dead, described(), plain)
    assert refused.verdict == Verdict.REFUSED
    assert "throughout, although the joint moves" in refused.reason
    assert "failed sensor" in refused.reason
    assert refused.comparison is not None
    assert not refused.comparison.judged


def test_constant_effort_is_not_a_healthy_record():
    windows = list(map(window, healthy_telemetry(PLAIN)))
    dead = with_effort(windows[4], np.zeros(len(windows[4].telemetry)))
    calibration = calibrate_joint([*windows[:4], dead, *windows[5:]], described())
    assert calibration.windows == len(windows) - 1
    with pytest.raises(ValueError, match="failed sensor"):
        calibrate_joint([dead], described())


def test_noise_alone_is_not_a_healthy_effort(plain):
    record = measured(PLAIN)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(record.telemetry))
    refused = identify_record(with_effort(record, noise), described(), plain)
    assert refused.verdict == Verdict.REFUSED
    assert "failed sensor" in refused.reason


@pytest.fixture(scope="module")
def friction_alone() -> JointCalibration:
    """Return the calibration of a joint whose motion shows no inertia."""
    healthy = healthy_telemetry(LIGHT, NOISY)
    calibration = calibrate_joint(list(map(window, healthy)), described())
    assert not calibration.baseline.shape.has_inertia
    return calibration


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1e3, "thousandths read as whole units"),
        (1e-3, "whole units read as thousandths"),
        (-1.0, "is its sign reversed"),
        (0.1, "a wrong unit or sign, or a failed sensor"),
        (30.0, "a wrong unit or sign, or a failed sensor"),
    ],
)
def test_factor_of_the_effort_is_named_by_friction_alone(friction_alone, factor, words):
    record = measured(LIGHT, NOISY)
    scaled = with_effort(record, factor * record.telemetry.current)
    refused = identify_record(scaled, described(), friction_alone)
    assert refused.verdict == Verdict.REFUSED
    assert words in refused.reason


@pytest.mark.parametrize("factor", [0.5, 3.0, 8.0])
def test_friction_alone_may_grow_several_times(friction_alone, factor):
    result = estimate(friction_alone, LIGHT.times(coulomb=factor), sensors=NOISY)
    assert result.verdict == Verdict.DEPARTED
    assert result.comparison is not None
    friction = result.comparison[of.FRICTION]
    assert friction.low < friction.high
    assert friction.change == pytest.approx(factor - 1.0, rel=0.05)


@pytest.mark.parametrize("late_s", [0.2, 0.25])
@pytest.mark.parametrize("viscous", [1.0, 1.6])
def test_negative_inertia_is_refused_as_a_late_effort(plain, viscous, late_s):
    record = measured(PLAIN.times(viscous=viscous))
    count = round(late_s / record.sample_period)
    refused = identify_record(
        with_effort(record, np.roll(record.telemetry.current, count)), described(), plain
    )
    assert refused.verdict == Verdict.REFUSED
    assert re.search(r"the (friction|inertia) is -", refused.reason)
    assert "is the effort delayed" in refused.reason


@pytest.mark.parametrize("factor", [0.1, 0.15, 0.25])
def test_torque_per_ampere_with_little_effort_has_a_value_and_an_interval(plain, factor):
    healthy = plain.baseline
    record = replace(healthy.records[0], stamp_ns=0, values=factor * healthy.healthy)
    torque = plain.comparer.compare(record)[of.TORQUE]
    assert torque.change == pytest.approx(1.0 / factor - 1.0, rel=0.02)
    assert torque.low < torque.change - 0.01
    assert not torque.high < torque.change + 0.01


def test_torque_per_ampere_without_effort_has_no_bound(plain):
    healthy = plain.baseline
    record = replace(healthy.records[0], stamp_ns=0, values=0.001 * healthy.healthy)
    comparison = plain.comparer.compare(record)
    torque = comparison[of.TORQUE]
    assert torque.change > 50.0
    assert math.isnan(torque.high)
    assert "nan" not in finding(comparison)


@pytest.mark.parametrize("scale", [1e-7, 1e-4, 1e5])
def test_changes_do_not_depend_on_the_unit_of_the_effort(plain, scale):
    windows = list(map(window, healthy_telemetry(PLAIN)))
    scaled = [with_effort(quantity, scale * quantity.telemetry.current) for quantity in windows]
    calibration = calibrate_joint(scaled, described())
    worn = measured(PLAIN.times(coulomb=1.3))
    expected = identify_record(worn, described(), plain).comparison
    actual = identify_record(
        with_effort(worn, scale * worn.telemetry.current), described(), calibration
    ).comparison
    assert expected is not None
    assert actual is not None
    names = [[quantity.name for quantity in item.changed] for item in (actual, expected)]
    assert names[0] == names[1]
    for name in (of.FRICTION, of.INERTIA, of.VISCOUS):
        quantities = actual[name], expected[name]
        ends = [(quantity.low, quantity.change, quantity.high) for quantity in quantities]
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-4)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (math.degrees(1.0), "is it in degrees"),
        (math.radians(1.0), "was in degrees"),
        (2.0 * math.pi, "was in turns"),
        (1e3, "thousandths read as whole units"),
    ],
)
def test_factor_of_the_position_is_named(plain, factor, words):
    record = measured(PLAIN)
    telemetry = replace(record.telemetry, position=factor * record.telemetry.position)
    refused = identify_record(replace(record, telemetry=telemetry), described(), plain)
    assert refused.verdict == Verdict.REFUSED
    assert words in refused.reason


def test_faster_motion_is_not_mistaken_for_a_wrong_column(plain):
    record = measured(PLAIN)
    telemetry = replace(record.telemetry, position=3.0 * record.telemetry.position)
    refused = identify_record(replace(record, telemetry=telemetry), described(), plain)
    assert "the speed is 3.1 times the speed of the healthy records" in refused.reason
    assert "is it" not in refused.reason
