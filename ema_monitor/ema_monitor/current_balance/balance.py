"""The current balance of a motion: its rows, and what explains them (M40)."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.current_balance.columns import MotorMotion
from ema_monitor.current_balance.play import Play, free_play, runs_of
from ema_monitor.current_balance.terms import (
    BASIC,
    OF_CURRENT,
    OF_DIRECTION,
    columns_of,
    ripples,
)

_LEAST_SPEED: Final = 0.05
_HALF_WEIGHT: Final = 0.25


@dataclass(frozen=True, eq=False)
class Balance:
    """Rows of the current balance of one motion, ``n`` of them.

    Attributes
    ----------
    start_ns, end_ns
        Stamps of the first and last sample [ns].
    current
        Mean measured current of each row, ``(n,)`` [A].
    design
        What each term would make of it, ``(n, terms)``, in the order of `terms`.
    nuisance
        The same for load and stiffness, ``(n, 2)``.
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

    start_ns: int
    end_ns: int
    current: NDArray[np.float64]
    design: NDArray[np.float64]
    nuisance: NDArray[np.float64]
    weight: NDArray[np.float64]
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
        columns = MotorMotion.of(telemetry, description)
        play = free_play(columns)
        h, current, turned = columns.step_s, columns.current, columns.turned
        step_speed = np.diff(turned) / h
        span = columns.span
        if columns.speed is not None:
            average = _Average(np.full(span, 1.0 / span), span)
            acceleration = average.of_ends(columns.speed, span) / (span * h)
            slowest = average.least(np.abs(columns.speed), span + 1)
            way = average.common(np.sign(columns.speed), span + 1)
        else:
            # The second difference of the position is the mean acceleration under a triangle.
            ramp = (np.arange(span) + 0.5) / span**2
            average = _Average(np.concatenate([ramp, ramp[::-1]]), span)
            speed = (turned[span:] - turned[:-span]) / (span * h)
            acceleration = average.of_ends(speed, span) / (span * h)
            slowest = np.minimum(np.abs(speed[span:]), np.abs(speed[:-span]))[::span]
            touching = np.zeros(len(step_speed))
            for run in runs_of(columns.shaft, h):
                touching[run.first : run.last] = run.way
            way = average.common(touching, 2 * span)
        middles = (turned[1:] + turned[:-1]) / 2.0 + (play.middle if play else 0.0)
        if play is None:
            middles = middles + float(np.mean(columns.shaft - turned))
        groups = ripples(description.parameters.P)
        design = np.zeros((len(acceleration), len(BASIC) + sum(2 * len(g.orders) for g in groups)))
        design[:, 0] = acceleration
        design[:, 1] = way
        design[:, 2] = average(step_speed)
        design[:, 3] = average(np.clip(current / knee, -1.0, 1.0))
        design[:, 4] = average(np.gradient(current) / h if len(current) > 1 else 0.0 * current)
        where = columns_of(groups)
        for group in groups:
            carrier = -current if group.scales_with == OF_CURRENT else np.ones(len(current))
            for number, order in enumerate(group.orders):
                # The mean of the wave over the angle of a step.
                wave = carrier * np.sinc(order * np.diff(turned) / (2.0 * np.pi))
                pair = np.stack(
                    [
                        average(wave * np.cos(order * middles)),
                        average(wave * np.sin(order * middles)),
                    ],
                    axis=1,
                )
                if group.scales_with == OF_DIRECTION:
                    pair *= way[:, None]
                at = where[group.name].start + 2 * number
                design[:, at : at + 2] = pair
        position = average((columns.shaft[1:] + columns.shaft[:-1]) / 2.0)
        nuisance = np.stack([np.ones(len(way)), position * description.parameters.tau], axis=1)
        rms = float(np.sqrt(np.mean(step_speed**2))) if len(step_speed) else 0.0
        counts = (way != 0.0) & (slowest > _LEAST_SPEED * rms)
        weight = np.where(counts, slowest / np.hypot(slowest, _HALF_WEIGHT * rms + 1e-12), 0.0)
        return cls(
            telemetry.stamp_ns,
            int(telemetry.stamp_at(len(telemetry) - 1)),
            average(current),
            design,
            nuisance,
            weight,
            h * columns.span,
            play,
            float(np.ptp(telemetry.position)),
            float(np.max(np.abs(step_speed), initial=0.0)),
        )

    def __len__(self) -> int:
        return len(self.current)


class _Average:
    """Weighted means over some steps, each begun ``every`` steps after the one before."""

    def __init__(self, weights: NDArray[np.float64], every: int) -> None:
        self._weights = weights
        self._every = every

    def __call__(self, steps: NDArray[np.float64]) -> NDArray[np.float64]:
        if len(steps) < len(self._weights):
            return np.zeros(0)
        return np.convolve(steps, self._weights[::-1], mode="valid")[:: self._every]

    def of_ends(self, values: NDArray[np.float64], apart: int) -> NDArray[np.float64]:
        """Return by how much values rise from one to that ``apart`` places later."""
        return (values[apart:] - values[:-apart])[:: self._every]

    def least(self, values: NDArray[np.float64], n: int) -> NDArray[np.float64]:
        """Return the least of each ``n`` values."""
        if len(values) < n:
            return np.zeros(0)
        return np.min(sliding_window_view(values, n)[:: self._every], axis=1)

    def common(self, ways: NDArray[np.float64], n: int) -> NDArray[np.float64]:
        """Return the direction that ``n`` values have in common, 0 where they differ."""
        if len(ways) < n:
            return np.zeros(0)
        views = sliding_window_view(ways, n)[:: self._every]
        return np.where(np.all(views == views[:, :1], axis=1), views[:, 0], 0.0)
