"""The current balance of a motion: its terms, its rows, and what explains them (M40)."""

from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.current_balance.motion import MotorMotion, Play, free_play, runs_of

BASIC: Final = ("inertia", "friction", "viscous", "dead_current", "delay")
"""Inertia, dry and viscous friction, all over the torque per ampere; the part of the measured
current that makes no torque; how much later the current is than the speed."""

OF_CURRENT: Final = "current"
_LEAST_SPEED: Final = 0.05
_HALF_WEIGHT: Final = 0.25


class Ripple(NamedTuple):
    """A torque that repeats with the angle of the motor.

    Attributes
    ----------
    label
        What it is, in words.
    orders
        Periods in a turn of the motor.
    scales_with
        What it is in proportion to: the current, nothing ("torque"), or the direction of motion.
    terms
        Where its terms are among all, after the basic ones: a cosine and a sine for each order.
    """

    label: str
    orders: tuple[int, ...]
    scales_with: str
    terms: slice


def ripples(pole_pairs: int) -> dict[str, Ripple]:
    """Return the torques that repeat with the angle of a motor, by name (M43).

    A phase that differs from the others is felt twice in an electrical turn. An eccentric rotor
    modulates the phases once a turn, which gives ``2 P - 1`` and, commutated in six steps,
    ``4 P + 1`` periods. Cogging of a motor with one slot per pole and phase has ``6 P``; what rubs
    at one place of the shaft, or a bent shaft, has one.

    Parameters
    ----------
    pole_pairs
        Pole pairs P.
    """
    P, at = pole_pairs, len(BASIC)
    found: dict[str, Ripple] = {}
    for name, label, orders, scales_with in (
        ("phases", "phases that differ", (2 * P, 4 * P), OF_CURRENT),
        ("eccentricity", "eccentricity", (2 * P - 1, 4 * P + 1), OF_CURRENT),
        ("cogging", "cogging", (6 * P,), "torque"),
        ("turn", "friction once a turn", (1,), "direction"),
    ):
        found[name] = Ripple(label, orders, scales_with, slice(at, at + 2 * len(orders)))
        at += 2 * len(orders)
    return found


def number_of_terms(pole_pairs: int) -> int:
    """Return the number of terms, the basic ones and the ripples."""
    return max(one.terms.stop for one in ripples(pole_pairs).values())


@dataclass(frozen=True, eq=False)
class Balance:
    """Rows of the current balance of one motion, ``n`` of them.

    Attributes
    ----------
    current
        Mean measured current of each row, ``(n,)`` [A].
    design
        What each term would make of it, ``(n, terms)``.
    nuisance
        The same for load and stiffness, which are of one motion alone, ``(n, 2)``.
    weight
        What each row counts, ``(n,)`` [-].
    step_s
        Time from one row to the next [s].
    play
        Free play that the motion shows, if it does.
    travel
        Travel of the user shaft [rad].
    fastest
        Largest speed of the motor [rad/s].
    """

    current: Array
    design: Array
    nuisance: Array
    weight: Array
    step_s: float
    play: Play | None
    travel: float
    fastest: float

    @classmethod
    def of(cls, telemetry: Telemetry, description: ActuatorDescription, knee: float) -> Self:
        """Return the balance of telemetry.

        Parameters
        ----------
        telemetry
            At least three samples.
        description
            The actuator: gear, pole pairs, and how its telemetry is acquired.
        knee
            Current from which on the part that makes no torque is constant [A].
        """
        motion = MotorMotion.of(telemetry, description)
        play = free_play(motion)
        h, span, current, turned = motion.step_s, motion.span, motion.current, motion.turned
        step_speed = np.diff(turned) / h
        if motion.speed is not None:
            average = _Average(np.full(span, 1.0 / span), span)
            acceleration = average.of_ends(motion.speed, span) / (span * h)
            slowest = average.least(np.abs(motion.speed), span + 1)
            way = average.common(np.sign(motion.speed), span + 1)
        else:
            # The second difference of the position is the mean acceleration under a triangle.
            ramp = (np.arange(span) + 0.5) / span**2
            average = _Average(np.concatenate([ramp, ramp[::-1]]), span)
            speed = (turned[span:] - turned[:-span]) / (span * h)
            acceleration = average.of_ends(speed, span) / (span * h)
            slowest = np.minimum(np.abs(speed[span:]), np.abs(speed[:-span]))[::span]
            touching = np.zeros(len(step_speed))
            for run in runs_of(motion.shaft, h):
                touching[run.first : run.last] = run.way
            way = average.common(touching, 2 * span)
        middles = (turned[1:] + turned[:-1]) / 2.0 + (play.middle if play else 0.0)
        if play is None:
            middles = middles + float(np.mean(motion.shaft - turned))
        P = description.parameters.P
        design = np.zeros((len(acceleration), number_of_terms(P)))
        design[:, 0] = acceleration
        design[:, 1] = way
        design[:, 2] = average(step_speed)
        design[:, 3] = average(np.clip(current / knee, -1.0, 1.0))
        design[:, 4] = average(np.gradient(current) / h if len(current) > 1 else 0.0 * current)
        for ripple in ripples(P).values():
            carrier = -current if ripple.scales_with == OF_CURRENT else np.ones(len(current))
            for at, order in enumerate(ripple.orders):
                # The mean of the wave over the angle of a step.
                wave = carrier * np.sinc(order * np.diff(turned) / (2.0 * np.pi))
                waves = wave * np.cos(order * middles), wave * np.sin(order * middles)
                pair = np.stack([average(one) for one in waves], axis=1)
                if ripple.scales_with == "direction":
                    pair *= way[:, None]
                first = ripple.terms.start + 2 * at
                design[:, first : first + 2] = pair
        position = average((motion.shaft[1:] + motion.shaft[:-1]) / 2.0)
        nuisance = np.stack([np.ones(len(way)), position * description.parameters.tau], axis=1)
        rms = float(np.sqrt(np.mean(step_speed**2))) if len(step_speed) else 0.0
        counts = (way != 0.0) & (slowest > _LEAST_SPEED * rms)
        weight = np.where(counts, slowest / np.hypot(slowest, _HALF_WEIGHT * rms + 1e-12), 0.0)
        travel = float(np.ptp(telemetry.position))
        fastest = float(np.max(np.abs(step_speed), initial=0.0))
        return cls(average(current), design, nuisance, weight, h * span, play, travel, fastest)

    @property
    def rows(self) -> int:
        """Number of rows that count."""
        return int(np.count_nonzero(self.weight))


class _Average:
    """Weighted means over some steps, each begun ``every`` steps after the one before."""

    def __init__(self, weights: Array, every: int) -> None:
        self._weights = weights
        self._every = every

    def __call__(self, steps: Array) -> Array:
        if len(steps) < len(self._weights):
            return np.zeros(0)
        return np.convolve(steps, self._weights[::-1], mode="valid")[:: self._every]

    def of_ends(self, values: Array, apart: int) -> Array:
        """Return by how much values rise from one to that ``apart`` places later."""
        return (values[apart:] - values[:-apart])[:: self._every]

    def least(self, values: Array, n: int) -> Array:
        """Return the least of each ``n`` values."""
        if len(values) < n:
            return np.zeros(0)
        return np.min(sliding_window_view(values, n)[:: self._every], axis=1)

    def common(self, ways: Array, n: int) -> Array:
        """Return the direction that ``n`` values have in common, 0 where they differ."""
        if len(ways) < n:
            return np.zeros(0)
        views = sliding_window_view(ways, n)[:: self._every]
        return np.where(np.all(views == views[:, :1], axis=1), views[:, 0], 0.0)
