# SPDX-License-Identifier: Apache-2.0
"""Data classes for errors of telemetry columns."""

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Self

from ema_core.columns.mistakes import Kind, Mistake, mistakes_of, usual_mistakes
from ema_core.columns.tolerances import NEAR, NEAR_MODEL


class Reference(StrEnum):
    """Reference with which a column is compared."""

    POSITION = "position"
    SPEED = "speed"
    INERTIA = "inertia"
    DRIVE = "drive"
    MODEL = "model"
    """The response of a healthy actuator as described."""
    RECORDS = "records"
    """Healthy records of the unit."""


@dataclass(frozen=True)
class ColumnError:
    """Columns that are wrong by a common factor."""

    columns: tuple[str, ...]
    """Names of the wrong columns: command, position, speed or current."""
    factor: float
    """Ratio of the values to the expected values [-]."""
    reference: Reference
    """Reference that the columns contradict."""
    mistakes: tuple[Mistake, ...] = ()
    """Common mistakes that together explain the factor; empty if none do."""

    @classmethod
    def of(cls, columns: tuple[str, ...], factor: float, reference: Reference, tau: float) -> Self:
        """Return the column error, with the common mistakes that explain its factor.

        ``tau`` is the gear ratio, user over motor speed. With ``Reference.MODEL``, columns are
        compared in SI units, and confusion of peak and RMS is ignored: its factor is close to 1 and
        might also result from a wrong parameter.
        """
        usual, within = [*usual_mistakes(columns[0], tau)], NEAR
        if reference is Reference.MODEL:
            usual = [item for item in usual if item.is_of_si and item.kind is not Kind.AMPLITUDE]
            within = NEAR_MODEL
        return cls(columns, factor, reference, mistakes_of(usual, factor, within))


@dataclass(frozen=True)
class UnrelatedColumn:
    """A column that does not follow its reference, and the correlation between them [-]."""

    column: str
    correlation: float
    reference: Reference = Reference.MODEL


@dataclass(frozen=True)
class FrozenColumn:
    """A column that is constant although another column shows motion."""

    kind: ClassVar = Kind.FROZEN
    column: str
    value: float
    """The constant value."""
    moving: str
    """Name of a column that shows motion."""
    samples: int
    """Number of finite samples."""


@dataclass(frozen=True)
class HeldColumn:
    """A column that is updated more slowly than it is sampled."""

    kind: ClassVar = Kind.HELD
    column: str
    mean: float
    """Mean number of samples per update during motion."""
    longest: int
    """Largest usual number of samples per update during motion."""
    is_regular: bool
    """Whether each update has the same number of samples."""


@dataclass(frozen=True)
class WrappedColumn:
    """An angle that wraps after a turn, or at the end of its register."""

    kind: ClassVar = Kind.WRAPPED
    column: str
    period: float
    """Size of a wrap, in source units."""
    count: int
    """Number of wraps."""
