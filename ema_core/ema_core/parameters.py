# SPDX-License-Identifier: Apache-2.0
"""Parameters of an actuator: definitions, validation and flat tuples for kernels.

The default values are from table 2 of the thesis (Politecnico di Torino, 2018). The gear ratio is
not printed there; it is chosen to reproduce the results of the thesis.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any, NamedTuple

from ema_core.quantity import Checked, quantity
from ema_core.wording import unknown_name

RPM = 2.0 * math.pi / 60.0


class ControlConstants(NamedTuple):
    """Constants of the position and speed loops, for kernels (equation M1).

    Symbols and units are as in `ActuatorParameters`.
    """

    G_prop: float
    GAP: float
    GAI: float
    GAD: float
    omega_max: float
    k_t: float
    I_max: float


class MotorConstants(NamedTuple):
    """Constants of motor and drive, for kernels (equations M2 to M6).

    ``N_a``, ``N_b``, ``N_c`` are the healthy fractions of the turns [-], ``zeta`` the static
    eccentricity [-] and ``phi`` its direction [rad]. The other symbols and units are as in
    `ActuatorParameters`.
    """

    V_max: float
    T_max: float
    k_e: float
    G_M: float
    R_s: float
    L_s: float
    P: float
    h_b: float
    N_a: float = 1.0
    N_b: float = 1.0
    N_c: float = 1.0
    zeta: float = 0.0
    phi: float = 0.0


class MechanicalConstants(NamedTuple):
    """Constants of the mechanics, referred to the motor shaft, for kernels (equations M7, M8).

    ``J`` is the inertia [kg.m^2], ``C`` the viscous damping [N.m.s/rad], ``f_s`` and ``f_d`` the
    static and dynamic friction [N.m], ``half_backlash`` half the play [rad], ``tau`` the gear ratio
    [-] and ``theta_stop`` the end stop [rad].
    """

    J: float
    C: float
    f_s: float
    f_d: float
    half_backlash: float
    tau: float
    theta_stop: float


@dataclass(frozen=True)
class ActuatorParameters(Checked):
    """Parameters of an actuator in SI units, referred to the motor shaft.

    Fields are named after their symbols; ``named`` is the name in messages and node parameters.
    """

    G_prop: float = quantity(1e5, "1/s", 0.0, 1e9, "position-error gain", named="position_gain")
    GAP: float = quantity(
        0.05, "N.m.s/rad", 0.0, 1e3, "speed loop, proportional gain", named="speed_p"
    )
    GAI: float = quantity(0.0, "N.m/rad", 0.0, 1e6, "speed loop, integral gain", named="speed_i")
    GAD: float = quantity(
        0.0, "N.m.s^2/rad", 0.0, 1.0, "speed loop, derivative gain", named="speed_d"
    )
    omega_max: float = quantity(
        8000 * RPM,
        "rad/s",
        1e-3,
        5e3,
        "limit of the speed reference",
        (50.0, 3e3),
        named="speed_reference_limit",
    )
    V_max: float = quantity(48.0, "V", 1e-3, 1e4, "supply voltage", named="supply_voltage")
    I_max: float = quantity(
        22.5, "A", 1e-3, 1e4, "limit of the current reference", named="current_limit"
    )
    T_max: float = quantity(
        1.689, "N.m", 1e-6, 1e5, "limit of the motor torque", named="torque_limit"
    )
    k_t: float = quantity(
        0.0752,
        "N.m/A",
        1e-6,
        10.0,
        "torque constant, phase to phase",
        (1e-3, 1.0),
        named="torque_constant",
    )
    k_e: float = quantity(
        0.0752,
        "V.s/rad",
        1e-6,
        10.0,
        "back-EMF constant, phase to phase",
        (1e-3, 1.0),
        named="back_emf_constant",
    )
    G_M: float = quantity(
        0.07322,
        "N.m/A",
        1e-6,
        1e3,
        "torque gain of the source monitor form",
        named="monitor_torque_gain",
    )
    R_s: float = quantity(
        2.13, "ohm", 1e-4, 1e3, "resistance, phase to phase", (0.01, 100.0), named="resistance"
    )
    L_s: float = quantity(
        7.2e-4, "H", 1e-6, 0.1, "inductance, phase to phase", (1e-5, 2e-2), named="inductance"
    )
    P: int = quantity(2, "-", 1, 50, "pole pairs", named="pole_pairs")
    h_b: float = quantity(
        0.5, "A", 1e-4, 1e3, "half-band of the current hysteresis", named="current_hysteresis"
    )
    J_m: float = quantity(
        1.3e-5, "kg.m^2", 1e-9, 0.1, "inertia of the motor", (1e-7, 1e-3), named="motor_inertia"
    )
    J_u: float = quantity(
        1.2e-5, "kg.m^2", 0.0, 0.1, "inertia of the user", (1e-7, 1e-3), named="user_inertia"
    )
    C_m: float = quantity(
        30e-6 / math.pi,
        "N.m.s/rad",
        0.0,
        1e2,
        "viscous damping, motor",
        named="motor_viscous_damping",
    )
    C_u: float = quantity(
        4.5e-7, "N.m.s/rad", 0.0, 1e2, "viscous damping, user", named="user_viscous_damping"
    )
    f_sm: float = quantity(
        0.06 * 1.689, "N.m", 0.0, 1e4, "static friction, motor", named="motor_static_friction"
    )
    f_su: float = quantity(
        0.04 * 1.689, "N.m", 0.0, 1e4, "static friction, user", named="user_static_friction"
    )
    f_ratio: float = quantity(
        0.5, "-", 0.0, 1.0, "dynamic over static friction", named="dynamic_friction_ratio"
    )
    BLK: float = quantity(
        5e-3, "rad", 0.0, 10.0, "backlash, full width at the fast shaft", named="backlash"
    )
    tau: float = quantity(
        1 / 500,
        "-",
        1e-6,
        1.0,
        "gear ratio, user over motor speed",
        (1e-4, 0.1),
        named="gear_ratio",
    )
    theta_stop: float = quantity(
        1.2, "rad", 1e-3, 1e6, "end stop of the user shaft, in either direction", named="end_stop"
    )
    omega_c: float = quantity(
        2000.0 * math.pi,
        "rad/s",
        1.0,
        1e6,
        "bandwidth of field-oriented current loops",
        (100.0, 5e4),
        named="current_bandwidth",
    )
    lead: float = quantity(
        0.0, "m", 0.0, 1.0, "travel of a linear actuator per turn of the user shaft, else 0"
    )

    @property
    def top_speed(self) -> float:
        """Highest motor speed that controller and supply allow [rad/s]."""
        return max(self.omega_max, self.V_max / self.k_e)

    def replace(self, values: Mapping[str, Any]) -> "ActuatorParameters":
        """Return the parameters with some values changed.

        Raises
        ------
        ValueError
            If a name is unknown or a value is out of range.
        """
        names = [item.name for item in fields(self)]
        for name in values:
            if name not in names:
                raise ValueError(unknown_name("actuator parameter", name, names))
        return dataclasses.replace(self, **values)

    def as_mapping(self) -> dict[str, float]:
        """Return names and values in the order of definition."""
        return dataclasses.asdict(self)


def unit_of(name: str) -> str:
    """Return the unit of an actuator parameter, or "" for an unknown name."""
    units = {item.name: item.metadata["unit"] for item in fields(ActuatorParameters)}
    return units.get(name, "")


NEUTRAL: Mapping[str, float] = MappingProxyType(
    {"tau": 1.0, "k_t": 1.0, "k_e": 1.0, "BLK": 0.0, "theta_stop": 1e6, "omega_max": 5e3}
)
"""Parameters for a machine without a description: they convert nothing and limit nothing."""


class FieldOrientedParameters(ActuatorParameters):
    """Parameters of a field-oriented drive, for functions that get no ``ActuatorDescription``."""


class PlantConstants(NamedTuple):
    """Constants of controller, motor and mechanics, for kernels."""

    control: ControlConstants
    motor: MotorConstants
    mechanics: MechanicalConstants


def constants(parameters: ActuatorParameters) -> PlantConstants:
    """Return the constants of a healthy plant, for kernels."""
    p = parameters
    f_s = p.f_sm + p.f_su
    return PlantConstants(
        ControlConstants(p.G_prop, p.GAP, p.GAI, p.GAD, p.omega_max, p.k_t, p.I_max),
        MotorConstants(p.V_max, p.T_max, p.k_e, p.G_M, p.R_s, p.L_s, float(p.P), p.h_b),
        MechanicalConstants(
            J=p.J_m + p.J_u,
            C=p.C_m + p.C_u,
            f_s=f_s,
            f_d=f_s * p.f_ratio,
            half_backlash=p.BLK / 2.0,
            tau=p.tau,
            theta_stop=p.theta_stop / p.tau,
        ),
    )
