# SPDX-License-Identifier: Apache-2.0
"""The foreign actuator: its plant and its sensors, with faults and hidden causes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.causes import CAUSE_BY_NAME, COPPER
from ema_core.faults import degrade
from ema_core.parameters import ActuatorParameters, constants
from ema_core.telemetry import Telemetry
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
"""Hidden causes that a foreign plant can have; its effects cover the rest of the registry."""


@dataclass(frozen=True)
class SensorSet:
    """Sensors of a plant."""

    current_filter: Filter
    cubic: float  # relative error of the current at 22.5 A; grows with the square [-]
    runout: float  # relative error of the speed once a turn [-]
    runout_phase: float  # phase of that error [turns]
    current_noise: float  # standard deviation of a sample of the current [A]
    resolutions: tuple[float, float, float]  # of current, position and speed [A, rad, rad/s]


@dataclass(frozen=True, eq=False)
class ForeignPlant:
    """A healthy foreign actuator; ``foreign.kernel.simulate`` describes the tables."""

    seed: int
    effects: tuple[str, ...]  # descriptions of the effects
    parameters: ActuatorParameters  # true values; the monitor knows the nominal ones only
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
    feedback_noise: float  # standard deviation of the position feedback [rad, user shaft]

    def telemetry(
        self,
        commands: ArrayLike,
        faults: ArrayLike,
        causes: Mapping[str, float],
        rng: np.random.Generator,
        sample_period: float = 1e-4,
    ) -> Telemetry:
        """Return the simulated telemetry of a command, from rest at the first command.

        The sensors add their errors. ``commands`` are in rad of the user shaft, ``sample_period``
        in s.

        Raises
        ------
        ValueError
            If a cause is unknown, or the period is not a whole multiple of the step.
        """
        if unknown := sorted(set(causes) - set(FOREIGN_CAUSES)):
            adjective = "" if unknown[0] in CAUSE_BY_NAME else "unknown "
            raise ValueError(f"the foreign plant cannot have the {adjective}cause {unknown[0]!r}")
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
        gain = 1.0 + sensors.cubic * (ideal.current / 22.5) ** 2
        bent = replace(ideal, current=gain * ideal.current, speed=ideal.speed * (1.0 + runout))
        seen = published(bent, causes)
        noise = sensors.current_noise * rng.standard_normal(len(ideal))
        columns = {"current": seen.current + noise, "position": seen.position, "speed": seen.speed}
        for name, resolution in zip(columns, sensors.resolutions, strict=True):
            columns[name] = resolution * np.round(columns[name] / resolution)
        return replace(seen, **columns)


def changed(parameters: ActuatorParameters, causes: Mapping[str, float]) -> ActuatorParameters:
    """Return the parameters of a plant as changed by hidden causes."""
    factors = {
        # The drive still computes with the nominal k_t.
        "k_e": 1.0 + causes.get("torque_constant", 0.0),
        "R_s": 1.0 + COPPER * causes.get("winding_temperature", 0.0),
        "V_max": 1.0 + causes.get("supply_voltage", 0.0),
        **dict.fromkeys(("C_m", "C_u"), 1.0 + causes.get("viscous_friction", 0.0)),
        **dict.fromkeys(("J_m", "J_u"), 1.0 + causes.get("inertia", 0.0)),
    }
    return parameters.replace(
        {name: factor * getattr(parameters, name) for name, factor in factors.items()}
    )


def published(telemetry: Telemetry, causes: Mapping[str, float]) -> Telemetry:
    """Return ideal telemetry with the gains, offsets and delays of hidden causes applied."""
    columns = {}
    for name in ("command", "current", "position", "speed"):
        values = getattr(telemetry, name)
        if delay := causes.get(f"{name}_delay", 0.0):
            values = _late(values, delay / telemetry.sample_period)
        gain, offset = (causes.get(f"{name}_{what}", 0.0) for what in ("gain", "offset"))
        columns[name] = (1.0 + gain) * values + offset
    return replace(telemetry, **columns)


def _late(values: NDArray[np.float64], samples: float) -> NDArray[np.float64]:
    """Return a column delayed by ``samples``; the first value fills the start."""
    at = np.arange(len(values), dtype=float)
    return np.interp(at - samples, at, values)
