# SPDX-License-Identifier: Apache-2.0
"""Wording of an examination: abilities, needs and findings."""

import math
from typing import Final

from ema_bags.inputs.defect_wording import defect_line
from ema_bags.inputs.examination import (
    Ability,
    ColumnExamination,
    JointExamination,
    JointRelations,
    Need,
    Timing,
)
from ema_core.wording import counted

ABILITY_NAMES: Final = {
    Ability.FRICTION: "friction",
    Ability.VISCOUS_FRICTION: "viscous friction",
    Ability.TORQUE: "torque per unit of effort",
    Ability.INERTIA: "inertia",
    Ability.LOAD: "load",
    Ability.PLAY: "play",
    Ability.TRACKING_LAG: "tracking lag",
}

NEED_NAMES: Final = {
    Need.EFFORT: "a current, torque or force",
    Need.VARYING_EFFORT: "an effort that is not constant",
    Need.COMMAND: "a position command",
    Need.MEASURED_POSITION: "a measured position, not a setpoint",
    Need.MEASURED_EFFORT: "a measured effort, not a setpoint",
    Need.MOTION: "motion",
    Need.STROKES: "more strokes in both directions",
    Need.SPEEDS: "motion at several speeds",
    Need.ACCELERATION: "faster acceleration",
    Need.INERTIA_OR_GRAVITY: "visible inertia or gravity",
    Need.BOTH_SIDES: "the motor speed in addition to the joint position",
}

_SATURATED: Final = 0.01
_HELD: Final = 2
_LATE_SAMPLES: Final = 0.5
_FACTOR: Final = 0.03
_COARSE: Final = 0.02
_JITTER: Final = 0.1
_LITTLE_EXPLAINED: Final = 0.5


def judged_lines(joint: JointExamination) -> list[str]:
    """Return a line with the quantities that can be judged, and lines on the other quantities.

    Each of the latter lines states the conditions that the recording does not meet. Quantities
    that lack the same conditions share a line.
    """
    able = [ABILITY_NAMES[item.ability] for item in joint.abilities if not item.needs]
    lines = [f"can be judged: {', '.join(able) or 'nothing'}"]
    by_need: dict[tuple[Need, ...], list[str]] = {}
    for item in joint.abilities:
        if item.needs:
            by_need.setdefault(item.needs, []).append(ABILITY_NAMES[item.ability])
    for needs, names in by_need.items():
        conditions = " and ".join(NEED_NAMES[need] for need in needs)
        verb = "needs" if len(names) == 1 else "need"
        lines.append(f"{', '.join(names)} {verb} {conditions}")
    return lines


def timing_line(timing: Timing) -> str:
    """Return rate, jitter and losses as one line."""
    parts = [
        f"{counted(timing.samples, 'sample')} in {timing.duration_s:.4g} s, "
        f"{timing.rate_hz:.5g} Hz, jitter {_seconds(timing.jitter_s)}"
    ]
    losses = (
        (timing.lost, f"{timing.lost} lost in {counted(timing.gaps, 'gap')}"),
        (timing.pauses, counted(timing.pauses, "pause")),
        (timing.clock_jumps, counted(timing.clock_jumps, "backward step") + " of the clock"),
        (timing.repeated, f"{timing.repeated} repeated"),
        (timing.reordered, f"{timing.reordered} out of order"),
        (timing.rebuilt, f"{counted(timing.rebuilt, 'stamp')} rebuilt"),
    )
    return ", ".join([*parts, *(text for count, text in losses if count)])


def motion_line(joint: JointExamination) -> str:
    """Return travel, strokes and speeds as one line."""
    motion = joint.motion
    if motion is None or motion.travel <= 0.0 or motion.moving_s <= 0.0:
        return "no motion"
    return (
        f"travel {motion.travel:.4g} {motion.unit}, {motion.strokes_forward} strokes forward and "
        f"{motion.strokes_backward} backward, {motion.slowest:.3g} to {motion.fastest:.3g} "
        f"{motion.unit}/s, {motion.moving_s:.3g} s in motion"
    )


def findings(joint: JointExamination) -> list[str]:
    """Return one line per defect and per conspicuous measurement, errors first."""
    errors = [f"error {defect_line(item)}" for item in joint.defects if item.is_error]
    notes = [defect_line(item) for item in joint.defects if not item.is_error]
    lines = [*errors, *notes]
    if joint.problem:
        lines.insert(0, f"error: {joint.problem}")
    for column in joint.columns:
        lines += _of_column(column)
    if joint.timing is not None:
        timing = joint.timing
        if timing.jitter_s * timing.rate_hz > _JITTER:
            lines.append(
                f"jitter is {timing.jitter_s * timing.rate_hz:.0%} of the sample period: samples "
                "are interpolated by stamp"
            )
        if joint.relations is not None:
            lines += _of_relations(joint.relations, 1.0 / timing.rate_hz)
    if joint.second_position:
        lines.append(f"{joint.second_position!r} is a second measurement of the position")
    return lines


def _of_column(column: ColumnExamination) -> list[str]:
    lines = []
    name = column.quantity
    if column.held_every >= _HELD and name not in ("temperature", "payload"):
        lines.append(
            f"{name} is updated only every {column.held_every} samples; "
            f"{column.held_share:.0%} of its samples in motion repeat the previous value"
        )
    if column.saturated_share > _SATURATED and name == "current":
        lines.append(
            f"{name} is at its largest value {max(abs(column.low), abs(column.high)):.4g} "
            f"{column.unit} in {column.saturated_share:.1%} of the samples: it may be saturated"
        )
    span = column.high - column.low
    if name in ("position", "current") and span > 0.0 and column.step > _COARSE * span:
        lines.append(
            f"{name} has steps of {column.step:.3g} {column.unit}, {column.step / span:.0%} of its "
            "range"
        )
    if column.missing:
        lines.append(f"{name} has {counted(column.missing, 'sample')} without a number")
    return lines


def _of_relations(relations: JointRelations, period_s: float) -> list[str]:
    lines = []
    lags = (
        (relations.speed_lag_s, "speed", "the derivative of the position"),
        (relations.effort_lag_s, "effort", "the motion"),
    )
    for lag_s, name, of in lags:
        if abs(lag_s) > _LATE_SAMPLES * period_s:
            verb = "lags behind" if lag_s > 0.0 else "leads"
            lines.append(f"the {name} {verb} {of} by {_seconds(abs(lag_s))}")
    if not math.isnan(relations.command_lag_s):
        lines.append(f"the position lags behind the command by {_seconds(relations.command_lag_s)}")
    factor = relations.speed_factor
    if not math.isnan(factor) and abs(factor - 1.0) > _FACTOR:
        lines.append(f"the speed is {factor:.4g} times the derivative of the position")
    if relations.explained_effort < _LITTLE_EXPLAINED:
        share = max(relations.explained_effort, 0.0)
        lines.append(
            f"inertia, friction and gravity explain only {share:.0%} of the effort: check that "
            "it belongs to this joint"
        )
    return lines


def _seconds(value: float) -> str:
    size = abs(value)
    if size >= 1.0:
        return f"{value:.3g} s"
    return f"{1e3 * value:.3g} ms" if size >= 1e-3 else f"{1e6 * value:.3g} us"
