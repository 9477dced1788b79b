# SPDX-License-Identifier: Apache-2.0
"""Wording of wrong units, signs, shafts and scales in a mapping.

`ema_core.columns` and `ema_bags.inputs.factors` decide which column is wrong. Remarks on columns of
an unknown drive are here: they prevent no estimate.
"""

import math
from collections.abc import Iterator

from ema_bags.inputs.change_wording import change_reason, change_remedy
from ema_bags.inputs.defect_kinds import DefectKind, kind_of_mistake
from ema_bags.inputs.factors import explain
from ema_bags.inputs.input_defect import InputDefect
from ema_bags.inputs.mapping import ColumnMapping, CurrentSource
from ema_bags.inputs.motion import ThinnedMotion
from ema_core.columns.errors import ColumnError
from ema_core.columns.mistakes import Kind
from ema_core.columns.of_current import reversed_current, wrong_current
from ema_core.columns.tolerances import (
    MAPPED_SPEED,
    NOTED_TRACKING,
    PLAUSIBLE,
    WRONG_TRACKING,
    is_beyond,
    is_within,
)
from ema_core.description import ActuatorDescription
from ema_core.units import CURRENTS
from ema_core.wording import counted


def wrong_factors(
    motion: ThinnedMotion,
    mapping: ColumnMapping,
    description: ActuatorDescription,
    updated_hz: float | None = None,
) -> Iterator[InputDefect]:
    """Yield a defect for each unit, sign or shaft that is inconsistent with the other columns.

    ``updated_hz`` is the update rate of the source [Hz] if it publishes each value several times.
    """
    is_unknown = not description.is_modelled
    changes = explain(motion, mapping, description)
    if changes:
        is_certain = not is_unknown or motion.is_ample
        for change in changes:
            kind = kind_of_mistake(change.quantity, change.mistake.kind)
            yield InputDefect(
                kind, change_reason(change), change_remedy(change), is_certain=is_certain
            )
        return
    if is_unknown:
        yield from _unlike(motion)
        return
    if changes is not None:
        return
    tau, ratio, gain = description.parameters.tau, motion.speed_ratio, motion.gain
    if ratio is not None and not is_within(ratio, MAPPED_SPEED):
        text = (
            f"position and speed give a gear ratio of {_as_ratio(tau * ratio)}, but the "
            f"description has {_as_ratio(tau)}"
        )
        remedy = (
            "check that position and speed belong to the same joint, and check unit and shaft of "
            "both. If they are right and tau matches the data sheet: accept: [gear_ratio]"
        )
        if updated_hz is not None:
            remedy = (
                f"{updated_hz:.4g} Hz may be too slow for this motion: update the values faster at "
                "the source"
            )
        yield InputDefect(DefectKind.GEAR_RATIO, text, remedy)
    if gain is not None and is_beyond(gain, WRONG_TRACKING):
        yield InputDefect(
            DefectKind.COMMAND_POSITION,
            f"the position moves {gain:.3g} times as far as the command",
            f"command: {{scale: {gain:.6g}}} if both refer to the same shaft, or choose another "
            "source",
        )


def _unlike(motion: ThinnedMotion) -> Iterator[InputDefect]:
    """Yield defects for inconsistent columns that no wrong unit, sign or shaft explains."""
    if not motion.is_ample:
        return
    strokes, ratio, gain = len(motion.strokes), motion.stroke_ratio, motion.gain
    over = f"over {counted(strokes, 'stroke')}"
    if ratio is not None and not is_within(ratio, MAPPED_SPEED):
        is_near = not is_beyond(ratio, PLAUSIBLE)
        why = "elasticity, lag or sampling" if is_near else "no unit, sign or shaft explains it"
        remedy = (
            "the speed is used unchanged"
            if is_near
            else "check that the speed belongs to the same joint"
        )
        text = f"the speed is {1.0 / ratio:.3g} times the derivative of the position {over}: {why}"
        yield InputDefect(DefectKind.SPEED_RATIO, text, remedy, False, needs_action=not is_near)
    if gain is not None and is_beyond(gain, NOTED_TRACKING):
        text = f"the position moves {gain:.3g} times as far as the command {over}"
        remedy = (
            "possible causes: lag, elasticity, or the command of another joint; it is used "
            "unchanged"
        )
        yield InputDefect(DefectKind.COMMAND_POSITION, text, remedy, False)


def current_defects(
    motion: ThinnedMotion, mapping: ColumnMapping, description: ActuatorDescription
) -> Iterator[InputDefect]:
    """Yield a defect if the sign or size of the current contradicts acceleration and friction."""
    source = mapping.measured_current
    if source is None:
        return
    if not description.is_modelled:
        correlation, work_share = motion.dissipation, motion.work_share
        if reversed_current(correlation, work_share):
            yield InputDefect(
                DefectKind.CURRENT_SIGN_REVERSED,
                "the current opposes the motion, where friction requires it to drive "
                f"(correlation with the speed {correlation:.2f}, net work {work_share:.0%} "
                "of all work)",
                f"current: {{sign: {-source.sign}}}",
                is_certain=motion.is_ample,
            )
        return
    relation = motion.current_against_torque(description.parameters)
    if relation is None:
        return
    size, correlation = relation
    error = wrong_current(size, correlation, description.parameters.tau)
    if error is not None:
        yield _of_current(error, source, correlation)


def _of_current(error: ColumnError, source: CurrentSource, correlation: float) -> InputDefect:
    """Return the defect of a current that contradicts the described inertia and friction."""
    text = (
        f"the current is {error.factor:.3g} times what the described inertia and friction require"
    )
    if not error.mistakes:
        remedy = (
            "check current.kind (current or torque, motor or joint), and J_m, J_u and friction "
            "in the description"
        )
        return InputDefect(DefectKind.CURRENT_SIZE, text, remedy)
    [mistake] = error.mistakes
    if mistake.kind is Kind.SIGN:
        return InputDefect(
            DefectKind.CURRENT_SIGN_REVERSED,
            "the current is negative while acceleration and friction require a positive current "
            f"(correlation {correlation:.2f})",
            f"current: {{sign: {-source.sign}}}",
        )
    meant = f"m{source.unit}" if mistake.factor > 1.0 else source.unit.removeprefix("m")
    is_unit = meant in (*CURRENTS, "N.m", "mN.m") and meant != source.unit
    remedy = f"unit: {meant}" if is_unit else f"scale: {source.scale / mistake.factor:g}"
    return InputDefect(DefectKind.CURRENT_UNIT, text, f"current: {{{remedy}}}")


def _as_ratio(tau: float) -> str:
    return f"1/{1.0 / tau:.4g}" if tau and math.isfinite(tau) else f"{tau:g}"
