"""Demands of a test on an actuator, and their limits."""

from dataclasses import asdict, dataclass
from typing import Final, Self

from ema_core.parameters import ActuatorParameters
from ema_monitor.windows.window import MIN_TRAVEL

SHORTEST_S: Final = 0.05
"""Shortest test [s]."""

SMALLEST_TRAVEL: Final = 1.5 * MIN_TRAVEL
"""Smallest travel of a test, somewhat more than a window needs [rad]."""

UNITS: Final = {"travel": "rad", "current": "A", "torque": "N.m", "speed": "rad/s", "longest": "s"}
"""Unit of each limit."""

_SHARE: Final = 0.9


@dataclass(frozen=True)
class Demands:
    """What a test demands at most; current and torque without the ripple of the inverter.

    Attributes
    ----------
    travel
        Of the command, from one end to the other [rad].
    current
        Equivalent current, magnitude [A].
    torque
        Of the motor, magnitude [N.m].
    speed
        Of the motor shaft, magnitude [rad/s].
    longest
        Duration of the command [s].
    """

    travel: float
    current: float
    torque: float
    speed: float
    longest: float

    def shares(self, of: "Demands") -> dict[str, float]:
        """Return which share of others each is, by name."""
        return {name: value / getattr(of, name) for name, value in asdict(self).items()}


@dataclass(frozen=True)
class MotionLimits(Demands):
    """What a test may demand at most.

    Raises
    ------
    ValueError
        When a limit is not above 0, or travel or duration are too small for any test.
    """

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0.0 < value < float("inf"):
                raise ValueError(f"{name} = {value:g} {UNITS[name]}: expected above 0")
        if self.travel < SMALLEST_TRAVEL:
            raise ValueError(
                f"travel = {self.travel:g} rad: a test travels at least {SMALLEST_TRAVEL:g} rad"
            )
        if self.longest < SHORTEST_S:
            raise ValueError(
                f"longest = {self.longest:g} s: a test takes at least {SHORTEST_S:g} s"
            )

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
        """Return limits, where none is given nine tenths of the actuator's own.

        Raises
        ------
        ValueError
            When a limit is impossible, or beyond the actuator's capability.
        """
        own = {
            "travel": parameters.theta_stop,
            "current": parameters.I_max,
            "torque": parameters.T_max,
            "speed": parameters.omega_max,
        }
        given = {"travel": travel, "current": current, "torque": torque, "speed": speed}
        chosen = {}
        for name, value in given.items():
            if value is not None and value > own[name]:
                raise ValueError(
                    f"{name} = {value:g} {UNITS[name]} is beyond the actuator's own limit "
                    f"{own[name]:g} {UNITS[name]}"
                )
            chosen[name] = _SHARE * own[name] if value is None else value
        return cls(**chosen, longest=longest)
