# SPDX-License-Identifier: Apache-2.0
"""Pick-and-place cycle of the simulated arm with two parts."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_sim.robot.joint import CONTROL_S

Vector = NDArray[np.float64]

HOME: Final = np.array([0.0, 0.2, 1.2, 0.3, 0.0, 0.0])
"""Position of the joints at the start and end of a cycle [rad]."""

_LIFT: Final = np.array([0.0, -0.33, 0.06, 0.27, 0.0, 0.0])  # from a goal to the point above it
_PICK: Final = (
    np.array([-0.9, 0.85, 1.0, -0.25, -0.5, 0.9]),
    np.array([-0.6, 0.95, 0.8, -0.15, -0.35, 1.3]),
)
_PLACE: Final = (
    np.array([0.7, 0.75, 1.2, -0.35, 0.45, -0.6]),
    np.array([1.0, 0.65, 1.4, -0.45, 0.65, -1.0]),
)
_VARIATION: Final = 0.015  # standard deviation of goals between cycles [rad]
_MOST: Final = 2.5  # largest variation, in standard deviations

_TRANSFER_S: Final = 1.9
_LIFT_S: Final = 0.9
_HAND_S: Final = 0.5  # rest while the hand closes or opens
_CLOSE_S: Final = 0.1  # time in which the weight of the part shifts to or from the hand


class _Segment(NamedTuple):
    goal: Vector
    seconds: float
    is_held: bool  # whether a part is in the hand at the end


@dataclass(frozen=True, eq=False)
class CyclePlan:
    """Motion of a cycle; moves are fifth-order polynomials, and all joints move simultaneously."""

    starts: Vector
    """Start of each segment, and end of the last segment [s], ``(m + 1,)``."""
    poses: Vector
    """Position of the joints at these times [rad], ``(m + 1, 6)``."""
    held: Vector
    """Share of the part's weight held by the hand at these times, ``(m + 1,)`` [-]."""
    moving_s: float
    """Time in motion [s]."""

    def reference(self, start: int, stop: int) -> Vector:
        """Return planned position, speed and acceleration of the joints, ``(6, n, 3)``.

        The units are rad, rad/s and rad/s^2; ``start`` to ``stop`` (exclusive) are control periods.
        """
        t = CONTROL_S * np.arange(start, stop)
        at = np.minimum(np.searchsorted(self.starts, t, side="right"), len(self.starts) - 1) - 1
        length = np.diff(self.starts)[at]
        s = np.minimum((t - self.starts[at]) / length, 1.0)
        distance = np.diff(self.poses, axis=0)[at]
        shape = np.column_stack(
            [
                s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
                30.0 * s**2 * (1.0 - s) ** 2 / length,
                60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / length**2,
            ]
        )
        reference = distance.T[:, :, None] * shape
        reference[:, :, 0] += self.poses[at].T
        return reference

    def weight(self, start: int, stop: int) -> Vector:
        """Return the share of the part's weight held by the hand, ``(n,)`` [-].

        ``start`` to ``stop`` (exclusive) are control periods.
        """
        t = CONTROL_S * np.arange(start, stop)
        before = np.searchsorted(self.starts, t, side="right") - 1
        before = np.minimum(before, len(self.held) - 2)
        share = np.clip((t - self.starts[before]) / _CLOSE_S, 0.0, 1.0)
        return self.held[before] + share * np.diff(self.held)[before]


def plan_cycle(pause_s: float, rng: np.random.Generator) -> CyclePlan:
    """Return the motion of a cycle, with goals that vary at random, as with real parts.

    Parameters
    ----------
    pause_s
        Rest at the end of the cycle [s].
    rng
        Random generator for the goals.
    """
    segments = list(_segments(pause_s, rng))
    seconds = [segment.seconds for segment in segments]
    poses = np.array([HOME, *(segment.goal for segment in segments)])
    is_moving = np.any(np.diff(poses, axis=0) != 0.0, axis=1)
    return CyclePlan(
        starts=np.concatenate([[0.0], np.cumsum(seconds)]),
        poses=poses,
        held=np.array([0.0, *(float(segment.is_held) for segment in segments)]),
        moving_s=float(np.sum(np.array(seconds)[is_moving])),
    )


def _segments(pause_s: float, rng: np.random.Generator) -> Iterator[_Segment]:
    for pick, place in zip(_PICK, _PLACE, strict=True):
        for goal, is_held in ((pick, True), (place, False)):
            varied = goal + _VARIATION * np.clip(rng.standard_normal(6), -_MOST, _MOST)
            yield _Segment(varied + _LIFT, _TRANSFER_S, not is_held)
            yield _Segment(varied, _LIFT_S, not is_held)
            yield _Segment(varied, _HAND_S, is_held)
            yield _Segment(varied + _LIFT, _LIFT_S, is_held)
    yield _Segment(HOME, _TRANSFER_S, False)
    if pause_s > 0.0:
        yield _Segment(HOME, pause_s, False)
