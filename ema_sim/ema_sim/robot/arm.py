# SPDX-License-Identifier: Apache-2.0
"""Simulated six-joint arm: joints, gravity loads, and the inertia of a part in the hand."""

from dataclasses import replace
from math import pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_sim.robot.joint import SimulatedJoint

Vector = NDArray[np.float64]

# Harmonic drives: friction increases with load, and torque ripple has two periods per motor turn.
_ARM: Final = {
    "base": SimulatedJoint(
        control="position", speed=1.6, bandwidth=45.0, feedforward=True,
        motor_inertia=1.3, load_inertia=2.2, resonance_hz=21.0,
        motor_friction=7.0, load_friction=2.0, viscous=6.0, grease=0.8,
        stribeck=0.25, stribeck_speed=0.06, load_dependence=0.05,
        effort_noise=0.02, position_step=4.7e-7, dry_of_days=0.01,
    ),
    # Joint with the softest gear.
    "shoulder": SimulatedJoint(
        control="position", speed=1.2, bandwidth=35.0, feedforward=True,
        motor_inertia=1.5, load_inertia=2.8, resonance_hz=16.0,
        motor_friction=8.0, load_friction=2.0, viscous=8.0,
        load_dependence=0.08, gravity=110.0,
        effort_noise=0.02, position_step=4.7e-7, warming=9.0, dry_of_days=0.01,
    ),
    "elbow": SimulatedJoint(
        control="position", speed=1.4, bandwidth=45.0, feedforward=True,
        motor_inertia=0.8, load_inertia=0.9, resonance_hz=22.0,
        motor_friction=5.0, load_friction=1.5, viscous=4.5,
        stribeck=0.2, stribeck_speed=0.06, load_dependence=0.08, gravity=55.0,
        cogging=0.25, cogging_periods=2.0 * 101.0 / (2.0 * pi),
        effort_noise=0.02, position_step=4.7e-7, warming=8.0, dry_of_days=0.01,
    ),
    "wrist_1": SimulatedJoint(
        control="position", speed=2.0, bandwidth=70.0, feedforward=True,
        motor_inertia=0.18, load_inertia=0.08, resonance_hz=38.0,
        motor_friction=1.5, load_friction=0.5, viscous=0.9,
        stribeck=0.2, stribeck_speed=0.08, load_dependence=0.06, gravity=8.0,
        effort_noise=0.03, position_step=4.7e-7, dry_of_days=0.01,
    ),
    "wrist_2": SimulatedJoint(
        control="position", speed=2.0, bandwidth=70.0, feedforward=True,
        motor_inertia=0.17, load_inertia=0.05, resonance_hz=42.0,
        motor_friction=1.3, load_friction=0.5, viscous=1.1, asymmetry=0.05,
        effort_noise=0.03, position_step=4.7e-7, dry_of_days=0.01,
    ),
    # Spur gear with play; the encoder is at the output.
    "wrist_3": SimulatedJoint(
        control="position", speed=3.0, bandwidth=60.0, feedforward=True,
        motor_inertia=0.08, load_inertia=0.03, resonance_hz=50.0, play=4e-4,
        motor_friction=0.8, load_friction=0.5, viscous=0.5,
        stribeck=0.15, stribeck_speed=0.1,
        effort_noise=0.03, position_step=4.8e-5, sensor="output", dry_of_days=0.01,
    ),
}  # fmt: skip

JOINT_NAMES: Final = tuple(_ARM)
"""Names of the joints, from the base to the tool."""

_FRICTION_SPREAD: Final = 0.08  # logarithmic scatter between units of a type
_VISCOUS_SPREAD: Final = 0.1

# Links from the shoulder on: mass [kg], distance from the previous joint to the centre [m],
# length [m].
_UPPER_ARM: Final = (8.0, 0.21, 0.42)
_FOREARM: Final = (3.5, 0.18, 0.39)
_HAND: Final = (2.4, 0.06, 0.16)
_G: Final = 9.81
# Squared distance of the part from each joint axis in a typical pose [m2].
_LEVERS: Final = np.array([0.36, 0.42, 0.2, 0.026, 0.01, 0.002])


def arm_unit(seed: int) -> dict[str, SimulatedJoint]:
    """Return the joints of a unit of the arm, keyed by name; friction depends on the seed."""
    rng = np.random.default_rng((seed, 0))
    unit: dict[str, SimulatedJoint] = {}
    for name, joint in _ARM.items():
        dry, viscous = np.exp(rng.normal(0.0, (_FRICTION_SPREAD, _VISCOUS_SPREAD)))
        unit[name] = replace(
            joint,
            motor_friction=float(dry * joint.motor_friction),
            load_friction=float(dry * joint.load_friction),
            viscous=float(viscous * joint.viscous),
        )
    return unit


def gravity_load(position: Vector, part: Vector) -> Vector:
    """Return the joint torques that hold the arm against gravity [N.m], ``(6, n)``.

    The axes of shoulder, elbow and first wrist are parallel; the arm is upright at 0.

    Parameters
    ----------
    position
        Position of the joints [rad], ``(6, n)``.
    part
        Mass of the part in the hand [kg], ``(n,)``.
    """
    upper, fore, hand = np.sin(np.cumsum(position[1:4], axis=0))
    (m_upper, c_upper, l_upper), (m_fore, c_fore, l_fore) = _UPPER_ARM, _FOREARM
    m_hand, c_hand, l_hand = _HAND
    load = np.zeros_like(position)
    load[3] = -_G * (m_hand * c_hand + part * l_hand) * hand
    load[2] = load[3] - _G * (m_fore * c_fore + (m_hand + part) * l_fore) * fore
    load[1] = load[2] - _G * (m_upper * c_upper + (m_fore + m_hand + part) * l_upper) * upper
    return load


def part_inertia(part: Vector) -> Vector:
    """Return the inertia added to each joint by a part in the hand [kg.m2], ``(6, n)``.

    ``part`` is the mass of the part [kg], ``(n,)``.
    """
    return np.outer(_LEVERS, part)
