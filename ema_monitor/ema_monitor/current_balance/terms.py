"""The terms of the current balance: which torques the measured current is made of (M40)."""

from typing import Final, NamedTuple


class Ripple(NamedTuple):
    """A torque that repeats with the angle of the motor.

    Attributes
    ----------
    name, label
        Name in code and files, and in words.
    orders
        Periods in a turn of the motor.
    scales_with
        What it is in proportion to: the current, nothing, or the direction of motion.
    """

    name: str
    label: str
    orders: tuple[int, ...]
    scales_with: str


BASIC: Final = ("inertia", "friction", "viscous", "dead_current", "delay")
"""Inertia, dry and viscous friction, all over the torque per ampere; the part of the measured
current that makes no torque; how much later the current is than the speed."""

NUISANCES: Final = ("load", "stiffness")
"""What is of one window alone: a constant load, and one in proportion to the position."""

OF_CURRENT: Final = "current"
OF_TORQUE: Final = "torque"
OF_DIRECTION: Final = "direction"


def ripples(pole_pairs: int) -> tuple[Ripple, ...]:
    """Return the torques that repeat with the angle of a motor (M43).

    A phase that differs from the others is felt twice in an electrical turn. An eccentric rotor
    modulates the phases once a turn, which gives ``2 P - 1`` and, commutated in six steps,
    ``4 P + 1`` periods. Cogging of a motor with one slot per pole and phase has ``6 P``; what rubs
    at one place of the shaft, or a bent shaft, has one.

    Parameters
    ----------
    pole_pairs
        Pole pairs P.
    """
    P = pole_pairs
    return (
        Ripple("phases", "phases that differ", (2 * P, 4 * P), OF_CURRENT),
        Ripple("eccentricity", "eccentricity", (2 * P - 1, 4 * P + 1), OF_CURRENT),
        Ripple("cogging", "cogging", (6 * P,), OF_TORQUE),
        Ripple("turn", "friction once a turn", (1,), OF_DIRECTION),
    )


def columns_of(groups: tuple[Ripple, ...]) -> dict[str, slice]:
    """Return where the columns of each ripple are, after the basic ones: a cosine and a sine."""
    found, at = {}, len(BASIC)
    for group in groups:
        width = 2 * len(group.orders)
        found[group.name] = slice(at, at + width)
        at += width
    return found
