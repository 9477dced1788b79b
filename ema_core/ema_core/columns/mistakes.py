# SPDX-License-Identifier: Apache-2.0
"""Common mistakes in telemetry columns, and the mistakes that explain a factor."""

import math
from collections.abc import Iterator, Sequence
from enum import Enum
from typing import Final, Literal, NamedTuple

from ema_core.columns.tolerances import NEAR
from ema_core.units import ANGLES, LENGTHS, SPEEDS


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
    FROZEN = "frozen"
    """Values are constant although other columns show motion."""
    HELD = "held"
    """Values are updated more slowly than they are sampled."""
    WRAPPED = "wrapped"
    """Values wrap after a turn, or at the end of their register."""


FactorKind = Literal[Kind.SIGN, Kind.UNIT, Kind.SHAFT, Kind.SCALE, Kind.GEAR_RATIO, Kind.AMPLITUDE]
"""Kind of a mistake that multiplies a column by a factor."""


class Mistake(NamedTuple):
    """A common mistake that multiplies a column by ``factor``."""

    kind: FactorKind
    factor: float
    unit: str = ""
    """Unit or convention of the values."""
    stated: str = ""
    """Unit or convention in which the values are interpreted."""

    @property
    def is_of_si(self) -> bool:
        """Whether the stated unit is an SI unit; True if the mistake is not a unit."""
        return self.kind is not Kind.UNIT or self.stated in ("rad", "rad/s")


def mistaken_unit(sizes: dict[str, float], unit: str, stated: str) -> Mistake:
    """Return the mistake of interpreting values in ``unit`` as values in ``stated``.

    ``sizes`` maps the name of each unit to its size in SI units.
    """
    return Mistake(Kind.UNIT, sizes[stated] / sizes[unit], unit, stated)


SIGN: Final = Mistake(Kind.SIGN, -1.0)
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
    yield SIGN
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


def mistakes_of(usual: Sequence[Mistake], factor: float, within: float) -> tuple[Mistake, ...]:
    """Return the mistakes that explain a factor: one mistake, or a sign error plus another."""
    if mistake := _nearest(factor, usual, within):
        return (mistake,)
    if factor < 0.0 and (mistake := _nearest(-factor, usual, within)):
        return (SIGN, mistake)
    return ()


def _nearest(factor: float, usual: Sequence[Mistake], within: float) -> Mistake | None:
    away = {abs(factor / mistake.factor - 1.0): mistake for mistake in usual}
    least = min(away)
    return away[least] if least < within else None
