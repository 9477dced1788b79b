"""Relations between the columns of telemetry in motion."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.parameters import ActuatorParameters

_STEP_S: Final = 0.01
_LEAST_POINTS: Final = 12
_FAST: Final = 0.4
_GAP: Final = 1.5
_FOLLOWS: Final = 0.85


@dataclass(frozen=True, eq=False)
class ThinnedMotion:
    """Columns thinned to steps of about 10 ms, within which nothing is missing.

    Attributes
    ----------
    command, position
        At the ends of the steps, ``(m, 2)`` [rad].
    angle
        What the motor turned within each step by the speed, on the user shaft, ``(m,)`` [rad];
        empty without speed.
    current
        Mean current of each step, ``(m,)`` [A]; None without current.
    seconds
        Length of each step, ``(m,)`` [s].
    joins
        Whether a step begins where the one before ends, ``(m,)``.
    tau
        Gear ratio of the description.
    """

    command: NDArray[np.float64]
    position: NDArray[np.float64]
    angle: NDArray[np.float64]
    current: NDArray[np.float64] | None
    seconds: NDArray[np.float64]
    joins: NDArray[np.bool_]
    tau: float

    @classmethod
    def of(
        cls, columns: dict[str, NDArray[np.float64]], stamps_ns: NDArray[np.int64], tau: float
    ) -> "ThinnedMotion | None":
        """Return the motion in columns in SI units; None where there are too few samples."""
        names = [name for name, values in columns.items() if len(values)]
        finite = np.all([np.isfinite(columns[name]) for name in names], axis=0)
        given = {name: columns[name][finite] for name in names}
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
        whole = np.abs(seconds / (stride * period) - 1.0) < _GAP / max(stride, 3)
        starts, ends, seconds = starts[whole], ends[whole], seconds[whole]
        if len(starts) < _LEAST_POINTS:
            return None

        def means(values: NDArray[np.float64]) -> NDArray[np.float64]:
            sums = np.concatenate([[0.0], np.cumsum(values)])
            return (sums[ends + 1] - sums[starts + 1]) / stride

        angle = np.empty(0)
        if "speed" in given:
            # Trapezoids: the speed is that at the end of each sample.
            speed = given["speed"]
            halves = np.concatenate([[speed[0]], (speed[1:] + speed[:-1]) / 2.0])
            angle = means(halves) * seconds * tau
        joins = np.concatenate([[False], starts[1:] == ends[:-1]])
        return cls(
            np.column_stack([given["command"][starts], given["command"][ends]]),
            np.column_stack([given["position"][starts], given["position"][ends]]),
            angle,
            means(given["current"]) if "current" in given else None,
            seconds,
            joins,
            tau,
        )

    @property
    def has_speed(self) -> bool:
        """Whether there is a speed."""
        return len(self.angle) > 0

    @property
    def turned(self) -> float:
        """What the user shaft turns in all by the speed [rad]."""
        return float(np.sum(np.abs(self.angle)))

    @property
    def fastest(self) -> float:
        """Largest speed of the user shaft by that of the motor [rad/s]; 0 without."""
        return float(np.max(np.abs(self.angle) / self.seconds)) if self.has_speed else 0.0

    def travel(self, name: str) -> float:
        """Return the range of the command or position [rad]."""
        return float(np.ptp(getattr(self, name)))

    @property
    def gain(self) -> float | None:
        """How far the position moves over how far the command moves; None without motion.

        Negative where they move in opposite directions; None where one does not follow the other.
        """
        command, position = self.command[:, 1], self.position[:, 1]
        if np.ptp(command) <= 0.0 or np.ptp(position) <= 0.0:
            return None
        # Steps of the position lag; ranges do not.
        size = float(np.ptp(position) / np.ptp(command))
        correlation = np.corrcoef(command, position)[0, 1]
        if abs(correlation) < _FOLLOWS:
            return None
        return size if correlation >= 0.0 else -size

    @property
    def speed_ratio(self) -> float | None:
        """Motion of the position over that of the motor by its speed; 1 if all is right.

        None without speed or fast motion. In fast motion the gear rests on one flank.
        """
        if not self.has_speed:
            return None
        size = np.abs(self.angle)
        fast = size > _FAST * np.max(size)
        # Both steps beside it are fast and go the same way: no flank changes within.
        inner = fast.copy()
        inner[1:] &= fast[:-1] & (np.sign(self.angle[1:]) == np.sign(self.angle[:-1]))
        chosen = inner if np.count_nonzero(inner) >= _LEAST_POINTS // 2 else fast
        if not np.any(chosen) or np.max(size) == 0.0:
            return None
        steps = self.position[:, 1] - self.position[:, 0]
        return float(np.median(steps[chosen] / self.angle[chosen]))

    def current_against_torque(self, p: ActuatorParameters) -> tuple[float, float] | None:
        """Return the current over what inertia and friction need, and their correlation.

        None without current or motion.
        """
        if self.current is None:
            return None
        steps = self.angle if self.has_speed else self.position[:, 1] - self.position[:, 0]
        omega = steps / self.seconds / self.tau
        acceleration = np.zeros(len(omega))
        middles = (self.seconds[1:] + self.seconds[:-1]) / 2.0
        # Of this step and the next: the current of this one is between both accelerations.
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
