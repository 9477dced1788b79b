"""Commands given as trajectories of points, as trajectory_msgs/JointTrajectory has them."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_STEP_S: Final = 1e-4


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Points of one joint.

    Attributes
    ----------
    start_ns
        When it begins [ns].
    times
        Times of the points from the start, ``(n,)``, growing [s].
    positions, velocities, accelerations
        ``(n,)``, in the units of the message; the last two are empty where they are not given.
    """

    start_ns: int
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    accelerations: NDArray[np.float64]


def trajectory_of(message: Any, joint: str, start_ns: int = 0) -> Trajectory:
    """Return the points of a joint in a message.

    Parameters
    ----------
    joint
        Its name; may be empty where there is one joint.

    Raises
    ------
    ValueError
        When the message has no such joint, or points that are no trajectory.
    """
    names = list(message.joint_names)
    if joint not in names and (joint or len(names) != 1):
        raise ValueError(
            f"joint {joint!r} is not in the joint_names of a trajectory, which has "
            f"{', '.join(names) or 'none'}"
        )
    index = names.index(joint) if joint else 0
    points = message.points
    times = np.array(
        [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points], dtype=float
    )
    if np.any(np.diff(times) <= 0.0):
        raise ValueError("the time_from_start of a trajectory's points does not grow")
    rows = [
        np.array([getattr(p, name)[index] for p in points if len(getattr(p, name)) > index])
        for name in ("positions", "velocities", "accelerations")
    ]
    if len(rows[0]) != len(points):
        raise ValueError(f"{len(points) - len(rows[0])} points of a trajectory have no position")
    given = [row.astype(float) if len(row) == len(points) else np.empty(0) for row in rows]
    return Trajectory(start_ns, times, given[0], given[1], given[2])


def evaluate(
    trajectories: list[Trajectory], stamps_ns: NDArray[np.int64], positions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], list[Trajectory]]:
    """Return the command at some times, and the trajectories with where they begin.

    A trajectory replaces the one before from its start on. Between points it is a line, a cubic
    with velocities and a quintic with accelerations; it begins at the command of the moment, or at
    the measured position where there is none, and ends at its last point.

    Parameters
    ----------
    trajectories
        Trajectories in the order they came.
    stamps_ns
        Times, growing, ``(n,)`` [ns].
    positions
        Measured positions then, in the units of the message, ``(n,)``.

    Returns
    -------
    command
        ``(n,)``; not a number before the first trajectory.
    trajectories
        In the same order; one that has begun has a point at its start.
    """
    command = np.full(len(stamps_ns), np.nan)
    resolved = list(trajectories)
    if not len(stamps_ns):
        return command, resolved
    state: tuple[float, float] | None = None
    order = sorted(range(len(resolved)), key=lambda i: resolved[i].start_ns)
    for number, i in enumerate(order):
        start_ns = resolved[i].start_ns
        if start_ns > stamps_ns[-1]:
            break
        if state is None:
            nearest = min(int(np.searchsorted(stamps_ns, start_ns)), len(positions) - 1)
            state = (float(positions[nearest]), 0.0)
        begun = resolved[i] = _from(resolved[i], *state)
        own = stamps_ns >= start_ns
        if number + 1 < len(order):
            end_ns = resolved[order[number + 1]].start_ns
            own &= stamps_ns < end_ns
            at = (end_ns - start_ns) * 1e-9
            pair = _values(begun, np.array([max(at - _STEP_S, 0.0), at]))
            state = (float(pair[1]), float(pair[1] - pair[0]) / _STEP_S)
        command[own] = _values(begun, (stamps_ns[own] - start_ns).astype(float) * 1e-9)
    return command, resolved


def _from(item: Trajectory, position: float, velocity: float) -> Trajectory:
    """Return a trajectory that begins at time 0, with a state of its own unless it has one."""
    if len(item.times) and item.times[0] <= 0.0:
        return item

    def row(first: float, rest: NDArray[np.float64]) -> NDArray[np.float64]:
        given = len(rest) == len(item.times) and len(rest)
        return np.concatenate([[first], rest]) if given else np.empty(0)

    if not len(item.times):
        return Trajectory(item.start_ns, np.zeros(1), np.array([position]), *[np.empty(0)] * 2)
    return Trajectory(
        item.start_ns,
        np.concatenate([[0.0], item.times]),
        np.concatenate([[position], item.positions]),
        row(velocity, item.velocities),
        row(0.0, item.accelerations),
    )


def _values(item: Trajectory, times: NDArray[np.float64]) -> NDArray[np.float64]:
    t, x = item.times, item.positions
    if len(t) < 2 or not len(item.velocities):
        return np.interp(times, t, x)
    i = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    h = t[i + 1] - t[i]
    s = np.clip((times - t[i]) / h, 0.0, 1.0)
    v_0, v_1 = item.velocities[i] * h, item.velocities[i + 1] * h
    d = x[i + 1] - x[i]
    if not len(item.accelerations):
        return x[i] + s * (v_0 + s * (3 * d - 2 * v_0 - v_1 + s * (v_0 + v_1 - 2 * d)))
    a_0, a_1 = item.accelerations[i] * h * h, item.accelerations[i + 1] * h * h
    c_3 = 10 * d - 6 * v_0 - 4 * v_1 - 1.5 * a_0 + 0.5 * a_1
    c_4 = -15 * d + 8 * v_0 + 7 * v_1 + 1.5 * a_0 - a_1
    c_5 = 6 * d - 3 * (v_0 + v_1) - 0.5 * (a_0 - a_1)
    return x[i] + s * (v_0 + s * (0.5 * a_0 + s * (c_3 + s * (c_4 + s * c_5))))
