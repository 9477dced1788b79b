# SPDX-License-Identifier: Apache-2.0
"""Relations between the columns of telemetry in motion."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.parameters import ActuatorParameters

_STEP_S: Final = 0.01
_LEAST_POINTS: Final = 12
_FAST: Final = 0.4
_GAP: Final = 1.5
_FOLLOWS: Final = 0.85
_REVERSAL: Final = 0.05
_SHORT: Final = 0.2
_MOVING: Final = 0.1
_SURE_STROKES: Final = 3
_SURE_S: Final = 5.0


@dataclass(frozen=True, eq=False)
class ThinnedMotion:
    """Columns downsampled to steps of about 10 ms, without steps that contain gaps."""

    command: NDArray[np.float64]
    """Command at the start and end of each step, ``(m, 2)`` [rad]; ``(0, 2)`` if not measured."""

    position: NDArray[np.float64]
    """Position at the start and end of each step, ``(m, 2)`` [rad]."""

    angle: NDArray[np.float64]
    """User-shaft rotation per step, from the speed, ``(m,)`` [rad]; empty if not measured."""

    current: NDArray[np.float64] | None
    """Mean current per step, ``(m,)`` [A]; None if not measured."""

    seconds: NDArray[np.float64]
    """Duration of each step, ``(m,)`` [s]."""

    joins: NDArray[np.bool_]
    """Whether each step starts where the previous one ended, ``(m,)``."""

    tau: float
    """Gear ratio from the actuator description [-]."""

    @classmethod
    def of(
        cls, columns: dict[str, NDArray[np.float64]], stamps_ns: NDArray[np.int64], tau: float
    ) -> "ThinnedMotion | None":
        """Downsample columns in SI units; return None if there are too few samples."""
        names = [name for name, values in columns.items() if len(values)]
        finite = np.all([np.isfinite(columns[name]) for name in names], axis=0)
        present = {name: columns[name][finite] for name in names}
        times = (stamps_ns[finite] - stamps_ns[0]).astype(float) * 1e-9
        if len(times) < _LEAST_POINTS:
            return None
        period = float(np.median(np.diff(times)))
        if period <= 0.0:
            return None
        stride = max(1, round(_STEP_S / period))
        starts = np.arange(0, len(times) - stride, stride)
        ends = starts + stride
        seconds = times[ends] - times[starts]
        has_no_gap = np.abs(seconds / (stride * period) - 1.0) < _GAP / max(stride, 3)
        starts, ends, seconds = starts[has_no_gap], ends[has_no_gap], seconds[has_no_gap]
        if len(starts) < _LEAST_POINTS:
            return None

        def means(values: NDArray[np.float64]) -> NDArray[np.float64]:
            sums = np.concatenate([[0.0], np.cumsum(values)])
            return (sums[ends + 1] - sums[starts + 1]) / stride

        angle = np.empty(0)
        if "speed" in present:
            # Trapezoidal rule: each speed is the speed at the end of its sample.
            speed = present["speed"]
            halves = np.concatenate([[speed[0]], (speed[1:] + speed[:-1]) / 2.0])
            angle = means(halves) * seconds * tau
        joins = np.concatenate([[False], starts[1:] == ends[:-1]])
        return cls(
            np.column_stack([present["command"][starts], present["command"][ends]])
            if "command" in present
            else np.empty((0, 2)),
            np.column_stack([present["position"][starts], present["position"][ends]]),
            angle,
            means(present["current"]) if "current" in present else None,
            seconds,
            joins,
            tau,
        )

    @property
    def has_speed(self) -> bool:
        """Whether the speed is measured."""
        return len(self.angle) > 0

    @property
    def turned(self) -> float:
        """Total rotation of the user shaft, integrated from the speed [rad]; 0 without a speed."""
        return float(np.sum(np.abs(self.angle)))

    @property
    def fastest(self) -> float:
        """Largest user-shaft speed [rad/s]; 0 if the speed is not measured."""
        return float(np.max(np.abs(self.angle) / self.seconds)) if self.has_speed else 0.0

    def travel(self, name: str) -> float:
        """Return the range of the command or position [rad]; 0 if not measured."""
        values = getattr(self, name)
        return float(np.ptp(values)) if len(values) else 0.0

    @property
    def gain(self) -> float | None:
        """Ratio of the range of the position to the range of the command [-].

        Negative if they move in opposite directions; None if there is no motion or the position
        does not follow the command.
        """
        command, position = self.command[:, 1], self.position[:, 1]
        if not len(command) or np.ptp(command) <= 0.0 or np.ptp(position) <= 0.0:
            return None
        # Ranges, unlike steps, are insensitive to lag.
        size = float(np.ptp(position) / np.ptp(command))
        correlation = np.corrcoef(command, position)[0, 1]
        if abs(correlation) < _FOLLOWS:
            return None
        return size if correlation >= 0.0 else -size

    @property
    def speed_ratio(self) -> float | None:
        """Median ratio of position change to user-shaft rotation from the speed, ideally 1 [-].

        Only fast motion is used, during which the gear stays on one flank. None if the speed is not
        measured or there is no fast motion.
        """
        if not self.has_speed:
            return None
        size = np.abs(self.angle)
        fast = size > _FAST * np.max(size)
        # Two adjacent fast steps in the same direction contain no reversal.
        inner = fast.copy()
        inner[1:] &= fast[:-1] & (np.sign(self.angle[1:]) == np.sign(self.angle[:-1]))
        chosen = inner if np.count_nonzero(inner) >= _LEAST_POINTS // 2 else fast
        if not np.any(chosen) or np.max(size) == 0.0:
            return None
        steps = self.position[:, 1] - self.position[:, 0]
        return float(np.median(steps[chosen] / self.angle[chosen]))

    @cached_property
    def strokes(self) -> NDArray[np.float64]:
        """Travel of each stroke from the position and from the speed, ``(k, 2)`` [rad].

        A stroke is the motion between two reversals of the position. Reversals smaller than 5 % of
        the range and strokes shorter than 20 % of the longest are ignored. Without a speed, the
        second column is 0. Whole strokes are nearly insensitive to lag, elasticity and backlash.
        """
        ends = reversals(self.position[:, 1])
        steps = self.position[:, 1] - self.position[:, 0]
        by_speed = self.angle if self.has_speed else np.zeros(len(steps))
        sums = np.array([np.cumsum(steps), np.cumsum(by_speed)])
        travels = np.diff(sums[:, ends], axis=1).T
        size = np.abs(travels[:, 0])
        return travels[size > _SHORT * np.max(size, initial=0.0)]

    @cached_property
    def stroke_ratio(self) -> float | None:
        """Median ratio of the travel from the position to the travel from the speed, ideally 1 [-].

        None if the speed is not measured or there are no strokes.
        """
        strokes = self.strokes
        moved = strokes[np.abs(strokes[:, 1]) > 0.0]
        return float(np.median(moved[:, 0] / moved[:, 1])) if len(moved) else None

    @property
    def is_ample(self) -> bool:
        """Whether there is enough motion to judge a unit or sign: 3 strokes or 5 s."""
        return len(self.strokes) >= _SURE_STROKES or float(np.sum(self.seconds)) >= _SURE_S

    @property
    def dissipation(self) -> float | None:
        """Correlation of current and speed after removing inertia, gravity and constant load [-].

        Because friction dissipates energy, it is positive if the sign of the current is right. None
        if the current is not measured, if there is no fast motion in both directions, or if
        inertia, gravity and constant load explain the current or the speed completely.
        """
        if self.current is None:
            return None
        speed = (self.position[:, 1] - self.position[:, 0]) / self.seconds
        fast = np.abs(speed) > _MOVING * np.max(np.abs(speed), initial=0.0)
        chosen = fast & self.joins & np.roll(self.joins, -1)
        chosen[[0, -1]] = False
        if min(np.count_nonzero(speed[chosen] > 0), np.count_nonzero(speed[chosen] < 0)) < (
            _LEAST_POINTS
        ):
            return None
        acceleration = np.gradient(speed)[chosen]
        angle = self.position[chosen, 0]
        terms = [np.ones(len(angle)), angle, np.sin(angle), np.cos(angle), acceleration]
        matrix = np.column_stack([term / max(np.max(np.abs(term)), 1e-300) for term in terms])
        targets = np.column_stack([speed[chosen], self.current[chosen]])
        residuals = targets - matrix @ np.linalg.lstsq(matrix, targets, rcond=None)[0]
        sizes = np.sqrt(np.sum(residuals**2, axis=0))
        if np.any(sizes <= 1e-9 * np.sqrt(np.sum(targets**2, axis=0))):
            return None
        return float(residuals[:, 0] @ residuals[:, 1] / np.prod(sizes))

    @property
    def work_share(self) -> float:
        """Net work of the effort relative to its absolute work, -1 to 1 [-]; 0 without a current.

        Over a cycle, only friction consumes energy. A negative value would mean that the motion
        supplies energy to the motor, so the sign of the effort is probably wrong. A constant load
        is subtracted.
        """
        if self.current is None:
            return 0.0
        steps = self.position[:, 1] - self.position[:, 0]
        work = (self.current - np.median(self.current)) * steps
        size = float(np.sum(np.abs(work)))
        return float(np.sum(work)) / size if size > 0.0 else 0.0

    def current_against_torque(self, p: ActuatorParameters) -> tuple[float, float] | None:
        """Compare the measured current with the current that inertia and friction require.

        Return the ratio of their RMS values and their correlation [-]; None if the current is not
        measured or constant, or if there is too little motion.
        """
        if self.current is None:
            return None
        steps = self.angle if self.has_speed else self.position[:, 1] - self.position[:, 0]
        omega = steps / self.seconds / self.tau
        acceleration = np.zeros(len(omega))
        middles = (self.seconds[1:] + self.seconds[:-1]) / 2.0
        # Average the speed changes at both ends of a step, as its current lies between them.
        change = np.diff(omega) / middles
        change[~self.joins[1:]] = 0.0
        acceleration[:-1] += change / 2.0
        acceleration[1:] += change / 2.0
        fastest = np.max(np.abs(omega), initial=0.0)
        if fastest <= 0.0:
            return None
        friction = (p.f_sm + p.f_su) * p.f_ratio * np.tanh(omega / (0.05 * fastest))
        damping = (p.C_m + p.C_u) * omega
        expected = ((p.J_m + p.J_u) * acceleration + friction + damping) / p.k_t
        moving = np.abs(omega) > 0.1 * fastest
        if np.count_nonzero(moving) < _LEAST_POINTS or np.std(self.current[moving]) == 0.0:
            return None
        correlation = np.corrcoef(expected[moving], self.current[moving])[0, 1]
        size = np.sqrt(np.mean(self.current[moving] ** 2) / np.mean(expected[moving] ** 2))
        return float(size), float(correlation)


def reversals(position: NDArray[np.float64]) -> list[int]:
    """Return the indices of the first sample, all reversals and the last sample.

    Reversals smaller than 5 % of the range are ignored. Return an empty list without motion.
    """
    least = _REVERSAL * float(np.ptp(position))
    if least <= 0.0:
        return []
    ends, extreme, direction = [0], 0, 0
    values = position.tolist()
    for number, value in enumerate(values):
        gain = value - values[extreme]
        if direction * gain > 0.0:
            extreme = number
        elif abs(gain) > least:
            if direction:
                ends.append(extreme)
            direction, extreme = (1 if gain > 0.0 else -1), number
    return [*ends, len(values) - 1]
