# SPDX-License-Identifier: Apache-2.0
"""Which quantities of a joint the monitor can judge from a recording."""

import math
from collections.abc import Iterator
from typing import Final

from ema_bags.inputs.column_measures import EffortFit
from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.examination import Ability, AbilityResult, JointMotion, JointRelations, Need
from ema_bags.inputs.input_defect import InputDefect
from ema_bags.inputs.mapping import ColumnMapping
from ema_core.description import ActuatorDescription
from ema_core.record_needs import FEWEST_REVERSING, FEWEST_STROKES

_SEVERAL_SPEEDS: Final = 0.3
"""Smallest spread that counts as several speeds [-].

A trapezoidal speed profile with a quarter of its time in ramps has this spread.
"""
_VISIBLE: Final = 0.1
_SAME_SHAFT: Final = 2.0


def abilities_of(
    mapping: ColumnMapping,
    description: ActuatorDescription,
    motion: JointMotion | None,
    relations: JointRelations | None,
    fit: EffortFit | None,
    defects: tuple[InputDefect, ...],
) -> tuple[AbilityResult, ...]:
    """Return, for each quantity, the conditions that the recording does not meet.

    Parameters
    ----------
    mapping, description
        Column mapping of the joint, and description of the actuator.
    motion, relations, fit
        Measured motion, relations of the columns and fit of the effort; None if there is no motion.
    defects
        Defects of the import.
    """
    kinds = {item.kind for item in defects}
    is_effort = mapping.measured_current is not None
    strokes = list(_of_strokes(motion, kinds))
    effort = [*strokes]
    if not is_effort:
        effort.append(Need.EFFORT)
    elif kinds & {DefectKind.CURRENT_ZERO, DefectKind.CURRENT_FROZEN}:
        effort.append(Need.VARYING_EFFORT)
    visible = max(fit.inertia, fit.gravity) if fit else 0.0
    moves = Need.MOTION not in strokes
    is_seen = moves and is_effort
    is_one_speed = motion is not None and motion.speed_spread < _SEVERAL_SPEEDS
    speeds = [Need.SPEEDS] if is_seen and is_one_speed else []
    inertia = [Need.ACCELERATION] if is_seen and (fit is None or fit.inertia < _VISIBLE) else []
    torque = [Need.INERTIA_OR_GRAVITY] if is_seen and visible < _VISIBLE else []
    if DefectKind.CURRENT_COMMANDED in kinds:
        torque.append(Need.MEASURED_EFFORT)
    play = [*strokes]
    if not _has_both_sides(mapping, description, relations):
        play.append(Need.BOTH_SIDES)
    lag = [need for need in strokes if need is not Need.STROKES]
    if not mapping.has_command:
        lag.append(Need.COMMAND)
    needs = {
        Ability.FRICTION: effort,
        Ability.VISCOUS_FRICTION: [*effort, *speeds],
        Ability.TORQUE: [*effort, *torque],
        Ability.INERTIA: [*effort, *inertia],
        Ability.LOAD: effort,
        Ability.PLAY: play,
        Ability.TRACKING_LAG: lag,
    }
    return tuple(AbilityResult(ability, tuple(items)) for ability, items in needs.items())


def abilities_by_columns(*, has_effort: bool, has_command: bool) -> tuple[Ability, ...]:
    """Return the quantities that the monitor can judge from a joint's columns, if it moves enough.

    Without an effort, the monitor judges nothing.
    """
    if not has_effort:
        return ()
    lag = (Ability.TRACKING_LAG,) * has_command
    return (Ability.FRICTION, Ability.TORQUE, Ability.INERTIA, Ability.LOAD, *lag)


def _of_strokes(motion: JointMotion | None, defects: set[DefectKind]) -> Iterator[Need]:
    if DefectKind.POSITION_COMMANDED in defects:
        yield Need.MEASURED_POSITION
    if motion is None or motion.travel <= 0.0 or motion.moving_s <= 0.0:
        yield Need.MOTION
    elif (
        min(motion.strokes_forward, motion.strokes_backward) < FEWEST_REVERSING
        or motion.pieces < FEWEST_STROKES
    ):
        yield Need.STROKES


def _has_both_sides(
    mapping: ColumnMapping, description: ActuatorDescription, relations: JointRelations | None
) -> bool:
    """Return whether the speed is measured at the motor and the position at the joint."""
    if mapping.speed is None or relations is None or math.isnan(relations.speed_factor):
        return False
    is_described = (
        description.parameters.tau != 1.0
        and mapping.speed.shaft == "motor"
        and mapping.position.shaft == "user"
    )
    factor = abs(relations.speed_factor)
    return is_described or not 1.0 / _SAME_SHAFT < factor < _SAME_SHAFT
