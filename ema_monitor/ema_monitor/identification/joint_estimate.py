"""Estimate of a record whose controller is not modelled, by comparison with its baseline."""

import math
import time
from dataclasses import replace
from typing import Final

import numpy as np

from ema_core.causes import CauseEstimate
from ema_core.description import ActuatorDescription
from ema_core.faults import BACKLASH, FAULT_BY_NAME, FRICTION, N_FAULTS, FaultVector
from ema_core.wording import counted
from ema_monitor.calibration.joint_calibration import JointCalibration, winding_temperature
from ema_monitor.identification.defects import usual_mistake
from ema_monitor.identification.estimate import (
    DEPARTED,
    FAILED,
    INVERSE_DYNAMICS,
    REFUSED,
    SKIPPED,
    VALID,
    Estimate,
)
from ema_monitor.joint import comparison as of
from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.comparison import Comparison, QuantityChange
from ema_monitor.joint.lag import EffortLag, aligned, effort_lag, with_shift
from ema_monitor.joint.record import JointRecord, defect_of, read_record
from ema_monitor.joint.shape import DRY, INERTIA
from ema_monitor.joint.shape import VISCOUS as VISCOUS_AT
from ema_monitor.joint.signals import Fine, block_means, filtered, usual_speed
from ema_monitor.joint.single import Z90
from ema_monitor.joint.spikes import despiked
from ema_monitor.joint.wording import summary
from ema_monitor.joint.zero import zero_shift
from ema_monitor.windows.records import stands_still
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_LEAST_VISCOUS: Final = 0.05
_LARGE_EFFORT: Final = 0.9
"""Quantile of the size of the effort that a joint at rest is judged by [-]."""
_ACTING: Final = 0.5
"""Effort that moves a healthy joint, over its dry friction, at least [-]."""
_FAR: Final = 0.5
"""Least travel of the command over the travel of the healthy records [-]."""
_OTHER_UNIT: Final = 5.0
_OTHER_FRICTION: Final = 20.0
_BEYOND_DOUBT: Final = 4.0
_LEAST_ZERO: Final = 0.03
"""Smallest angle that is named as another zero of the position [rad]."""
_GAIN_OF_ZERO: Final = 1.2
"""By how much another zero has to lower the residual of the effort, if the changes explain the
coefficients as well [-]."""
_OF_ZERO: Final = 9.0
"""By how much another zero has to explain a record better than the changes."""
_EXPLAINED: Final = 1.5
"""By how much a delay has to explain a record better than the changes alone, to be likelier."""
_CAUSES: Final = {
    of.TORQUE: "torque_constant",
    of.INERTIA: "inertia",
    of.VISCOUS: "viscous_friction",
    of.LOAD: "load_torque",
}
"""Hidden cause of each quantity that is no fault."""
_FAULTS: Final = {of.FRICTION: FRICTION, of.PLAY: BACKLASH}
"""Number of the fault of each quantity that is one."""


def identify_record(
    window: Window | Refusal,
    description: ActuatorDescription,
    calibration: JointCalibration,
    *,
    force: bool = False,
) -> Estimate:
    """Return the estimate of a record, or its refusal with the reason.

    Parameters
    ----------
    window, description, calibration
        The record, or why there is none; its actuator, and the calibration.
    force
        Make an estimate although the calibration is of another unit.
    """
    started = time.perf_counter()
    if isinstance(window, Refusal):
        is_lost = window.is_dropped or window.is_cut_off
        return _refused(window, calibration, window.reason, SKIPPED if is_lost else REFUSED)
    mismatch = calibration.unit_mismatch(description)
    if mismatch and not force:
        reason = f"the calibration does not fit: {mismatch}"
        return _refused(window, calibration, reason, lacks_calibration=True)
    if reason := calibration.shape_mismatch(window):
        return _refused(window, calibration, reason, lacks_calibration=True)
    if reason := _missing(window):
        return _refused(window, calibration, reason)
    reason, verdict = _standstill(window, calibration)
    if reason:
        return _refused(window, calibration, reason, verdict)
    window, spikes = _without_spikes(window, calibration)
    record = _record_of(window, description, calibration)
    if isinstance(record, str):
        return _refused(window, calibration, record, comparison=of.not_judged(record))
    if reason := _other_unit(record, calibration.baseline, description):
        return _refused(window, calibration, reason, comparison=of.not_judged(reason))
    comparison = calibration.comparer.compare(record)
    torque = comparison[of.TORQUE]
    if torque in comparison.changed and torque.change <= -1.0:
        reason = (
            "the effort has the other sign than in the healthy records, or follows another joint: "
            "compare the mapping with that of the healthy records"
        )
        return _refused(window, calibration, reason, comparison=of.not_judged(reason))
    faults, covariance, insignificant = _faults(comparison)
    caveat = [f"forced although {mismatch}"] if mismatch else []
    return Estimate(
        window.start_ns,
        window.end_ns,
        INVERSE_DYNAMICS,
        0,
        calibration.calibration_id,
        faults=faults,
        covariance=covariance,
        unobservable=np.isnan(np.asarray(faults)),
        insignificant=insignificant,
        excitation=float(np.ptp(window.telemetry.position)),
        evaluations=1,
        computing_time_s=time.perf_counter() - started,
        valid=True,
        reason=". ".join(
            [
                *caveat,
                summary(comparison),
                *_zero_note(window, description, calibration, record, comparison),
                *_notes(window, record, spikes),
            ]
        ),
        calibration_windows=calibration.windows,
        verdict=DEPARTED if comparison.has_departed else VALID,
        causes=tuple(_causes(comparison, calibration)),
        measured=window.measured,
        comparison=comparison,
    )


def comparable_record(
    window: Window, description: ActuatorDescription, calibration: JointCalibration
) -> JointRecord | str:
    """Return what a record shows, or why it cannot be compared with the baseline."""
    reason = _unusable(window, calibration)
    if reason:
        return reason
    return _record_of(_without_spikes(window, calibration)[0], description, calibration)


def _without_spikes(window: Window, calibration: JointCalibration) -> tuple[Window, int]:
    """Return a record without spikes of the effort, and how many samples were replaced."""
    telemetry, count = despiked(window.telemetry, calibration.baseline.preparation.cutoff_hz)
    return (replace(window, telemetry=telemetry) if count else window), count


def _unusable(window: Window, calibration: JointCalibration) -> str:
    """Return why the samples of a record cannot be compared; empty when they can."""
    return calibration.shape_mismatch(window) or _missing(window)


def _record_of(
    window: Window, description: ActuatorDescription, calibration: JointCalibration
) -> JointRecord | str:
    """Return what usable samples show, or why their motion cannot be compared."""
    preparation = calibration.baseline.preparation
    fine = block_means(window.telemetry, description, preparation.cutoff_hz)
    healthy = [one.effort_lag for one in calibration.baseline.records]
    lag = with_shift(effort_lag(fine, preparation), healthy, preparation.cutoff_hz)
    record = _read(window, description, calibration, fine, lag)
    if lag.shift_s and not lag.is_certain:
        plain = _read(window, description, calibration, fine, lag.unshifted)
        if isinstance(record, str) or isinstance(plain, str):
            return plain
        unexplained = calibration.comparer.unexplained
        return record if unexplained(plain) - unexplained(record) > _EXPLAINED else plain
    return record


def _read(
    window: Window,
    description: ActuatorDescription,
    calibration: JointCalibration,
    fine: Fine,
    lag: EffortLag,
) -> JointRecord | str:
    """Return what a record shows with the effort moved, or why it cannot be compared."""
    baseline = calibration.baseline
    fine = aligned(fine, lag)
    signals = filtered(fine, baseline.preparation)
    if reason := defect_of(signals, baseline.preparation):
        return "; ".join(filter(None, (reason, _wrong_speed(fine, description, baseline))))
    record = read_record(
        window.telemetry,
        description,
        baseline.preparation,
        baseline.shape,
        healthy=baseline.healthy,
        temperature=winding_temperature(window),
        prepared=(fine, signals),
        effort_lag=lag,
    )
    return record.at_rate(window.sample_period, calibration.sample_period)


def _refused(
    window: Window | Refusal,
    calibration: JointCalibration,
    reason: str,
    verdict: str = REFUSED,
    comparison: Comparison | None = None,
    *,
    lacks_calibration: bool = False,
) -> Estimate:
    return Estimate(
        window.start_ns,
        window.end_ns,
        INVERSE_DYNAMICS,
        0,
        calibration.calibration_id,
        reason=reason,
        calibration_windows=calibration.windows,
        verdict=verdict,
        lacks_calibration=lacks_calibration,
        comparison=comparison,
    )


def _missing(window: Window) -> str:
    """Return which column a record lacks; empty when it has what it needs.

    A speed is not needed: without it, play is not judged.
    """
    telemetry = window.telemetry
    if not len(telemetry.current):
        return "drive = unknown needs a measured current or torque, and the telemetry has none"
    if not np.all(np.isfinite(telemetry.speed)):
        return "the speed is not measured in some samples: leave them out, or the whole speed"
    return ""


def _standstill(window: Window, calibration: JointCalibration) -> tuple[str, str]:
    """Return why a joint stands still although it is commanded to move, and the verdict.

    Both are empty if it moves. It has failed if the command travels as far as in healthy records,
    nearly, and the effort is not far below the friction: a drive that is off moves nothing either.
    """
    telemetry = window.telemetry
    if not stands_still(telemetry):
        return "", ""
    baseline, (unit, scale) = calibration.baseline, calibration.effort_shown
    effort = float(np.quantile(np.abs(telemetry.current), _LARGE_EFFORT))
    still = (
        f"the joint stands still although the command travels {np.ptp(telemetry.command):.2g} rad"
    )
    at = f"at an effort of {scale * effort:.2g} {unit}"
    if effort < _ACTING * baseline.friction:
        friction = f"the healthy friction is {scale * baseline.friction:.2g} {unit}"
        asked = "is the drive off, a brake on or a phase open?"
        return f"{still} {at}, and {friction}: {asked}", REFUSED
    least = _FAR * min(one.travel for one in baseline.records)
    if np.ptp(telemetry.command) < least:
        return f"{still}: command at least {least:.2g} rad, as the healthy records do", REFUSED
    return f"{still} {at}: a blocked shaft, an open phase or a frozen sensor", FAILED


def _wrong_speed(fine: Fine, description: ActuatorDescription, baseline: Baseline) -> str:
    """Return which usual mistake scales the speed of a record; empty if it is none of them."""
    preparation = baseline.preparation
    factor = usual_speed(fine, preparation.cutoff_hz) / preparation.usual_speed
    if 1.0 / _OTHER_UNIT < factor < _OTHER_UNIT:
        return ""
    column = "position" if fine.speed is None else "speed"
    asked = usual_mistake(column, factor, description.parameters)
    return f"the {column} changes {factor:.3g} times as fast as in them: {asked}" if asked else ""


def _other_unit(record: JointRecord, baseline: Baseline, description: ActuatorDescription) -> str:
    """Return why the effort of a record cannot be that of the unit; empty where it can.

    Friction alone may grow several times. With inertia it does so by another unit, sign or sensor.
    Friction and inertia below 0 are of another sign, or of an effort that is late.
    """
    shown = [DRY, INERTIA] if baseline.shape.has_inertia else [DRY]
    healthy = baseline.healthy[shown]
    ratios = record.values[shown] / healthy
    errors = np.hypot(np.sqrt(np.diag(record.covariance)), baseline.motion_errors(record))[shown]
    is_negative = ratios < -_BEYOND_DOUBT * np.abs(errors / healthy)
    highest = _OTHER_UNIT if baseline.shape.has_inertia else _OTHER_FRICTION
    is_scaled = np.all(ratios > highest) or np.all(ratios < 1.0 / _OTHER_UNIT)
    # The friction is better determined than the inertia.
    factor = float(ratios[0])
    asked = usual_mistake("current", factor, description.parameters) if is_scaled else ""
    if is_scaled and (asked or not np.any(is_negative)):
        return (
            f"the effort is {factor:.3g} times that of the healthy records: "
            f"{asked or 'another unit or sign, or a failed sensor'}; compare the mapping with that "
            "of the healthy records"
        )
    if np.any(is_negative):
        at = int(np.argmax(is_negative))
        return (
            f"the {('friction', 'inertia')[at]} is {ratios[at]:.2g} times that of the healthy "
            "records, expected above 0: is the effort late by more than 0.1 s, of another sign, or "
            "of another joint? Compare the mapping and the clocks with those of the healthy records"
        )
    return ""


def _zero_note(
    window: Window,
    description: ActuatorDescription,
    calibration: JointCalibration,
    record: JointRecord,
    comparison: Comparison,
) -> list[str]:
    """Return whether another zero of the position explains a record better, as sentences."""
    baseline, comparer = calibration.baseline, calibration.comparer
    if not (baseline.shape.has_gravity and comparison.has_departed):
        return []
    fine = block_means(window.telemetry, description, baseline.preparation.cutoff_hz)
    signals = filtered(aligned(fine, record.effort_lag), baseline.preparation)
    shift, gain = zero_shift(baseline.shape, signals)
    if abs(shift) < _LEAST_ZERO:
        return []
    telemetry = window.telemetry
    moved = replace(
        telemetry, position=telemetry.position - shift, command=telemetry.command - shift
    )
    turned = _record_of(replace(window, telemetry=moved), description, calibration)
    if isinstance(turned, str):
        return []
    better = comparer.unexplained(record) - comparer.unexplained(turned)
    if better < (0.0 if gain > _GAIN_OF_ZERO else _OF_ZERO):
        return []
    return [
        f"Or the position counts from another zero: the record agrees better if it is "
        f"{abs(shift):.2f} rad {'more' if shift > 0.0 else 'less'} than in the healthy records: "
        "check the homing"
    ]


def _notes(window: Window, record: JointRecord, spikes: int) -> list[str]:
    """Return what qualifies the samples of a record, as sentences."""
    notes = []
    if shift_s := record.effort_lag.shift_s:
        notes.append(
            f"The effort is {1e3 * abs(shift_s):.0f} ms {'later' if shift_s > 0.0 else 'earlier'} "
            "than in the healthy records, which is corrected: look for another filter, driver or "
            "clock of the effort"
        )
    if spikes:
        count = counted(spikes, "spike")
        notes.append(
            f"The effort has {count} in {len(window.telemetry)} samples, which "
            f"{'is' if spikes == 1 else 'are'} left out: look for a disturbed sensor or bus"
        )
    if lost := int(np.count_nonzero(window.telemetry.interpolated)):
        count = counted(lost, "lost sample")
        notes.append(f"{count} of {len(window.telemetry)} interpolated")
    return notes


def _faults(comparison: Comparison) -> tuple[FaultVector, np.ndarray, np.ndarray]:
    """Return the faults that quantities stand for, their covariance, and which are healthy."""
    values, variances = np.full(N_FAULTS, math.nan), np.full(N_FAULTS, math.nan)
    insignificant = np.zeros(N_FAULTS, dtype=bool)
    for name, number in _FAULTS.items():
        one = comparison[name]
        if not one.is_estimated:
            continue
        slope = FAULT_BY_NAME[FaultVector._fields[number]].slope
        values[number] = max(one.change, 0.0) / slope
        variances[number] = (_sigma(one) / slope) ** 2
        insignificant[number] = one not in comparison.changed or one.change <= 0.0
    return FaultVector.of(values), np.diag(variances), insignificant


def _causes(comparison: Comparison, calibration: JointCalibration) -> list[CauseEstimate]:
    """Return the hidden causes that quantities stand for which have changed and are named."""
    found = []
    for one in comparison.changed:
        if one.name in _CAUSES and not one.rivals:
            scale = _cause_scale(one.name, calibration)
            if scale is not None and math.isfinite(_sigma(one)):
                name = _CAUSES[one.name]
                found.append(CauseEstimate(name, scale * one.change, scale * _sigma(one)))
    return found


def _cause_scale(name: str, calibration: JointCalibration) -> float | None:
    """Return the cause for a change of 1 of its quantity; None where the cause is unknown.

    A relative change of viscous friction needs healthy viscous friction to compare with.
    """
    baseline = calibration.baseline
    if name == of.LOAD:
        return calibration.torque_scale
    if name != of.VISCOUS:
        return 1.0
    healthy, scale = float(baseline.healthy[VISCOUS_AT]), baseline.viscous_scale
    return scale / healthy if healthy > _LEAST_VISCOUS * scale else None


def _sigma(one: QuantityChange) -> float:
    return (one.high - one.low) / (2.0 * Z90)
