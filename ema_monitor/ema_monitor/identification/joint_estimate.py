# SPDX-License-Identifier: Apache-2.0
"""Estimate for a unit whose controller is not modelled, from a record and a baseline."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ema_core.causes import CauseEstimate
from ema_core.columns.of_records import (
    has_other_updates,
    wrong_effort_of_record,
    wrong_speed_of_record,
)
from ema_core.description import ActuatorDescription
from ema_core.faults import FAULT_BY_NAME, FAULT_NAMES, N_FAULTS, FaultVector
from ema_core.linear import angle_shown
from ema_core.telemetry import Telemetry
from ema_monitor import quantities as of
from ema_monitor.calibration.joint_calibration import JointCalibration, winding_temperature
from ema_monitor.identification.estimate import INVERSE_DYNAMICS, Estimate, Verdict
from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.comparison import Comparison, QuantityChange, not_judged
from ema_monitor.joint.curve import FrictionCurve, friction_curve
from ema_monitor.joint.lag import EffortLag, aligned, effort_lag, with_shift
from ema_monitor.joint.record import JointRecord, read_record, record_defect
from ema_monitor.joint.renewal import renewed, samples_per_update
from ema_monitor.joint.scale import effort_scale
from ema_monitor.joint.shape import VISCOUS as VISCOUS_AT
from ema_monitor.joint.signals import Fine, Signals, filtered, usual_speed
from ema_monitor.joint.single import Z90
from ema_monitor.joint.spikes import despiked
from ema_monitor.joint.standstill import standstill_of
from ema_monitor.joint.zero import zero_shift
from ema_monitor.reasons import (
    EffortMissing,
    EffortReversed,
    EffortScaled,
    EffortShifted,
    NegativeQuantity,
    OtherUnit,
    OtherUpdates,
    OtherZero,
    PayloadMissing,
    PeriodTooLong,
    Reason,
    SamplesInterpolated,
    SpeedGaps,
    SpeedScaled,
    SpikesRemoved,
    StandstillCause,
    TooFewRows,
    TooFewStrokes,
    mistake_row,
)
from ema_monitor.windows.records import stands_still
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_LEAST_VISCOUS: Final = 0.05
_LEAST_ZERO: Final = 0.03
"""Smallest reported shift of the position zero [rad]."""
_GAIN_OF_ZERO: Final = 1.2
"""Factor by which a shifted zero must reduce the effort residual if the changes explain the
coefficients equally well [-]."""
_OF_ZERO: Final = 9.0
"""Smallest advantage at which a shifted zero explains a record better than the changes [-]."""
_EXPLAINED: Final = 1.5
"""Smallest advantage at which a delay explains a record better than the changes alone [-]."""
_CAUSES: Final = {
    of.TORQUE: "torque_constant",
    of.INERTIA: "inertia",
    of.VISCOUS: "viscous_friction",
    of.LOAD: "load_torque",
}
"""Hidden cause of each quantity that does not correspond to a fault."""


def identify_record(
    window: Window | Refusal,
    description: ActuatorDescription,
    calibration: JointCalibration,
    *,
    force: bool = False,
) -> Estimate:
    """Return the estimate of a record, or a refusal with its reason.

    Parameters
    ----------
    window
        The record, or its refusal, which is returned as a refused estimate with the same cause.
    description
        Description of the actuator.
    calibration
        Calibration of the unit.
    force
        Whether to accept the calibration of a different unit.
    """
    started = time.perf_counter()
    if isinstance(window, Refusal):
        is_lost = window.is_dropped or window.is_cut_off
        verdict = Verdict.SKIPPED if is_lost else Verdict.REFUSED
        return _refused(window, calibration, window.cause, verdict=verdict)
    mismatch = calibration.unit_mismatch(description)
    if mismatch and not force:
        return _refused(window, calibration, OtherUnit(mismatch), lacks_calibration=True)
    if unusable := _unusable(window, calibration):
        is_other = isinstance(unusable, PeriodTooLong)
        return _refused(window, calibration, unusable, lacks_calibration=is_other)
    if stands_still(window.telemetry):
        standstill = standstill_of(window.telemetry, calibration.baseline)
        still = standstill.reason(calibration.effort_shown, angle_shown(description.parameters))
        has_failed = standstill.cause is StandstillCause.FAILURE
        verdict = Verdict.FAILED if has_failed else Verdict.REFUSED
        return _refused(window, calibration, still, verdict=verdict)
    per_update = samples_per_update(window.telemetry)
    window, spikes = _without_spikes(window, calibration)
    record = _record_of(window, description, calibration)
    if isinstance(record, tuple):
        is_remainder = window.is_remainder and _is_too_short(record)
        verdict = Verdict.SKIPPED if is_remainder else Verdict.REFUSED
        return _refused(window, calibration, *record, verdict=verdict, compared=True)
    if scaled := _wrong_scale(record, calibration.baseline, description):
        return _refused(window, calibration, scaled, compared=True)
    comparison = calibration.comparer.compare(record)
    healthy = calibration.baseline.preparation.samples_per_update
    # A different update rate changes the roughness and scatter of the position, but no quantity.
    if comparison.figures and not comparison.changed and has_other_updates(per_update, healthy):
        return _refused(window, calibration, OtherUpdates(per_update, healthy), compared=True)
    torque = comparison[of.TORQUE]
    if torque in comparison.changed and torque.change <= -1.0:
        return _refused(window, calibration, EffortReversed(), compared=True)
    faults, covariance, insignificant = _faults(comparison)
    zero = _shifted_zero(window, description, calibration, record, comparison)
    reasons = (
        OtherUnit(mismatch, forced=True) if mismatch else None,
        None if zero is None else OtherZero(zero),
        *_sample_caveats(window.telemetry, spikes, record.effort_lag.shift_s),
    )
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
        computing_time=time.perf_counter() - started,
        valid=True,
        reasons=tuple(filter(None, reasons)),
        calibration_windows=calibration.windows,
        verdict=Verdict.DEPARTED if comparison.has_departed else Verdict.VALID,
        causes=tuple(_causes(comparison, calibration)),
        measured=window.measured,
        comparison=comparison,
    )


def record_curve(
    window: Window, description: ActuatorDescription, calibration: JointCalibration
) -> FrictionCurve | None:
    """Return the friction of a record as a function of speed; None if it cannot be compared."""
    if _unusable(window, calibration) is not None:
        return None
    window, _ = _without_spikes(window, calibration)
    record = _record_of(window, description, calibration)
    if isinstance(record, tuple):
        return None
    signals = _signals(window, description, calibration, record.effort_lag)
    return friction_curve(calibration.comparer.at_temperature_of(record), record, signals)


def _signals(
    window: Window, description: ActuatorDescription, calibration: JointCalibration, lag: EffortLag
) -> Signals:
    """Return the rows of a record with the lag of its effort removed."""
    preparation = calibration.baseline.preparation
    fine = preparation.block_means(window.telemetry, description)
    return filtered(aligned(fine, lag), preparation)


def learning_estimate(window: Window | Refusal, *reasons: Reason) -> Estimate:
    """Return the estimate of a record of a unit that has no baseline yet."""
    is_lost = isinstance(window, Refusal) and (window.is_dropped or window.is_cut_off)
    return Estimate(
        window.start_ns,
        window.end_ns,
        INVERSE_DYNAMICS,
        0,
        "",
        reasons=reasons,
        verdict=Verdict.SKIPPED if is_lost else Verdict.REFUSED,
        lacks_calibration=True,
    )


def comparable_record(
    window: Window, description: ActuatorDescription, calibration: JointCalibration
) -> JointRecord | tuple[Reason, ...]:
    """Return a fitted record, or the reasons why it cannot be compared with the baseline."""
    if unusable := _unusable(window, calibration):
        return (unusable,)
    return _record_of(_without_spikes(window, calibration)[0], description, calibration)


def _without_spikes(window: Window, calibration: JointCalibration) -> tuple[Window, int]:
    """Return a record without effort spikes, and the number of replaced samples.

    Repeated values are interpolated between their updates.
    """
    cutoff_hz = calibration.baseline.preparation.cutoff_hz
    telemetry, count = despiked(renewed(window.telemetry), cutoff_hz)
    return replace(window, telemetry=telemetry), count


def _unusable(window: Window, calibration: JointCalibration) -> Reason | None:
    """Return the reason why the samples of a record cannot be compared, or None.

    A record without a measured speed can be compared, but its play is not judged.
    """
    if mismatch := calibration.shape_mismatch(window):
        return mismatch
    telemetry = window.telemetry
    if not len(telemetry.current):
        return EffortMissing()
    if calibration.baseline.preparation.is_empty and not telemetry.has_payload:
        return PayloadMissing()
    return None if np.all(np.isfinite(telemetry.speed)) else SpeedGaps()


def _sample_caveats(telemetry: Telemetry, spikes: int, shift_s: float) -> Iterator[Reason]:
    """Yield reservations about the samples of a record."""
    if shift_s:
        yield EffortShifted(shift_s)
    if spikes:
        yield SpikesRemoved(spikes, len(telemetry))
    if interpolated := int(np.count_nonzero(telemetry.interpolated)):
        yield SamplesInterpolated(interpolated, len(telemetry))


def _record_of(
    window: Window, description: ActuatorDescription, calibration: JointCalibration
) -> JointRecord | tuple[Reason, ...]:
    """Return a record fitted to usable samples, or the reasons why it cannot be compared.

    An uncertain shift of the effort is corrected only if the record is then explained better.
    """
    preparation = calibration.baseline.preparation
    fine = preparation.block_means(window.telemetry, description)
    healthy = [item.effort_lag for item in calibration.baseline.records]
    lag = with_shift(effort_lag(fine, preparation), healthy, preparation.cutoff_hz)
    record = _read(window, description, calibration, fine, lag)
    if lag.shift_s and not lag.is_certain:
        plain = _read(window, description, calibration, fine, lag.unshifted)
        if isinstance(record, tuple) or isinstance(plain, tuple):
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
) -> JointRecord | tuple[Reason, ...]:
    """Return a record fitted after its effort is shifted by a lag, or the reasons against it."""
    baseline = calibration.baseline
    fine = aligned(fine, lag)
    signals = filtered(fine, baseline.preparation)
    if defect := record_defect(signals, baseline.preparation):
        return tuple(filter(None, (defect, _wrong_speed(fine, description, baseline))))
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


def _is_too_short(reasons: Sequence[Reason]) -> bool:
    """Return whether too little motion is the only reason against a record."""
    return all(isinstance(reason, TooFewRows | TooFewStrokes) for reason in reasons)


def _refused(
    window: Window | Refusal,
    calibration: JointCalibration,
    *reasons: Reason,
    verdict: Verdict = Verdict.REFUSED,
    compared: bool = False,
    lacks_calibration: bool = False,
) -> Estimate:
    return Estimate(
        window.start_ns,
        window.end_ns,
        INVERSE_DYNAMICS,
        0,
        calibration.calibration_id,
        reasons=reasons,
        calibration_windows=calibration.windows,
        verdict=verdict,
        lacks_calibration=lacks_calibration,
        comparison=not_judged(*reasons) if compared else None,
    )


def _wrong_speed(
    fine: Fine, description: ActuatorDescription, baseline: Baseline
) -> SpeedScaled | None:
    """Return a wrong scale of position or speed due to a common mistake, or None."""
    preparation = baseline.preparation
    factor = usual_speed(fine, preparation.cutoff_hz) / preparation.usual_speed
    column = "position" if fine.speed is None else "speed"
    error = wrong_speed_of_record(column, factor, description.parameters.tau)
    return SpeedScaled(column, factor, mistake_row(error.mistakes[0])) if error else None


def _wrong_scale(
    record: JointRecord, baseline: Baseline, description: ActuatorDescription
) -> Reason | None:
    """Return the reason why the effort of a record cannot belong to the unit, or None."""
    scale = effort_scale(record, baseline)
    error = wrong_effort_of_record(scale.friction, scale.inertia, description.parameters.tau)
    if error and (error.mistakes or scale.negative is None):
        return EffortScaled(error.factor, mistake_row(error.mistakes[0]) if error.mistakes else ())
    return None if scale.negative is None else NegativeQuantity(*scale.negative)


def _shifted_zero(
    window: Window,
    description: ActuatorDescription,
    calibration: JointCalibration,
    record: JointRecord,
    comparison: Comparison,
) -> float | None:
    """Return the shift of the position zero relative to the healthy records [rad].

    The result is None if the changes explain the record better than a shifted zero, if the shift is
    negligible, or if the model has no gravity. It is also None if the record has not departed, or
    the shifted record cannot be compared.
    """
    baseline, comparer = calibration.baseline, calibration.comparer
    if not (baseline.shape.has_gravity and comparison.has_departed):
        return None
    signals = _signals(window, description, calibration, record.effort_lag)
    shift, gain = zero_shift(baseline.shape, signals)
    if abs(shift) < _LEAST_ZERO:
        return None
    telemetry = window.telemetry
    moved = replace(
        telemetry, position=telemetry.position - shift, command=telemetry.command - shift
    )
    turned = _record_of(replace(window, telemetry=moved), description, calibration)
    if isinstance(turned, tuple):
        return None
    better = comparer.unexplained(record) - comparer.unexplained(turned)
    return shift if better >= (0.0 if gain > _GAIN_OF_ZERO else _OF_ZERO) else None


def _faults(comparison: Comparison) -> tuple[FaultVector, np.ndarray, np.ndarray]:
    """Return the faults that quantities measure, their covariance, and their insignificance flags.

    A measured fault is insignificant if its quantity is unchanged or has decreased. Faults that are
    not measured, and their variances, are NaN.
    """
    values, variances = np.full(N_FAULTS, math.nan), np.full(N_FAULTS, math.nan)
    insignificant = np.zeros(N_FAULTS, dtype=bool)
    for name, fault in of.FAULTS_OF_RECORDS.items():
        quantity, number = comparison[name], FAULT_NAMES.index(fault)
        if not quantity.is_estimated:
            continue
        slope = FAULT_BY_NAME[fault].slope
        values[number] = max(quantity.change, 0.0) / slope
        variances[number] = (_sigma(quantity) / slope) ** 2
        insignificant[number] = quantity not in comparison.changed or quantity.change <= 0.0
    return FaultVector.of(values), np.diag(variances), insignificant


def _causes(comparison: Comparison, calibration: JointCalibration) -> list[CauseEstimate]:
    """Return the hidden causes that correspond to changed quantities without rivals."""
    causes = []
    for quantity in comparison.changed:
        if quantity.name in _CAUSES and not quantity.rivals:
            scale = _cause_scale(quantity.name, calibration)
            if scale is not None and math.isfinite(_sigma(quantity)):
                name = _CAUSES[quantity.name]
                value, sigma = scale * quantity.change, scale * _sigma(quantity)
                causes.append(CauseEstimate(name, value, sigma))
    return causes


def _cause_scale(name: str, calibration: JointCalibration) -> float | None:
    """Return the value of a cause per unit change of its quantity, or None if undefined.

    A relative change of viscous friction is undefined without healthy viscous friction.
    """
    baseline = calibration.baseline
    if name == of.LOAD:
        return calibration.torque_scale
    if name != of.VISCOUS:
        return 1.0
    healthy, scale = float(baseline.healthy[VISCOUS_AT]), baseline.viscous_scale
    return scale / healthy if healthy > _LEAST_VISCOUS * scale else None


def _sigma(change: QuantityChange) -> float:
    return (change.high - change.low) / (2.0 * Z90)
