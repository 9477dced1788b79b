# SPDX-License-Identifier: Apache-2.0
"""Defects of wrong units, signs, shafts and scales in a mapping.

`ema_core.columns` and `ema_bags.inputs.factors` decide which column is wrong. Remarks on columns of
an unknown drive are here: they prevent no estimate.
"""

from collections.abc import Iterator

from ema_bags.inputs.defect_kinds import DefectKind, kind_of_mistake
from ema_bags.inputs.factors import explain
from ema_bags.inputs.input_defect import (
    CurrentUnit,
    Factor,
    GearRatio,
    InputDefect,
    ReversedCurrent,
)
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
            yield InputDefect(kind, change, is_certain=is_certain)
        return
    if is_unknown:
        yield from _unlike(motion)
        return
    if changes is not None:
        return
    tau, ratio, gain = description.parameters.tau, motion.speed_ratio, motion.gain
    if ratio is not None and not is_within(ratio, MAPPED_SPEED):
        evidence = GearRatio(tau * ratio, tau, updated_hz)
        yield InputDefect(DefectKind.GEAR_RATIO, evidence)
    if gain is not None and is_beyond(gain, WRONG_TRACKING):
        yield InputDefect(DefectKind.COMMAND_POSITION, Factor(gain))


def _unlike(motion: ThinnedMotion) -> Iterator[InputDefect]:
    """Yield defects for inconsistent columns that no wrong unit, sign or shaft explains."""
    if not motion.is_ample:
        return
    strokes, ratio, gain = len(motion.strokes), motion.stroke_ratio, motion.gain
    if ratio is not None and not is_within(ratio, MAPPED_SPEED):
        evidence = Factor(1.0 / ratio, strokes)
        needs_action = is_beyond(ratio, PLAUSIBLE)
        yield InputDefect(
            DefectKind.SPEED_RATIO, evidence, is_error=False, needs_action=needs_action
        )
    if gain is not None and is_beyond(gain, NOTED_TRACKING):
        yield InputDefect(DefectKind.COMMAND_POSITION, Factor(gain, strokes), is_error=False)


def current_defects(
    motion: ThinnedMotion, mapping: ColumnMapping, description: ActuatorDescription
) -> Iterator[InputDefect]:
    """Yield a defect if the sign or size of the current contradicts acceleration and friction."""
    source = mapping.measured_current
    if source is None:
        return
    if not description.is_modelled:
        correlation, work_share = motion.dissipation, motion.work_share
        if correlation is not None and reversed_current(correlation, work_share):
            evidence = ReversedCurrent(correlation, work_share, -source.sign)
            kind = DefectKind.CURRENT_SIGN_REVERSED
            yield InputDefect(kind, evidence, is_certain=motion.is_ample)
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
    if not error.mistakes:
        return InputDefect(DefectKind.CURRENT_SIZE, Factor(error.factor))
    [mistake] = error.mistakes
    if mistake.kind is Kind.SIGN:
        evidence = ReversedCurrent(correlation, None, -source.sign)
        return InputDefect(DefectKind.CURRENT_SIGN_REVERSED, evidence)
    meant = f"m{source.unit}" if mistake.factor > 1.0 else source.unit.removeprefix("m")
    is_unit = meant in (*CURRENTS, "N.m", "mN.m") and meant != source.unit
    entry, value = ("unit", meant) if is_unit else ("scale", source.scale / mistake.factor)
    return InputDefect(DefectKind.CURRENT_UNIT, CurrentUnit(error.factor, entry, value))
