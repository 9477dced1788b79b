# SPDX-License-Identifier: Apache-2.0
"""Simulated robot joint: motor and load inertia, coupled by an elastic gear.

All values refer to the output: rad, N.m and kg.m2, or m, N and kg.
"""

from dataclasses import dataclass
from math import exp, pi, sin
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core._jit import kernel

Vector = NDArray[np.float64]

STEP_S: Final = 1e-4
"""Step of the simulation [s]."""
CONTROL_STEPS: Final = 10
CONTROL_S: Final = STEP_S * CONTROL_STEPS
"""Period of the controllers [s]."""

_DAMPING: Final = 0.08  # damping ratio of the resonance
_KINDS: Final = ("position", "pd", "velocity", "torque")


@dataclass(frozen=True, kw_only=True)
class SimulatedJoint:
    """Type of joint with its controller and sensors; values refer to the output, in SI units."""

    control: Literal["position", "pd", "velocity", "torque"]
    speed: float
    """Largest speed of the motion."""
    motor_inertia: float
    load_inertia: float
    resonance_hz: float
    """Resonance frequency of motor and load inertia on the elastic gear."""
    motor_friction: float
    """Coulomb friction at the motor."""
    load_friction: float = 0.0
    viscous: float = 0.0
    grease: float = 1.0
    """Exponent of viscous friction; below 1 if the grease thins with speed."""
    stribeck: float = 0.0
    """Ratio of static to Coulomb friction, minus 1 [-]."""
    stribeck_speed: float = 0.01
    load_dependence: float = 0.0
    """Friction per transmitted load [-]; above 1, the gear is self-locking."""
    asymmetry: float = 0.0
    gravity: float = 0.0
    """Gravity torque in the horizontal position."""
    constant_load: float = 0.0
    play: float = 0.0
    cogging: float = 0.0
    cogging_periods: float = 0.0
    """Cogging periods per rad or m of the output."""
    warming: float = 6.0
    """Temperature rise in operation [K]."""
    viscous_per_kelvin: float = -0.03
    dry_per_kelvin: float = 0.001
    dry_of_days: float = 0.015
    """Relative standard deviation of dry friction between days at the same temperature [-]."""
    bandwidth: float = 150.0
    """Bandwidth of the speed loop, or of the position loop of a PD controller [rad/s]."""
    feedforward: bool = False
    effort_noise: float = 0.01
    """Standard deviation of effort noise relative to Coulomb friction [-]."""
    position_step: float = 1e-6
    sensor: Literal["motor", "output"] = "motor"

    @property
    def coulomb(self) -> float:
        """Total Coulomb friction of motor and load."""
        return float(self.motor_friction + self.load_friction)


class Plant(NamedTuple):
    """Simulation constants; values refer to the output."""

    motor_inertia: float
    load_inertia: float
    stiffness: float
    damping: float
    play: float
    motor_friction: float
    load_friction: float
    viscous: float
    grease: float
    scale_speed: float  # speed at which the grease exponent has no effect
    stribeck: float
    stribeck_speed: float
    load_dependence: float
    asymmetry: float
    gravity: float
    load: float
    cogging: float
    cogging_periods: float
    torque: float  # ratio of actual to assumed effort


class Controller(NamedTuple):
    """Controller gains; ``kind`` is an index into ``_KINDS``."""

    kind: int
    position: float
    speed: float
    integral: float
    inertia: float
    gravity: float
    limit: float
    position_step: float
    at_output: float  # 1 if the position loop uses the output encoder


@kernel()
def simulate_joint(
    reference: Vector, conditions: Vector, plant: Plant, drive: Controller, state: Vector
) -> Vector:
    """Simulate a joint over ``n`` control periods.

    Returns output position, motor position, motor speed and effort at the end of each period,
    ``(n, 4)``.

    Parameters
    ----------
    reference
        Planned position, speed and acceleration, ``(n, 3)``.
    conditions
        Factors of dry and viscous friction, additional load, and additional load
        inertia, ``(n, 4)``; see ``constant_conditions``.
    plant, drive
        The joint and its controller.
    state
        State at the start, overwritten with the state at the end; see ``rest`` and ``held``.
    """
    recorded = np.empty((len(reference), 4))
    position, motor, v_load, v_motor, integral, effort = state
    h, half = STEP_S, 0.5 * plant.play
    for k in range(len(reference)):
        wanted, v_wanted, a_wanted = reference[k]
        dry, thick, load, added_inertia = conditions[k]
        load_inertia = plant.load_inertia + added_inertia
        seen = position if drive.at_output > 0.0 else motor
        if drive.position_step > 0.0:
            seen = drive.position_step * np.round(seen / drive.position_step)
        if drive.kind == 1:
            effort = drive.position * (wanted - seen) + drive.speed * (v_wanted - v_motor)
            effort += drive.inertia * a_wanted
        elif drive.kind == 3:
            a = drive.position * (wanted - seen) + drive.speed * (v_wanted - v_motor)
            effort = drive.inertia * (a_wanted + a) + drive.gravity * sin(seen)
        else:
            error = v_wanted + drive.position * (wanted - seen) - v_motor
            bound = 0.6 * drive.limit
            integral = min(max(integral + drive.integral * CONTROL_S * error, -bound), bound)
            effort = drive.speed * error + integral + drive.inertia * a_wanted
        effort = min(max(effort, -drive.limit), drive.limit)
        for _ in range(CONTROL_STEPS):
            twist = motor - position
            gap = min(max(twist, -half), half)
            transmitted = 0.0
            if twist != gap or half == 0.0:
                transmitted = plant.stiffness * (twist - gap) + plant.damping * (v_motor - v_load)
            drop = 1.0
            if plant.stribeck > 0.0:
                drop += plant.stribeck * exp(-((v_motor / plant.stribeck_speed) ** 2))
            push = plant.torque * effort - transmitted
            if plant.cogging > 0.0:
                push += plant.cogging * sin(2.0 * pi * plant.cogging_periods * motor)
            thickness = plant.viscous * thick
            if plant.grease != 1.0:
                thickness *= (abs(v_motor) / plant.scale_speed + 1e-3) ** (plant.grease - 1.0)
            push -= thickness * v_motor
            rub = plant.motor_friction * drop + plant.load_dependence * abs(transmitted)
            free = v_motor + h * push / plant.motor_inertia
            rub *= dry * (1.0 + np.sign(free) * plant.asymmetry)
            lost = h * rub / plant.motor_inertia
            v_motor = np.sign(free) * max(abs(free) - lost, 0.0)
            pull = transmitted
            if plant.gravity > 0.0:
                pull -= plant.gravity * sin(position)
            pull -= plant.load + load
            free = v_load + h * pull / load_inertia
            lost = h * dry * plant.load_friction * drop / load_inertia
            v_load = np.sign(free) * max(abs(free) - lost, 0.0)
            motor += h * v_motor
            position += h * v_load
        recorded[k] = position, motor, v_motor, effort
    state[:] = position, motor, v_load, v_motor, integral, effort
    return recorded


def constant_conditions(n: int, dry: float = 1.0, thick: float = 1.0) -> Vector:
    """Return conditions for ``simulate_joint``, ``(n, 4)``, without additional load or inertia.

    ``dry`` and ``thick`` are the factors of dry and viscous friction [-].
    """
    return np.tile([dry, thick, 0.0, 0.0], (n, 1))


def rest(position: float) -> Vector:
    """Return the state of an unloaded joint at rest at ``position``, for `simulate_joint`."""
    return np.array([position, position, 0.0, 0.0, 0.0, 0.0])


def held(position: float, load: float, plant: Plant) -> Vector:
    """Return the state of a joint at rest, with the motor at ``position`` and a constant load."""
    twist = load / plant.stiffness + 0.5 * plant.play * np.sign(load)
    return np.array([position - twist, position, 0.0, 0.0, load, load])


def plant_of(joint: SimulatedJoint, payload: float = 1.0) -> Plant:
    """Return the plant of a joint; ``payload`` scales load inertia, gravity and constant load."""
    reduced = joint.motor_inertia * joint.load_inertia / (joint.motor_inertia + joint.load_inertia)
    omega = 2.0 * pi * joint.resonance_hz
    return Plant(
        motor_inertia=float(joint.motor_inertia),
        load_inertia=payload * joint.load_inertia,
        stiffness=reduced * omega**2,
        damping=2.0 * _DAMPING * reduced * omega,
        play=float(joint.play),
        motor_friction=float(joint.motor_friction),
        load_friction=float(joint.load_friction),
        viscous=float(joint.viscous),
        grease=float(joint.grease),
        scale_speed=0.5 * joint.speed,
        stribeck=float(joint.stribeck),
        stribeck_speed=joint.stribeck_speed,
        load_dependence=float(joint.load_dependence),
        asymmetry=joint.asymmetry,
        gravity=payload * joint.gravity,
        load=payload * joint.constant_load,
        cogging=float(joint.cogging),
        cogging_periods=float(joint.cogging_periods),
        torque=1.0,
    )


def controller_of(joint: SimulatedJoint) -> Controller:
    """Return the controller of a joint, designed for its nominal parameters."""
    inertia, omega = float(joint.motor_inertia + joint.load_inertia), float(joint.bandwidth)
    largest = joint.coulomb + joint.gravity + joint.constant_load + joint.viscous * joint.speed
    drive = Controller(
        kind=_KINDS.index(joint.control),
        position=omega / 5.0,
        speed=inertia * omega,
        integral=inertia * omega**2 / 8.0,
        inertia=inertia if joint.feedforward else 0.0,
        gravity=0.0,
        limit=4.0 * (largest * (1.0 + joint.load_dependence) + inertia * joint.speed * 10.0),
        position_step=0.0,
        at_output=float(joint.sensor == "output"),
    )
    match joint.control:
        case "pd":  # uses the logged encoder; the other controllers use a finer encoder
            gains = {"position": inertia * omega**2, "speed": 1.4 * inertia * omega}
            return drive._replace(**gains, position_step=float(joint.position_step))
        case "torque":
            gains = {"position": omega**2, "speed": 2.0 * omega}
            return drive._replace(**gains, inertia=inertia, gravity=float(joint.gravity))
        case "velocity":  # velocity commands come from a slow position loop
            return drive._replace(position=1.0, inertia=0.0)
        case _:
            return drive
