# SPDX-License-Identifier: Apache-2.0
"""Wording of the defects of an import: the problem with its figures, and the remedy."""

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from ema_bags.inputs.change_wording import change_reason, change_remedy
from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.factors import MappingChange
from ema_bags.inputs.input_defect import (
    CurrentUnit,
    Factor,
    FarCommand,
    Frozen,
    GearRatio,
    InputDefect,
    LostSamples,
    OtherRate,
    OutOfRange,
    PositionJumps,
    Publishers,
    RepeatedSamples,
    RepeatedValues,
    ReversedCurrent,
    SampleCount,
    Setpoint,
    ValuesNotFinite,
    WrongStamps,
)
from ema_bags.inputs.ordering import MOST_DISPLACED
from ema_core.telemetry import PAUSE_S
from ema_core.wording import counted


class DefectText(NamedTuple):
    """Text of a defect, without capital and full stop."""

    problem: str
    """Description, with the measured values."""
    remedy: str
    """Correction of the mapping, or the next thing to check."""


def defect_text(defect: InputDefect) -> DefectText:
    """Return problem and remedy of a defect."""
    if defect.evidence is None:
        return _PLAIN[defect.kind]
    return DefectText(*_WORDS[type(defect.evidence)](defect, defect.evidence))


def defect_line(defect: InputDefect) -> str:
    """Return kind, problem and remedy of a defect in one line."""
    return ": ".join((defect.kind, *defect_text(defect)))


_Words = tuple[str, str]

_SETPOINT: Final = "it is a setpoint, not a measurement"
_PLAIN: Final = {
    DefectKind.POSITION_AT_MOTOR: DefectText(
        "the position is measured at the motor, upstream of the backlash",
        "backlash is not visible in it; use an encoder at the user shaft",
    ),
    DefectKind.DRIVE_OF_I_Q: DefectText(
        "the current is i_q of a field-oriented drive, but the description has drive six_step",
        "drive: field_oriented in the description, with k_t as torque per ampere of i_q, or "
        "current: {kind: equivalent}",
    ),
    DefectKind.SPEED_COMMANDED: DefectText(
        f"the speed is the derivative of the command: {_SETPOINT}",
        "speed: choose a measured source, or omit speed",
    ),
}


def _sample_count(defect: InputDefect, e: SampleCount) -> _Words:
    samples = f"{counted(e.count, 'sample')} of {e.of}"
    match defect.kind:
        case DefectKind.FILLED_SAMPLES:
            return (
                f"{counted(e.count, 'lost sample')} interpolated linearly (fill_lost), in addition "
                f"to {e.of} received",
                "interpolated currents are estimates: reduce losses at the source",
            )
        case DefectKind.SAMPLES_REORDERED:
            displaced = counted(MOST_DISPLACED, "sample")
            return f"{samples} out of order by at most {displaced}", "they are sorted by stamp"
        case DefectKind.DUPLICATE_SAMPLES:
            return f"{samples} published twice", "each sample is used once"
        case DefectKind.IMPOSSIBLE_SAMPLES:
            remedy = "they are interpolated linearly, or dropped as a gap"
            if defect.is_error:
                remedy = "repair the source: too many to interpolate"
            return f"{samples} physically impossible", remedy
        case DefectKind.ANGLE_WRAPS:
            return (
                f"an angle wraps {counted(e.count, 'time')} at the end of its register",
                "the angle is unwrapped",
            )
        case _:
            return (
                f"{counted(e.count, 'stamp')} of {e.of} reconstructed from arrival times",
                "set header.stamp at the source if possible",
            )


def _lost_samples(_: InputDefect, e: LostSamples) -> _Words:
    return (
        f"{counted(e.count, 'sample')} of {e.of + e.count} missing in {counted(e.gaps, 'gap')}",
        f"records are interpolated across gaps of at most {PAUSE_S:g} s"
        if e.is_interpolated
        else "no window spans a gap; set fill_lost in the mapping to fill short gaps",
    )


def _wrong_stamps(defect: InputDefect, e: WrongStamps) -> _Words:
    problem = (
        f"the time decreases {counted(e.decreasing, 'time')} and repeats "
        f"{counted(e.repeated, 'time')} in {counted(e.of, 'sample')}"
    )
    if not defect.is_error:
        return (
            problem,
            "samples with a repeated stamp are dropped, and no window spans a backward step",
        )
    order = "Sort the rows by time"
    rebuild = "clock: {source: arrival} reconstructs the stamps"
    return problem, f"check clock.source. {order if e.of_table else rebuild}"


def _values_not_finite(defect: InputDefect, e: ValuesNotFinite) -> _Words:
    parts = [f"{name} is not finite in {count}" for name, count in e.by_column.items()]
    problem = f"{', '.join(parts)} of {counted(e.of, 'sample')}"
    if not defect.is_error:
        return problem, "these samples are dropped"
    worst = max(e.by_column, key=e.by_column.__getitem__)
    remedy = f"{worst}: repair its source or choose another source"
    if worst in ("current", "speed"):
        remedy += f", or omit {worst} if it is not measured"
    return problem, remedy


def _other_rate(_: InputDefect, e: OtherRate) -> _Words:
    return (
        f"the sample rate is {e.hz:.5g} Hz, but the description has {e.described_hz:g} Hz",
        "the measured rate is used",
    )


def _repeated_samples(_: InputDefect, e: RepeatedSamples) -> _Words:
    return (
        f"each value is published {round(e.times)} times: updated at {e.updated_hz:.5g} Hz, "
        f"published at {e.times * e.updated_hz:.4g} Hz",
        f"the telemetry uses the update rate, {e.updated_hz:.5g} Hz",
    )


def _repeated_values(defect: InputDefect, e: RepeatedValues) -> _Words:
    parts = [
        f"the {item.column} repeats each value {item.longest} times (updated at "
        f"{e.rate_hz / item.longest:.4g} Hz)"
        if item.is_regular
        else f"the {item.column} is updated every {item.mean:.1f} samples on average, irregularly"
        for item in e.columns
    ]
    remedy = "configure the driver to publish each value once"
    if defect.is_error:
        remedy += ", all at the same rate"
    elif any(item.column == "position" for item in e.columns):
        remedy = f"records interpolate it between updates; {remedy}"
    else:
        remedy = f"it is used unchanged; {remedy}"
    return ", ".join(parts), remedy


def _position_jumps(_: InputDefect, e: PositionJumps) -> _Words:
    return (
        f"the position jumps {counted(e.count, 'time')}, by up to {e.largest:.4g} rad per sample",
        "check whether the encoder is homed or reset, or two sources publish",
    )


def _far_command(_: InputDefect, e: FarCommand) -> _Words:
    return (
        f"the command is {e.command:.4g} rad, far outside the travel from {e.low:.3g} to "
        f"{e.high:.3g} rad, in {counted(e.count, 'sample')} of {e.of}",
        "command: choose another source, or omit command",
    )


def _frozen(defect: InputDefect, e: Frozen) -> _Words:
    name = e.column.column
    value = e.column.value + 0.0  # 0 instead of -0
    problem = (
        f"{name} is {value:g} in all {counted(e.column.samples, 'sample')} while "
        f"{e.column.moving} changes"
    )
    if defect.kind is DefectKind.CURRENT_ZERO:
        return (
            f"{problem}: the drive does not publish it",
            "current: {sampling: none, ...}, or omit current",
        )
    return problem, f"{name}: choose another source" + f", or omit {name}" * e.is_optional


def _change(_: InputDefect, e: MappingChange) -> _Words:
    return change_reason(e), change_remedy(e)


def _gear_ratio(_: InputDefect, e: GearRatio) -> _Words:
    return (
        f"position and speed give a gear ratio of {_as_ratio(e.measured)}, but the description "
        f"has {_as_ratio(e.described)}",
        "check that position and speed belong to the same joint, and check unit and shaft of "
        "both. If they are right and tau matches the data sheet: accept: [gear_ratio]"
        if e.updated_hz is None
        else f"{e.updated_hz:.4g} Hz may be too slow for this motion: update the values faster at "
        "the source",
    )


def _factor(defect: InputDefect, e: Factor) -> _Words:
    over = f" over {counted(e.strokes, 'stroke')}" if e.strokes is not None else ""
    if defect.kind is DefectKind.CURRENT_SIZE:
        return (
            _of_required(e.factor),
            "check current.kind (current or torque, motor or joint), and J_m, J_u and friction "
            "in the description",
        )
    if defect.kind is DefectKind.SPEED_RATIO:
        problem = f"the speed is {e.factor:.3g} times the derivative of the position{over}"
        if defect.needs_action:
            return (
                f"{problem}: no unit, sign or shaft explains it",
                "check that the speed belongs to the same joint",
            )
        return f"{problem}: elasticity, lag or sampling", "the speed is used unchanged"
    return (
        f"the position moves {e.factor:.3g} times as far as the command{over}",
        f"command: {{scale: {e.factor:.6g}}} if both refer to the same shaft, or choose another "
        "source"
        if defect.is_error
        else "possible causes: lag, elasticity, or the command of another joint; it is used "
        "unchanged",
    )


def _reversed_current(_: InputDefect, e: ReversedCurrent) -> _Words:
    problem = (
        "the current is negative while acceleration and friction require a positive current "
        f"(correlation {e.correlation:.2f})"
    )
    if e.work_share is not None:
        problem = (
            "the current opposes the motion, where friction requires it to drive (correlation "
            f"with the speed {e.correlation:.2f}, net work {e.work_share:.0%} of all work)"
        )
    return problem, f"current: {{sign: {e.sign}}}"


def _current_unit(_: InputDefect, e: CurrentUnit) -> _Words:
    value = e.value if isinstance(e.value, str) else f"{e.value:g}"
    return _of_required(e.factor), f"current: {{{e.entry}: {value}}}"


def _setpoint(defect: InputDefect, e: Setpoint) -> _Words:
    if defect.kind is DefectKind.POSITION_COMMANDED:
        delay = f" {e.lag} samples later" if e.lag else ""
        return (
            f"the position equals the command{delay}: {_SETPOINT}",
            "position: choose the encoder as source",
        )
    source = "position error and speed" if e.is_control_law else "the command"
    return (
        f"the current follows {source} exactly: {_SETPOINT}",
        "changes in torque per unit of effort are not visible in it",
    )


def _publishers(_: InputDefect, e: Publishers) -> _Words:
    listed = "`ros2 topic info -v` lists the publishers"
    count, intervals = len(e.rates_hz), [f"{step:.3g}" for step in e.intervals_ms]
    if count > 2:
        return (
            f"stamp intervals repeat every {count} messages ({', '.join(intervals)} ms): the joint "
            f"has {count} publishers, each at {e.rates_hz[0]:.4g} Hz",
            f"stop all but one: {listed}",
        )
    first, second = e.rates_hz
    rates = f"both at {first:.4g} Hz"
    if first != second:
        rates = f"one at {first:.4g} Hz, the other at {second:.4g} Hz"
    return (
        f"stamp intervals alternate between {' ms and '.join(intervals)} ms: the joint has two "
        f"publishers, {rates}",
        f"stop one of them: {listed}",
    )


def _out_of_range(_: InputDefect, e: OutOfRange) -> _Words:
    return (
        f"temperature {e.celsius:.4g} degC, expected {e.lowest:g} to {e.highest:g}",
        f"temperature: {{unit: {e.unit}}} if this is its unit; otherwise these values are ignored",
    )


def _of_required(factor: float) -> str:
    return f"the current is {factor:.3g} times what the described inertia and friction require"


def _as_ratio(tau: float) -> str:
    return f"1/{1.0 / tau:.4g}" if tau and math.isfinite(tau) else f"{tau:g}"


_WORDS: Final[dict[type, Callable[[InputDefect, Any], _Words]]] = {
    SampleCount: _sample_count,
    LostSamples: _lost_samples,
    WrongStamps: _wrong_stamps,
    ValuesNotFinite: _values_not_finite,
    OtherRate: _other_rate,
    RepeatedSamples: _repeated_samples,
    RepeatedValues: _repeated_values,
    PositionJumps: _position_jumps,
    FarCommand: _far_command,
    Frozen: _frozen,
    MappingChange: _change,
    GearRatio: _gear_ratio,
    Factor: _factor,
    ReversedCurrent: _reversed_current,
    CurrentUnit: _current_unit,
    Setpoint: _setpoint,
    Publishers: _publishers,
    OutOfRange: _out_of_range,
}
