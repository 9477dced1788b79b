# SPDX-License-Identifier: Apache-2.0
"""Field-oriented drive of the monitor model: the q axis of a sinusoidal motor.

The kernels accept lanes of `ema_core.simd` as well as single floats; the number (M35) refers to an
equation in ``docs/model.md``.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from ema_core._jit import kernel
from ema_core.arrays import Array
from ema_core.current_loop import LINEAR_RANGE, CurrentLoop
from ema_core.dynamics import clip
from ema_core.parameters import MotorConstants

PerLane = Array | float
"""A constant for each individual, ``(n,)``, or one value for all individuals."""

Harmonics = tuple[PerLane, PerLane, PerLane]
"""Mean of a constant over an electrical turn, and cosine and sine components of its second
harmonic."""

_PHASE_ANGLES: Final = (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)


class FieldOrientedDrive(NamedTuple):
    """Constants of the q axis.

    The torque constant is ``K + K_cos cos(theta_m) + K_sin sin(theta_m)`` [N.m/A]. ``K``, ``K_cos``
    and ``K_sin`` are `Harmonics` of the electrical angle, as is the resistance ``R`` [ohm].
    ``V_max`` is the largest amplitude of the phase voltages [V] and ``halved`` is 0.5 / V_max;
    ``slew`` [s/H] is the change of a controlled current per volt in a step. ``K_p`` [ohm], its
    inverse ``A_p`` [S], ``K_i`` [ohm] (times the step), ``L`` [H] and ``k`` [V.s/rad] are constants
    of the current loop. ``poles`` is the number of pole pairs, an integer, and ``waves`` the number
    of periods of the eccentricity per turn of the shaft.
    """

    V_max: PerLane
    halved: PerLane
    T_max: float
    poles: int
    waves: float
    slew: PerLane
    R: Harmonics
    K: Harmonics
    K_cos: Harmonics
    K_sin: Harmonics
    K_p: PerLane
    A_p: PerLane
    K_i: PerLane
    L: float
    k: float


def field_oriented_constants(
    motor: MotorConstants, loop: CurrentLoop, dt: float, loop_delay: PerLane = 0.0
) -> FieldOrientedDrive:
    """Return the constants of a field-oriented drive for an integration step ``dt`` [s].

    ``loop`` is the nominal loop; ``loop_delay`` is added to its time constant [s].
    """
    slower = 1.0 / (1.0 + loop.K_p / loop.L * loop_delay)
    R, L, k = 0.5 * motor.R_s, 0.5 * motor.L_s, motor.k_e / math.sqrt(3.0)
    turns = (motor.N_a, motor.N_b, motor.N_c)
    K = [(k * N, angle) for N, angle in zip(turns, _PHASE_ANGLES, strict=True)]
    zeta, phi = motor.zeta, motor.phi
    K_cos = [(constant * zeta * np.cos(phi + angle), angle) for constant, angle in K]
    K_sin = [(-constant * zeta * np.sin(phi + angle), angle) for constant, angle in K]
    R_q = [(R * N * 2.0 / 3.0, angle) for N, angle in zip(turns, _PHASE_ANGLES, strict=True)]
    K_p = loop.K_p * slower
    L_q = L * (motor.N_a**2 + motor.N_b**2 + motor.N_c**2) / 3.0
    decay = (K_p + R * (motor.N_a + motor.N_b + motor.N_c) / 3.0) / L_q
    return FieldOrientedDrive(
        V_max=motor.V_max * LINEAR_RANGE,
        halved=0.5 / (motor.V_max * LINEAR_RANGE),
        T_max=motor.T_max,
        poles=round(float(motor.P)),
        waves=1.0,
        slew=-np.expm1(-dt * decay) / (decay * L_q),
        R=_harmonics(R_q),
        K=_harmonics(K),
        K_cos=_harmonics(K_cos),
        K_sin=_harmonics(K_sin),
        K_p=K_p,
        A_p=1.0 / K_p,
        K_i=loop.K_i * slower * dt,
        L=loop.L,
        k=loop.k,
    )


def _harmonics(phases: list[tuple[Any, float]]) -> Harmonics:
    """Return the sum over phases (value, angle) of ``value * sin(theta_e - angle)**2``."""
    return (
        sum(value for value, _ in phases) / 2.0,
        -sum(value * math.cos(2.0 * angle) for value, angle in phases) / 2.0,
        -sum(value * math.sin(2.0 * angle) for value, angle in phases) / 2.0,
    )


@kernel()
def times_angle(cos, sin, number):
    """Return cosine and sine of ``number`` times an angle, for an integer of at least 0."""
    c, s = 0.0 * cos + 1.0, 0.0 * sin
    while number > 0:
        if number % 2 == 1:
            c, s = c * cos - s * sin, s * cos + c * sin
        cos, sin = cos * cos - sin * sin, 2.0 * (cos * sin)
        number //= 2
    return c, s


@kernel()
def at_angle(harmonics, cos_2, sin_2):
    """Return a constant at an electrical angle, from cosine and sine of twice the angle."""
    mean, of_cos, of_sin = harmonics
    return mean + of_cos * cos_2 + of_sin * sin_2


@kernel()
def torque_constant(drive: FieldOrientedDrive, cos, sin, cos_2, sin_2):
    """Return the torque per ampere of the q axis [N.m/A] (``docs/model.md``, M35)."""
    K = at_angle(drive.K, cos_2, sin_2)
    return K + (
        at_angle(drive.K_cos, cos_2, sin_2) * cos + at_angle(drive.K_sin, cos_2, sin_2) * sin
    )


@kernel()
def field_oriented_drive(drive: FieldOrientedDrive, stage, cos, sin, currents, I_ref, omega):
    """Return current and loop integral [A, V], torque and torque ripple [N.m] after one step.

    ``currents`` are the current and the loop integral before the step; ``cos`` and ``sin`` belong
    to the angle theta_m. The PWM is averaged and has no ripple (``docs/model.md``, M35).
    """
    I, z = currents
    cos_2, sin_2 = times_angle(cos, sin, 2 * drive.poles)
    K = torque_constant(drive, cos, sin, cos_2, sin_2)
    v_d = drive.poles * omega * (drive.L * I)
    # Voltage amplitude available to the q axis, by the first terms of the square root's series.
    most = max(drive.V_max - drive.halved * (v_d * v_d), 0.0)
    reference = drive.K_p * (I_ref - I) + z + drive.k * omega
    voltage = min(max(reference, -most), most)
    induced = (2.0 / 3.0) * (K * omega)
    z = z + drive.K_i * (I_ref - I + drive.A_p * (voltage - reference))
    I = I + drive.slew * (voltage - at_angle(drive.R, cos_2, sin_2) * I - induced)
    return (I, z), clip(K * I, drive.T_max), 0.0


@kernel()
def memory_of_current(drive: FieldOrientedDrive, I):
    """Return the current loop's state at a steady current ``I``: current and integral [A, V]."""
    return I, I * drive.R[0]


@kernel()
def axis_current(drive: FieldOrientedDrive, stage, currents):
    """Return the current of the q axis [A]."""
    return currents[0]


@kernel()
def available_axis_current(drive: FieldOrientedDrive, stage, cos, sin, omega, I):
    """Return the magnitude of the largest steady current in the direction of ``I`` [A].

    Voltage and torque limit it; it is 0 if the back-EMF exceeds the voltage. ``cos`` and ``sin``
    are the cosine and sine of theta_m, ``omega`` is the motor speed [rad/s]. The voltage that the d
    axis needs is neglected. ``stage`` is ignored.
    """
    cos_2, sin_2 = times_angle(cos, sin, 2 * drive.poles)
    K = torque_constant(drive, cos, sin, cos_2, sin_2)
    voltage = drive.V_max - math.copysign((2.0 / 3.0) * K, I) * omega
    by_voltage = max(voltage / at_angle(drive.R, cos_2, sin_2), 0.0)
    return min(by_voltage, drive.T_max / abs(K))


@kernel()
def no_stage(drive: FieldOrientedDrive, *angles):
    """Return 0, because the drive has no driven pair of phases."""
    return 0.0
