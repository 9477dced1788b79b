# SPDX-License-Identifier: Apache-2.0
"""Results of the examination of a file, bag or topic, as typed values.

``examination_wording`` makes the texts.
"""

import re
from dataclasses import dataclass
from enum import StrEnum, auto

from ema_bags.inputs.doubts import Doubt
from ema_bags.inputs.input_defect import InputDefect
from ema_bags.inputs.joint_mappings import shared_mappings
from ema_bags.inputs.mapping import ColumnMapping


class Ability(StrEnum):
    """Quantity of a joint that the monitor can compare between records."""

    FRICTION = auto()
    VISCOUS_FRICTION = auto()
    TORQUE = auto()
    INERTIA = auto()
    LOAD = auto()
    PLAY = auto()
    TRACKING_LAG = auto()


class Need(StrEnum):
    """Condition that a recording must meet so that a quantity can be judged."""

    EFFORT = auto()
    """A current, torque or force."""
    VARYING_EFFORT = auto()
    """An effort that is not constant."""
    COMMAND = auto()
    """The commanded position."""
    MEASURED_POSITION = auto()
    """A measured position, rather than a setpoint."""
    MEASURED_EFFORT = auto()
    """A measured effort, rather than a setpoint."""
    MOTION = auto()
    """Motion of the joint."""
    STROKES = auto()
    """Strokes in both directions."""
    SPEEDS = auto()
    """Several speeds."""
    ACCELERATION = auto()
    """Acceleration that is visible in the effort."""
    INERTIA_OR_GRAVITY = auto()
    """Inertia or gravity that is visible in the effort in addition to friction."""
    BOTH_SIDES = auto()
    """The speed of the motor together with the position of the joint."""


@dataclass(frozen=True)
class AbilityResult:
    """Whether a quantity can be judged from the recording."""

    ability: Ability
    needs: tuple[Need, ...]
    """Missing conditions; empty if the quantity can be judged."""


@dataclass(frozen=True)
class Timing:
    """Sample rate and losses of a joint."""

    rate_hz: float
    """Sample rate measured from the stamps [Hz]."""
    jitter_s: float
    """Robust standard deviation of the stamps from regular stamps [s]."""
    duration_s: float
    """Time from the first to the last sample [s]."""
    samples: int
    lost: int
    """Samples missing in gaps."""
    gaps: int
    """Number of gaps in which samples are missing."""
    pauses: int
    """Interruptions of more than 1 s."""
    clock_jumps: int
    """Backward steps of the clock."""
    repeated: int
    """Samples that repeat the previous stamp."""
    reordered: int
    """Samples out of order."""
    rebuilt: int
    """Stamps reconstructed from arrival times."""


@dataclass(frozen=True)
class ColumnExamination:
    """Statistics of one column, in the unit of the source."""

    quantity: str
    """Section of the mapping: position, command, error, speed, current, temperature or
    payload."""
    source: str
    """Column of a table, or field path of a message."""
    topic: str
    """Topic; empty for a table."""
    unit: str
    doubts: tuple[Doubt, ...]
    low: float
    """Smallest value."""
    high: float
    """Largest value."""
    step: float
    """Quantisation step; NaN if none is visible."""
    held_every: int
    """Samples per update of the value; 1 if every sample is updated, 0 if unknown."""
    held_share: float
    """Share of the samples in motion that repeat the previous value [-]."""
    held_longest: int
    """Largest number of successive samples in motion with the same value."""
    saturated_share: float
    """Share of the samples at the largest absolute value [-]."""
    missing: int
    """Samples without a finite value."""


@dataclass(frozen=True)
class JointRelations:
    """Relations between the columns of a joint."""

    command_lag_s: float
    """Lag of the position behind the command [s]; NaN if unknown."""
    speed_lag_s: float
    """Lag of the speed behind the derivative of the position [s]; NaN if unknown."""
    effort_lag_s: float
    """Lag of the effort behind the effort that the motion explains [s]; NaN if unknown."""
    speed_factor: float
    """Speed divided by the derivative of the position [-]; NaN if unknown."""
    explained_effort: float
    """Share of the effort that inertia, friction and gravity explain [-]; NaN if unknown."""


@dataclass(frozen=True)
class JointMotion:
    """Motion of a joint, at the user shaft."""

    unit: str
    """Unit of ``travel``: rad or m. Speeds have this unit per second."""
    travel: float
    """Range of the position."""
    strokes_forward: int
    strokes_backward: int
    pieces: int
    """Number of strokes in the direction that has fewer; a long stroke counts once per 2 s."""
    slowest: float
    """5 % quantile of the speed during motion [unit/s]."""
    fastest: float
    """95 % quantile of the speed during motion [unit/s]."""
    speed_spread: float
    """Standard deviation of the absolute speed during motion, divided by its mean [-]."""
    moving_s: float
    """Time in motion [s]."""


@dataclass(frozen=True)
class JointExamination:
    """Examination of one joint."""

    joint: str
    """Name of the joint; empty if the source has one joint."""
    mapping: ColumnMapping
    """Column mapping of this joint."""
    columns: tuple[ColumnExamination, ...]
    doubts: tuple[Doubt, ...]
    """Doubts about the joint as a whole; those about one column are in ``columns``."""
    timing: Timing | None
    """Sample rate and losses; None if the samples could not be read, with ``problem`` as reason."""
    relations: JointRelations | None
    motion: JointMotion | None
    wraps: int
    """Number of angle wraps that were unwrapped."""
    impossible: int
    """Physically impossible samples."""
    second_position: str
    """Column with a second measurement of the position; empty if there is none."""
    abilities: tuple[AbilityResult, ...]
    defects: tuple[InputDefect, ...]
    problem: str = ""
    """Why the joint could not be examined; empty if it was."""

    def column(self, quantity: str) -> ColumnExamination | None:
        """Return the column of a quantity; None if there is none."""
        return next((item for item in self.columns if item.quantity == quantity), None)

    def can_judge(self, ability: Ability) -> bool:
        """Return whether a quantity can be judged."""
        return any(item.ability is ability and not item.needs for item in self.abilities)

    @property
    def is_sound(self) -> bool:
        """Whether friction can be judged, and no error prevents the import."""
        return self.can_judge(Ability.FRICTION) and not any(item.is_error for item in self.defects)


@dataclass(frozen=True)
class Examination:
    """Examination of a source: a file, a bag, or topics."""

    source: str
    """Path of the file or bag, or the topics."""
    names: tuple[str, ...]
    """Names of the columns or topics of the source."""
    joints: tuple[JointExamination, ...]
    remarks: tuple[str, ...] = ()
    """Damage found while reading."""

    @property
    def unused(self) -> tuple[str, ...]:
        """Columns or topics that no joint uses."""
        used = {item.mapping.clock.source for item in self.joints}
        used |= {item.mapping.table.segment for item in self.joints}
        for item in self.joints:
            for column in item.columns:
                used |= {column.topic, column.source, *re.split(r"\s[+-]\s", column.source)}
        return tuple(name for name in self.names if name not in used)

    @property
    def mappings(self) -> tuple[ColumnMapping, ...]:
        """Mappings for ``ema import``, in order of decreasing number of joints.

        Joints whose mappings differ only in the joint's name share a mapping.
        """
        return shared_mappings(item.mapping for item in self.joints)
