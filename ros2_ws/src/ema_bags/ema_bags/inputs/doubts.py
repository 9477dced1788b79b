# SPDX-License-Identifier: Apache-2.0
"""Doubts about a recognised mapping as typed values; ``doubt_wording`` has their text."""

from dataclasses import dataclass
from enum import StrEnum, auto

from ema_bags.inputs.factors import MappingChange


class DoubtKind(StrEnum):
    """Why an entry of a recognised mapping may be wrong, or how it was chosen."""

    NO_MOTION = auto()
    """The motion does not show which column is which; names alone decide."""
    NAME_ALONE = auto()
    """Only the name supports the column; the motion does not confirm it."""
    VALUES_ALONE = auto()
    """Only the values support the column; the name does not."""
    ALTERNATIVES = auto()
    """The columns in ``names`` are alternatives."""
    SET_POINT = auto()
    """The name suggests a setpoint rather than a measurement."""
    FROM_ERROR = auto()
    """The position is the command minus the position error."""
    NO_COMMAND = auto()
    """No column or topic was recognised as the command."""
    NOT_FOUND = auto()
    """No column was recognised as the quantity."""
    CONSTANT = auto()
    """The column never changes and is not mapped."""
    UNIT_GUESSED = auto()
    """The name of the column states no unit."""
    EFFORT_KIND = auto()
    """The effort may be a current, or the torque of motor or joint."""
    LEAD_GUESSED = auto()
    """The lead of a linear axis is unknown; ``value`` [m] is assumed."""
    ELEMENT_GUESSED = auto()
    """The element of the array is assumed."""
    ENCODING = auto()
    """The values come from a signed register that was read as unsigned."""
    MAGNITUDE = auto()
    """The effort is never negative: it has no sign, or a load keeps it above 0."""
    CHANGED = auto()
    """``change`` makes the columns consistent."""
    FEW_SAMPLES = auto()
    """There are too few samples to compare the columns."""
    SIGN_UNCHECKED = auto()
    """The motion does not show the sign and unit of the effort."""
    SIGN_REVERSED = auto()
    """The effort opposes the acceleration unless its sign is reversed."""
    JOINT_TORQUE = auto()
    """The torque is too large for the motor."""
    EFFORT_SIZE = auto()
    """The effort is ``value`` times what the described inertia and friction require."""
    SAMPLING_UNKNOWN = auto()
    """The sampling of the effort cannot be inferred from data."""
    PHASE_CURRENTS = auto()
    """The phase currents in ``names`` must be mapped by hand."""
    WINDING = auto()
    """The column may be the temperature of the winding and is not mapped."""
    CLOCK_UNIT = auto()
    """The time unit is inferred from the values or their steps."""
    NO_CLOCK = auto()
    """No column was recognised as the time; a rate of ``value`` [Hz] is assumed."""
    NO_NUMBERS = auto()
    """The column contains no numbers."""


@dataclass(frozen=True)
class Doubt:
    """A doubt about one quantity of a mapping."""

    kind: DoubtKind
    quantity: str = ""
    """Section of the mapping, such as ``position`` or ``clock``; empty for the whole joint."""
    column: str = ""
    """Column or field path in doubt."""
    names: tuple[str, ...] = ()
    """Other columns that the doubt refers to."""
    entry: str = ""
    """Value of the entry that was chosen, such as a unit or an encoding."""
    value: float = 0.0
    """Measured or assumed value."""
    change: MappingChange | None = None
    """Change of the mapping, for ``CHANGED``."""


COSTLY = frozenset(
    (
        DoubtKind.NO_MOTION,
        DoubtKind.NAME_ALONE,
        DoubtKind.VALUES_ALONE,
        DoubtKind.ALTERNATIVES,
        DoubtKind.ELEMENT_GUESSED,
        DoubtKind.FEW_SAMPLES,
        DoubtKind.NO_CLOCK,
    )
)
"""Doubts about which column is meant, rather than about its unit or sign."""
