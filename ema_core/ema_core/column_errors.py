"""Columns of telemetry that are wrong: which, by which factor, and which usual mistake that is.

Import and bridge judge the columns of a mapping, calibration and identification the columns of a
window or a record. `column_wording` puts an error into words.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple, Self

from ema_core.units import ANGLES, LENGTHS, SPEEDS

NEAR: Final = 0.1
"""Largest deviation of a factor from the factor of a mistake, as a share of it [-]. Sensors and
faults change a relation between columns by a few per cent, and the factors of most mistakes differ
by more than twice this share."""

NEAR_MODEL: Final = 0.4
"""The same of a column and the response of the actuator as described [-]: healthy windows of drawn
units are off by at most 8 %, and a deviation that is to be fitted may add several times that."""


class Kind(Enum):
    """Kind of a mistake."""

    SIGN = "sign"
    UNIT = "unit"
    SHAFT = "shaft"
    """Values of the other side of the gear."""
    SCALE = "scale"
    """Thousandths for whole units, or the reverse."""
    GEAR_RATIO = "gear ratio"
    """The gear ratio twice, or missing."""
    AMPLITUDE = "amplitude"
    """A peak for a root mean square, or the reverse."""


class Reference(Enum):
    """Standard of comparison of a column."""

    POSITION = "position"
    SPEED = "speed"
    INERTIA = "inertia"
    DRIVE = "drive"
    MODEL = "model"
    """The response of a healthy actuator as described."""
    RECORDS = "records"
    """Healthy records of the unit."""


class Mistake(NamedTuple):
    """A usual mistake, by which a column is ``factor`` times what it should be."""

    kind: Kind
    factor: float
    unit: str = ""
    """Unit or convention of the values."""
    stated: str = ""
    """Unit or convention in which the values are read."""

    @property
    def is_of_si(self) -> bool:
        """Whether the values are read in SI units, or the unit does not matter."""
        return self.kind is not Kind.UNIT or self.stated in ("rad", "rad/s")


@dataclass(frozen=True)
class ColumnError:
    """Columns that are off by one factor.

    Attributes
    ----------
    columns
        One of command, position, speed and current, or several.
    factor
        Values over what they should be [-].
    reference
        What they contradict.
    mistakes
        Usual mistakes that together make this factor; empty if none does.
    """

    columns: tuple[str, ...]
    factor: float
    reference: Reference
    mistakes: tuple[Mistake, ...] = ()

    @classmethod
    def of(cls, columns: tuple[str, ...], factor: float, reference: Reference, tau: float) -> Self:
        """Return the error with its usual mistakes.

        A model of the actuator as described is compared with columns in SI units. Peaks and RMS are
        left out there: their factor is near to 1, and may be of a wrong parameter as well.
        """
        usual, within = [*usual_mistakes(columns[0], tau)], NEAR
        if reference is Reference.MODEL:
            usual = [item for item in usual if item.is_of_si and item.kind is not Kind.AMPLITUDE]
            within = NEAR_MODEL
        return cls(columns, factor, reference, _mistakes_of(usual, factor, within))


@dataclass(frozen=True)
class UnrelatedColumn:
    """A column that does not follow what it should, with the correlation of both [-]."""

    column: str
    correlation: float
    reference: Reference = Reference.MODEL


def mistaken_unit(sizes: dict[str, float], unit: str, stated: str) -> Mistake:
    """Return the mistake to read values of a unit in the ``stated`` unit.

    ``sizes`` has the sizes of both in SI units, by name.
    """
    return Mistake(Kind.UNIT, sizes[stated] / sizes[unit], unit, stated)


_SIGN: Final = Mistake(Kind.SIGN, -1.0)
_THOUSANDTHS: Final = Mistake(Kind.SCALE, 1e3)
_PER_MINUTE: Final = {"/s": 1.0, "/min": 1.0 / 60.0}
_PAIRS: Final = {
    "command": [(ANGLES, "rad", "deg")],
    "position": [
        (ANGLES, "deg", "rad"),
        (ANGLES, "rad", "deg"),
        (ANGLES, "turn", "rad"),
        (ANGLES, "rad", "turn"),
        (LENGTHS, "mm", "in"),
    ],
    "speed": [
        (SPEEDS, "deg/s", "rad/s"),
        (SPEEDS, "rad/s", "deg/s"),
        (SPEEDS, "turn/s", "rad/s"),
        (SPEEDS, "rad/s", "turn/s"),
        (SPEEDS, "rpm", "rad/s"),
        (SPEEDS, "rad/s", "rpm"),
        (_PER_MINUTE, "/min", "/s"),
        (_PER_MINUTE, "/s", "/min"),
    ],
}
"""Units by column that are usually confused: the unit of the values, and the stated unit. A command
is compared with the position."""

PEAK_FOR_RMS: Final = Mistake(Kind.AMPLITUDE, math.sqrt(2.0), "peak", "RMS")
RMS_FOR_PEAK: Final = Mistake(Kind.AMPLITUDE, math.sqrt(0.5), "RMS", "peak")


def usual_mistakes(column: str, tau: float) -> Iterator[Mistake]:
    """Yield the usual mistakes of a column; ``tau`` is the gear ratio, user over motor speed."""
    yield _SIGN
    yield _THOUSANDTHS
    yield _THOUSANDTHS._replace(factor=1e-3)
    for sizes, unit, stated in _PAIRS.get(column, ()):
        yield mistaken_unit(sizes, unit, stated)
    if column == "current":
        yield from (PEAK_FOR_RMS, RMS_FOR_PEAK)
    yield Mistake(Kind.GEAR_RATIO, tau)
    yield Mistake(Kind.SHAFT, 1.0 / tau)


def usual_mistake(column: str, factor: float, tau: float) -> Mistake | None:
    """Return the usual mistake that multiplies a column by a factor, within 10 %, or None."""
    return _nearest(factor, [*usual_mistakes(column, tau)], NEAR)


def _mistakes_of(usual: Sequence[Mistake], factor: float, within: float) -> tuple[Mistake, ...]:
    """Return the mistakes that make a factor: one, or the sign with another one."""
    if mistake := _nearest(factor, usual, within):
        return (mistake,)
    if factor < 0.0 and (mistake := _nearest(-factor, usual, within)):
        return (_SIGN, mistake)
    return ()


def _nearest(factor: float, usual: Sequence[Mistake], within: float) -> Mistake | None:
    away = {abs(factor / mistake.factor - 1.0): mistake for mistake in usual}
    least = min(away)
    return away[least] if least < within else None
