# SPDX-License-Identifier: Apache-2.0
"""Demands of a test on an actuator, and their limits."""

from dataclasses import asdict, dataclass
from typing import Final, Self

from ema_core.parameters import ActuatorParameters
from ema_monitor.windows.window import MIN_TRAVEL

SHORTEST_S: Final = 0.05
"""Shortest test [s]."""

SMALLEST_TRAVEL: Final = 1.5 * MIN_TRAVEL
"""Smallest travel of a test [rad], above the least travel of a window."""

UNITS: Final = {"travel": "rad", "current": "A", "torque": "N.m", "speed": "rad/s", "longest": "s"}
"""Unit of each limit."""

_SHARE: Final = 0.9


@dataclass(frozen=True)
class Demands:
    """Largest demands of a test; current and torque exclude the inverter ripple."""

    travel: float
    """Travel of the command, from end to end [rad]."""
    current: float
    """Magnitude of the equivalent current [A]."""
    torque: float
    """Magnitude of the motor torque [N.m]."""
    speed: float
    """Magnitude of the motor speed [rad/s]."""
    longest: float
    """Duration of the command [s]."""

    def shares(self, limits: "Demands") -> dict[str, float]:
        """Return the ratio of each demand to its limit, by name [-]."""
        return {name: value / getattr(limits, name) for name, value in asdict(self).items()}


@dataclass(frozen=True)
class MotionLimits(Demands):
    """Limits of the demands of a test.

    Raises
    ------
    ValueError
        If a limit is not above 0, or travel or duration is too small for a test.
    """

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0.0 < value < float("inf"):
                raise ValueError(f"{name} = {value:g} {UNITS[name]}: expected above 0")
        if self.travel < SMALLEST_TRAVEL:
            raise ValueError(
                f"travel = {self.travel:g} rad: expected at least {SMALLEST_TRAVEL:g} rad"
            )
        if self.longest < SHORTEST_S:
            raise ValueError(f"longest = {self.longest:g} s: expected at least {SHORTEST_S:g} s")

    @classmethod
    def within(
        cls,
        parameters: ActuatorParameters,
        *,
        travel: float,
        current: float | None = None,
        torque: float | None = None,
        speed: float | None = None,
        longest: float = 0.5,
    ) -> Self:
        """Return the limits of a test; for None, the limit is 90 % of the actuator's limit.

        Raises
        ------
        ValueError
            If a limit is out of range, or above the limit of the actuator.
        """
        capability = {
            "travel": parameters.theta_stop,
            "current": parameters.I_max,
            "torque": parameters.T_max,
            "speed": parameters.omega_max,
        }
        requested = {"travel": travel, "current": current, "torque": torque, "speed": speed}
        chosen = {}
        for name, value in requested.items():
            if value is not None and value > capability[name]:
                raise ValueError(
                    f"{name} = {value:g} {UNITS[name]} exceeds the limit of the actuator, "
                    f"{capability[name]:g} {UNITS[name]}"
                )
            chosen[name] = _SHARE * capability[name] if value is None else value
        return cls(**chosen, longest=longest)
