"""A drive whose controller is unknown: what its current tells of friction, play and torque."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ema_core.acquisition import Acquisition
from ema_core.causes import CauseEstimate
from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.levels import OK, WARN
from ema_core.telemetry import Telemetry
from ema_monitor.api import find_windows
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import calibrate, load_calibration
from ema_monitor.current_balance.motion import MotorMotion, free_play
from ema_monitor.current_balance.unit import UnknownDriveUnit
from ema_monitor.diagnosis import Diagnosed, diagnose, identify
from ema_monitor.health import TORQUE_PER_AMPERE, HealthLimits, assess
from ema_monitor.identification.estimate import DEPARTED, estimate_of, estimate_record
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import ANY_MOTION, TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator

H = 1e-3
UNKNOWN = ActuatorDescription(serial_number="U-1", sample_period=H, drive="unknown")
WITHOUT_SPEED = replace(UNKNOWN, acquisition=Acquisition(speed=False))
TAU = UNKNOWN.parameters.tau
INERTIA, FRICTION, PLAY = 3e-4, 1.2, 0.02
"""Of the closed form, over the torque per ampere: A.s^2/rad, A; and the play at the motor, rad."""


def closed_form(
    friction: float = FRICTION,
    inertia: float = INERTIA,
    play: float = PLAY,
    load: float = 0.0,
    *,
    slow: bool = False,
    ways: tuple[float, ...] = (1.0, -1.0) * 4,
    dwell: int = 3,
) -> Window:
    """Moves with trapezoidal speed, and the current that they take by M40 to the last digit."""
    h = 0.02 if slow else H
    accelerated, steady, top = 0.1, 0.4 if slow else 0.2, 200.0
    current, speed = [np.zeros(3)], [np.zeros(3)]
    for number, way in enumerate(ways):
        rise = np.arange(1, round(accelerated / h) + 1) * h / accelerated
        fast = top * (1.0 - 0.3 * (number % 3))
        speed += [way * fast * np.r_[rise, np.ones(round(steady / h)), 1.0 - rise]]
        ramp = inertia * fast / accelerated * np.ones(len(rise))
        current += [way * (np.r_[ramp, np.zeros(round(steady / h)), -ramp] + friction)]
        speed.append(np.zeros(dwell))
        current.append(np.zeros(dwell))
    omega, amperes = np.concatenate(speed), np.concatenate(current) + load
    turned = np.concatenate([[0.0], np.cumsum(h * (omega[1:] + omega[:-1]) / 2.0)])
    shaft = followed(turned, play)
    error = TAU / 50.0 * omega
    position = TAU * shaft
    return Window(Telemetry(round(1e9 * h), h, 1, position + error, amperes, position, omega))


def followed(turned: NDArray[np.float64], play: float) -> NDArray[np.float64]:
    """Return the angle behind a play, begun in its middle."""
    at, angles = 0.0, []
    for angle in turned.tolist():
        at = min(max(at, angle - play / 2.0), angle + play / 2.0)
        angles.append(at)
    return np.array(angles)


def of_speed(*, measured: bool, slow: bool = False) -> ActuatorDescription:
    period = 0.02 if slow else H
    return replace(UNKNOWN, sample_period=period, acquisition=Acquisition(speed=measured))


def chirp_of(faults: Mapping[str, float], causes: Mapping[str, float], seed: int = 0) -> Window:
    """Return the chirp of the reference plant, whose controller the monitor is not told."""
    actuator = SimulatedActuator(sample_period=H)
    actuator.faults, actuator.causes = dict(faults), dict(causes)
    actuator.advance(np.zeros(1 + seed % 5))
    telemetry = actuator.advance(build_cycle(THESIS_CHIRP, H).samples)
    noise = 0.05 * np.random.default_rng(seed).standard_normal(len(telemetry))
    telemetry = replace(telemetry, current=telemetry.current + noise)
    return find_windows(telemetry, UNKNOWN)[0]


def unit_of(windows: Sequence[Window], description: ActuatorDescription) -> UnknownDriveUnit:
    made = calibrate(windows, description)
    assert isinstance(made, UnknownDriveUnit)
    return made


@pytest.fixture(scope="module")
def healthy() -> list[Window]:
    return [chirp_of({}, {}, seed=seed) for seed in range(5)]


@pytest.fixture(scope="module")
def unit(healthy) -> UnknownDriveUnit:
    return unit_of(healthy, UNKNOWN)


@pytest.fixture(scope="module")
def unit_without_speed(healthy) -> UnknownDriveUnit:
    return unit_of(healthy, WITHOUT_SPEED)


@pytest.mark.parametrize("slow", [False, True])
@pytest.mark.parametrize("measured", [True, False])
def test_inertia_and_friction_of_the_closed_form_are_found(measured, slow):
    made = unit_of([closed_form(slow=slow)], of_speed(measured=measured, slow=slow))
    # Exact but for the priors of the terms, a hundredth, and the samples in which the speed bends.
    assert made.terms[0] == pytest.approx(INERTIA, rel=0.03)
    assert made.terms[1] == pytest.approx(FRICTION, rel=0.01)


def test_plateaus_to_and_fro_tell_friction_from_load():
    description = of_speed(measured=False, slow=True)
    made = calibrate([closed_form(slow=True)], description)
    estimate = identify(closed_form(1.6 * FRICTION, load=0.5, slow=True), description, made)
    assert estimate.faults.friction == pytest.approx(0.3, abs=0.02)
    load = next(one for one in estimate.causes if one.name == "load_torque")
    assert load.value == pytest.approx(0.5 * description.parameters.k_t, rel=0.02)
    [told] = re.findall(r"follows the direction ([\d.]+) .* A, \+([\d.]+) ± ", estimate.reason)
    assert float(told[0]) == pytest.approx(1.6 * FRICTION, rel=0.02)
    assert float(told[1]) == pytest.approx(60.0, abs=2.0)


@pytest.mark.parametrize("dwell", [3, 100, 1000])
def test_play_is_seen_across_a_dwell_however_long(dwell):
    unit = unit_of([closed_form(dwell=dwell)] * 3, of_speed(measured=True))
    assert unit.play == pytest.approx(PLAY, rel=0.01)
    assert unit.terms[1] == pytest.approx(FRICTION, rel=0.01)


def test_motion_one_way_does_not_tell_friction_from_load():
    description = of_speed(measured=True)
    made = calibrate([closed_form()], description)
    estimate = identify(closed_form(ways=(1.0,) * 6), description, made)
    assert math.isnan(estimate.sigma.friction)
    assert "goes one way" in estimate.reason
    assert "follows the direction" not in estimate.reason


@pytest.mark.parametrize("measured", [True, False])
@pytest.mark.parametrize("width", [0.0, 0.02, 0.3])
def test_play_is_what_the_motor_turns_while_the_shaft_reverses(measured, width):
    window = closed_form(play=width)
    found = free_play(MotorMotion.of(window.telemetry, of_speed(measured=measured)))
    assert found is not None
    # Without a speed, the law of the loop is fitted; its error is sampled, here to 1 %.
    assert found.width == pytest.approx(width, rel=1e-3 if measured else 0.05, abs=2e-3)
    assert found.reversals == 7


def test_filtered_current_is_that_before_the_filter():
    window, T = closed_form(), 5e-3
    share, held, seen = -math.expm1(-H / T), 0.0, []
    for value in window.telemetry.current.tolist():
        held += share * (value - held)
        seen.append(held)
    filtered = replace(window.telemetry, current=np.array(seen))
    description = replace(UNKNOWN, acquisition=Acquisition("filtered", T))
    made = unit_of([Window(filtered)], description)
    assert made.terms[:2] == pytest.approx([INERTIA, FRICTION], rel=0.03)


# Errors of the reference plant at 1 kHz are 0.3 to 1.3 %; 2 % is what is asked for.
@pytest.mark.parametrize(
    ("faults", "causes"),
    [
        ({"friction": 0.3}, {}),
        ({"friction": 0.7, "backlash": 0.4}, {"load_torque": 0.1}),
        ({"backlash": 0.1}, {"torque_constant": -0.15}),
    ],
)
def test_friction_backlash_and_torque_are_within_two_percent(unit, faults, causes):
    estimate = identify(chirp_of(faults, causes, seed=11), UNKNOWN, unit)
    assert estimate.faults.friction == pytest.approx(faults.get("friction", 0.0), abs=0.02)
    assert estimate.faults.backlash == pytest.approx(faults.get("backlash", 0.0), abs=0.02)
    torque = next(one for one in estimate.causes if one.name == "torque_constant")
    assert torque.value == pytest.approx(causes.get("torque_constant", 0.0), abs=0.02)
    hidden = np.isnan(np.array(estimate.faults))
    assert list(hidden) == [False, False, True, True, True, False, True, True]


def test_position_error_and_current_show_the_same_without_a_speed(unit_without_speed):
    faults, causes = {"friction": 0.5, "backlash": 0.3}, {"torque_constant": -0.2}
    window = chirp_of(faults, causes, seed=12)
    estimate = identify(window, WITHOUT_SPEED, unit_without_speed)
    assert estimate.faults.friction == pytest.approx(0.5, abs=0.03)
    assert estimate.faults.backlash == pytest.approx(0.3, abs=0.02)
    torque = next(one for one in estimate.causes if one.name == "torque_constant")
    assert torque.value == pytest.approx(-0.2, abs=0.02)
    # A speed column that is not measured is not looked at.
    nothing = np.full(len(window.telemetry), np.nan)
    without = replace(window, telemetry=replace(window.telemetry, speed=nothing))
    again = identify(without, WITHOUT_SPEED, unit_without_speed)
    assert np.array_equal(again.faults, estimate.faults, equal_nan=True)


def test_healthy_unit_is_healthy(unit):
    estimate = identify(chirp_of({}, {}, seed=13), UNKNOWN, unit)
    assert estimate.verdict == "valid"
    assert estimate.insignificant[[0, 1, 5]].all()
    health = assess(estimate, HealthLimits())
    assert (health.level, health.requirements[0].name) == (OK, TORQUE_PER_AMPERE)


def test_loss_of_torque_is_judged_unless_it_was_measured(unit):
    window = chirp_of({}, {"torque_constant": -0.2}, seed=14)
    estimate = identify(window, UNKNOWN, unit)
    assert estimate.verdict == "degraded"
    assert ("torque constant", "current sensor gain") in estimate.alternatives
    health = assess(estimate, HealthLimits())
    assert (health.level, health.dominant_fault) == (WARN, "")
    assert health.requirements[0].value == pytest.approx(0.8, abs=0.02)
    again = estimate_of(estimate_record(estimate))
    assert assess(again, HealthLimits()).requirements == health.requirements

    window = replace(window, measured=(CauseEstimate("torque_constant", -0.2, 0.005),))
    estimate = identify(window, UNKNOWN, unit)
    assert estimate.verdict == "valid"
    assert assess(estimate, HealthLimits()).level == OK


def test_more_inertia_is_not_taken_for_a_loss_of_torque_and_of_friction(unit):
    estimate = identify(chirp_of({}, {"inertia": 0.2}, seed=15), UNKNOWN, unit)
    assert [one.name for one in estimate.causes] == ["inertia"]
    assert estimate.causes[0].value == pytest.approx(0.2, abs=0.02)
    assert (estimate.faults.friction, estimate.verdict) == (0.0, "degraded")


@pytest.mark.parametrize(
    ("faults", "causes", "said"),
    [
        ({"short_circuit_a": 0.3}, {}, "4 and 8 times a turn of the motor (phases that differ)"),
        ({}, {"cogging": 0.02}, "12 times a turn of the motor (cogging)"),
        ({}, {"friction_ripple": 0.3}, "1 times a turn of the motor (friction once a turn)"),
        ({"eccentricity": 0.3}, {}, ""),
    ],
)
def test_torque_that_repeats_with_the_angle_is_named(unit, faults, causes, said):
    estimate = identify(chirp_of(faults, causes, seed=16), UNKNOWN, unit)
    assert said in estimate.reason
    # Two of the waves of an eccentricity are fitted, over less than a turn of the motor.
    assert estimate.faults.eccentricity == pytest.approx(faults.get("eccentricity", 0.0), abs=0.05)


def test_load_that_keeps_the_gear_on_one_flank_hides_the_backlash():
    description = of_speed(measured=True)
    made = calibrate([closed_form()], description)
    estimate = identify(closed_form(play=0.0, load=0.9 * FRICTION), description, made)
    assert math.isnan(estimate.sigma.backlash)
    assert "backlash is hidden" in estimate.reason
    # A play as wide as the healthy one is seen to be there.
    seen = identify(closed_form(load=0.9 * FRICTION), description, made)
    assert seen.sigma.backlash < 0.01


def test_standstill_is_refused_with_its_current(unit):
    estimate = identify(chirp_of({}, {"jam": 1.0}, seed=18), UNKNOWN, unit)
    assert not estimate.valid
    assert "the motor stands still although the command moves" in estimate.reason


def test_calibration_of_a_known_drive_does_not_serve(unit):
    window = chirp_of({}, {}, seed=19)
    refused = identify(window, UNKNOWN, Calibration.builtin())
    assert "drive = unknown" in refused.reason
    known = replace(UNKNOWN, drive="six_step")
    assert "drive = six_step" in identify(window, known, unit).reason


def test_calibration_survives_its_file(unit, tmp_path):
    unit.save(tmp_path / "unit.yaml")
    loaded = load_calibration(tmp_path / "unit.yaml")
    assert loaded.calibration_id == unit.calibration_id
    text = (tmp_path / "unit.yaml").read_text().replace("noise: ", "noise: -")
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(ValueError, match=r"bad.yaml is a damaged calibration: noise = -"):
        load_calibration(tmp_path / "bad.yaml")


def test_calibration_says_what_the_motion_did_not_show():
    made = calibrate([closed_form(ways=(1.0, -1.0))], of_speed(measured=True))
    assert "backlash" in made.not_learned
    telemetry = closed_form().telemetry
    without = Window(replace(telemetry, current=np.zeros(len(telemetry))))
    with pytest.raises(ValueError, match="the current is 0 throughout"):
        calibrate([without], of_speed(measured=True))


@pytest.mark.parametrize(("frequency_hz", "is_claimed"), [(12.0, True), (2.0, False)])
def test_stretches_of_a_calibrated_motion_are_fitted_together(unit, frequency_hz, is_claimed):
    actuator = SimulatedActuator(sample_period=H)
    actuator.faults = {"friction": 0.3}
    t = np.arange(0.0, 6.0, H)
    telemetry = actuator.advance(6e-3 * np.sin(2.0 * np.pi * frequency_hz * t), 0.05)
    finder = WindowFinder(TriggerSettings(windows=ANY_MOTION), UNKNOWN)
    stretches = [event for event in finder.feed(telemetry) if isinstance(event, Segment)]
    found = list(diagnose(stretches, unit, combining=CombinationSettings(pause_s=0.0)))
    assert found
    assert isinstance(found[0], Diagnosed)
    if not is_claimed:
        assert not found[0].estimate.valid
        outside = "outside the calibrated motion: 0.17 times as fast as the nearest healthy window"
        assert found[0].estimate.reason.startswith(outside)
        return
    assert found[0].estimate.stretches > 0
    assert found[0].estimate.faults.friction == pytest.approx(0.3, abs=0.03)


def test_stretches_that_nothing_explains_depart_together(unit):
    """The balance gives no estimate of them; their figures are not those of healthy windows."""
    stretches = []
    for number, noise_a in enumerate((0.05, 1.0, 1.0, 1.0)):
        window = chirp_of({}, {}, seed=10 + number)
        noise = noise_a * np.random.default_rng(number).standard_normal(len(window) + 1)
        later = replace(window.telemetry, current=window.telemetry.current + noise)
        stretches.append(Segment(number, UNKNOWN, replace(window, telemetry=later)))
    many = CombinationSettings(wanted_sigma=1e-3)
    (found,) = diagnose(stretches[1:], unit, combining=many)
    assert isinstance(found, Diagnosed)
    assert (found.estimate.verdict, found.estimate.valid) == (DEPARTED, False)
    assert found.estimate.stretches == 3
    assert "the scatter of the current in the forward stroke" in found.estimate.reason
    (found,) = diagnose(stretches[:1], unit, combining=many)
    assert isinstance(found, Diagnosed)
    assert found.estimate.valid


def test_slow_samples_have_longer_stretches():
    slow = replace(UNKNOWN, sample_period=0.04)
    t = 0.04 * np.arange(1100.0)
    command = 0.1 * np.sin(0.5 * t)
    telemetry = Telemetry(0, 0.04, 1, command, np.cos(0.5 * t), command, 25.0 * np.cos(0.5 * t))
    found = find_windows(telemetry, slow, TriggerSettings(windows=ANY_MOTION))
    assert [len(one) for one in found] == [500, 500]
