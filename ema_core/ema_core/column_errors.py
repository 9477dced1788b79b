# SPDX-License-Identifier: Apache-2.0
"""Errors of telemetry columns: wrong factors, and the common mistakes that explain them.

Three modules share the table of mistakes. Each detects errors from different data:

- `ema_bags.inputs.factors` uses the mapping with its units, shafts and signs. It works for any
  motion, finds several wrong entries in one run, and names the entry to change. Without a model of
  the drive, it compares position, command and speed with each other and with the described limits.
- `ema_monitor.identification.column_scale` uses a window in SI units, of a unit that may be faulty.
  It checks only relations that no fault scales, and trusts the calibrated parameters.
- `ema_monitor.calibration.description_misfit` compares healthy windows with the response of the
  described actuator. It can check the current in all motions, but cannot separate a wrong column
  from a wrong parameter, so its tolerance is wider.

`column_wording` formats errors as text.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple, Self

from ema_core.units import ANGLES, LENGTHS, SPEEDS

NEAR: Final = 0.1
"""Relative tolerance for matching a factor to a mistake [-]. Sensors and faults change a relation
between columns by a few per cent, and the factors of most mistakes differ by more than twice this
tolerance."""

NEAR_MODEL: Final = 0.4
"""Tolerance for matching a factor relative to the modelled response of the described actuator [-].
Healthy windows of random units deviate by at most 8 %; deviations that are not yet fitted may be
several times larger."""


class Kind(Enum):
    """Kind of a mistake."""

    SIGN = "sign"
    UNIT = "unit"
    SHAFT = "shaft"
    """Values refer to the other side of the gear."""
    SCALE = "scale"
    """Values are in thousandths of the stated unit, or vice versa."""
    GEAR_RATIO = "gear ratio"
    """The gear ratio was applied twice, or not at all."""
    AMPLITUDE = "amplitude"
    """Peak values instead of root mean square, or vice versa."""


class Reference(Enum):
    """Reference with which a column is compared."""

    POSITION = "position"
    SPEED = "speed"
    INERTIA = "inertia"
    DRIVE = "drive"
    MODEL = "model"
    """The response of a healthy actuator as described."""
    RECORDS = "records"
    """Healthy records of the unit."""


class Mistake(NamedTuple):
    """A common mistake that multiplies a column by ``factor``."""

    kind: Kind
    factor: float
    unit: str = ""
    """Unit or convention of the values."""
    stated: str = ""
    """Unit or convention in which the values are interpreted."""

    @property
    def is_of_si(self) -> bool:
        """Whether the values are interpreted in SI units. True if the mistake is not a unit."""
        return self.kind is not Kind.UNIT or self.stated in ("rad", "rad/s")


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
        return cls(columns, factor, reference, _mistakes_of(usual, factor, within))


@dataclass(frozen=True)
class UnrelatedColumn:
    """A column that does not follow its reference, and the correlation between them [-]."""

    column: str
    correlation: float
    reference: Reference = Reference.MODEL


def mistaken_unit(sizes: dict[str, float], unit: str, stated: str) -> Mistake:
    """Return the mistake of interpreting values in ``unit`` as values in ``stated``.

    ``sizes`` maps the name of each unit to its size in SI units.
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
"""Commonly confused units by column: actual and stated unit. A command is compared with the
position."""

PEAK_FOR_RMS: Final = Mistake(Kind.AMPLITUDE, math.sqrt(2.0), "peak", "RMS")
RMS_FOR_PEAK: Final = Mistake(Kind.AMPLITUDE, math.sqrt(0.5), "RMS", "peak")


def usual_mistakes(column: str, tau: float) -> Iterator[Mistake]:
    """Yield the common mistakes of a column; ``tau`` is the gear ratio, user over motor speed."""
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
    """Return the common mistake that matches a column's factor within 10 %, or None."""
    return _nearest(factor, [*usual_mistakes(column, tau)], NEAR)


def _mistakes_of(usual: Sequence[Mistake], factor: float, within: float) -> tuple[Mistake, ...]:
    """Return the mistakes that explain a factor: one mistake, or a sign error plus another."""
    if mistake := _nearest(factor, usual, within):
        return (mistake,)
    if factor < 0.0 and (mistake := _nearest(-factor, usual, within)):
        return (_SIGN, mistake)
    return ()


def _nearest(factor: float, usual: Sequence[Mistake], within: float) -> Mistake | None:
    away = {abs(factor / mistake.factor - 1.0): mistake for mistake in usual}
    least = min(away)
    return away[least] if least < within else None
