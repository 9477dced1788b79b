"""The foreign actuator: its plant and its sensors, with faults and hidden causes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.causes import CAUSE_BY_NAME
from ema_core.faults import degrade
from ema_core.parameters import ActuatorParameters, constants
from ema_core.telemetry import Telemetry
from foreign.causes import changed, published
from foreign.kernel import MECHANIC_STEP, Filter, Friction, Inverter, Iron, Load, simulate

POINTS: Final = 2048
"""Points of a table over a turn or a period."""

OPEN_RESISTANCE: Final = 1e5
"""Resistance in series with an open phase [ohm]."""

FOREIGN_CAUSES: Final = (
    *("load_torque", "load_stiffness", "torque_constant", "winding_temperature"),
    *("supply_voltage", "viscous_friction", "inertia"),
    *("current_offset", "current_gain", "speed_offset", "speed_gain"),
    *("position_offset", "position_gain", "current_delay", "speed_delay", "command_delay"),
    *("open_phase_a", "open_phase_b", "open_phase_c", "dead_switch", "jam"),
)
"""Hidden causes that a foreign plant can have; others of the registry are effects of its own."""


@dataclass(frozen=True)
class SensorSet:
    """Sensors of a plant.

    Attributes
    ----------
    current_filter
        Poles of the current sensor.
    cubic
        Relative error of the current at 22.5 A, with the cube of the current [-].
    runout, runout_phase
        Relative error of the speed once a turn [-], and where [turns].
    current_noise
        Standard deviation of the noise on a sample of the current [A].
    resolutions
        Resolution of current, position and speed [A, rad, rad/s].
    """

    current_filter: Filter
    cubic: float
    runout: float
    runout_phase: float
    current_noise: float
    resolutions: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class ForeignPlant:
    """One foreign actuator, healthy.

    Attributes
    ----------
    seed, effects
        How it was drawn, and the effects that it has, in words.
    parameters
        What it really is; the monitor knows the nominal parameters only.
    inverter, iron, friction, sensors
        Figures of its parts.
    emf, cogging, friction_by_turn, friction_slope, supply, supply_hz
        As of ``foreign.kernel.simulate``.
    feedback_noise
        Standard deviation of the noise on the position that the loops see [rad, user shaft].
    """

    seed: int
    effects: tuple[str, ...]
    parameters: ActuatorParameters
    inverter: Inverter
    iron: Iron
    friction: Friction
    sensors: SensorSet
    emf: NDArray[np.float64]
    cogging: NDArray[np.float64]
    friction_by_turn: NDArray[np.float64]
    friction_slope: float
    supply: NDArray[np.float64]
    supply_hz: float
    feedback_noise: float

    def telemetry(
        self,
        commands: ArrayLike,
        faults: ArrayLike,
        causes: Mapping[str, float],
        rng: np.random.Generator,
        sample_period: float = 1e-4,
    ) -> Telemetry:
        """Simulate from rest at the first command, and return what the sensors say.

        Raises
        ------
        ValueError
            When a cause is unknown, or the period is not a whole multiple of the step.
        """
        if unknown := sorted(set(causes) - set(FOREIGN_CAUSES)):
            known = "" if unknown[0] in CAUSE_BY_NAME else "unknown "
            raise ValueError(f"the foreign plant cannot have the {known}cause {unknown[0]!r}")
        steps = round(sample_period / MECHANIC_STEP)
        if steps < 1 or abs(steps * MECHANIC_STEP - sample_period) > 1e-9 * sample_period:
            raise ValueError(
                f"sample_period = {sample_period!r} s is not a whole multiple of "
                f"{MECHANIC_STEP:g} s"
            )
        command = np.array(commands, dtype=float)
        n = command.size
        columns = {name: np.empty(n) for name in ("current", "position", "speed")}
        ticks = n * steps // self.inverter.period + 1
        simulate(
            *degrade(constants(changed(self.parameters, causes)), faults),
            self._inverter(causes),
            self.iron,
            self.friction,
            Load(float(causes.get("load_stiffness", 0.0)), float(causes.get("jam", 0.0))),
            self.sensors.current_filter,
            self.emf,
            self.cogging,
            self.friction_by_turn,
            self.friction_slope,
            self.supply,
            self.supply_hz,
            float(rng.random()),
            float(command[0]),
            command,
            np.full(n, causes.get("load_torque", 0.0)),
            self.feedback_noise * rng.standard_normal(ticks),
            steps,
            *columns.values(),
        )
        ideal = Telemetry(round(1e9 * sample_period), sample_period, 1, command, **columns)
        return self._measured(ideal, causes, rng)

    def _inverter(self, causes: Mapping[str, float]) -> Inverter:
        return self.inverter._replace(
            **{
                f"open_{phase}": OPEN_RESISTANCE * float(causes.get(f"open_phase_{phase}", 0.0))
                for phase in "abc"
            },
            dead_switch=float(causes.get("dead_switch", 0.0)),
        )

    def _measured(
        self, ideal: Telemetry, causes: Mapping[str, float], rng: np.random.Generator
    ) -> Telemetry:
        sensors = self.sensors
        turn = ideal.position / self.parameters.tau / (2.0 * np.pi)
        runout = sensors.runout * np.cos(2.0 * np.pi * (turn + sensors.runout_phase))
        bent = 1.0 + sensors.cubic * (ideal.current / 22.5) ** 2
        columns: dict[str, Any] = {
            "current": ideal.current * bent,
            "position": ideal.position,
            "speed": ideal.speed * (1.0 + runout),
        }
        seen = published(replace(ideal, **columns), causes)
        columns = {name: getattr(seen, name) for name in columns}
        columns["current"] = columns["current"] + sensors.current_noise * rng.standard_normal(
            len(ideal)
        )
        names = ("current", "position", "speed")
        for name, resolution in zip(names, sensors.resolutions, strict=True):
            columns[name] = resolution * np.round(columns[name] / resolution)
        return replace(seen, **columns)
