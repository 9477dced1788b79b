# SPDX-License-Identifier: Apache-2.0
"""Motor and drive kernels of the reference actuator: commutation, windings, eccentric gap.

The numbers (M2) to (M5) refer to equations in ``docs/model.md``.
"""

import math
from typing import Final, NamedTuple

from ema_core._jit import kernel
from ema_core.dynamics import clip
from ema_core.parameters import MechanicalConstants, MotorConstants

_THIRD = 2.0 * math.pi / 3.0
_SIN_THIRD = math.sin(_THIRD)

GAP_REACH: Final = 5e-3
"""Largest angle for the series of the eccentric gap [rad], with a relative error of 3e-14."""


class Sector(NamedTuple):
    """Range of motor angles between two commutations, in which (M2) is linear.

    The sector extends from ``start`` to ``end`` around ``middle`` [rad], limited by the end stops.
    A phase is driven with the sign ``s`` (+1, 0 or -1) of the reference current. Its back-EMF
    constant without eccentricity is ``k`` [V.s/rad] in the middle, with the slope ``dk``
    [V.s/rad^2].
    """

    start: float
    end: float
    middle: float
    s_a: float
    s_b: float
    s_c: float
    k_a: float
    k_b: float
    k_c: float
    dk_a: float
    dk_b: float
    dk_c: float


class Windings(NamedTuple):
    """Resistance [ohm] and inductance [H] of each phase, and its weight in the star voltage [-]."""

    R_a: float
    R_b: float
    R_c: float
    L_a: float
    L_b: float
    L_c: float
    w_a: float
    w_b: float
    w_c: float


class AirGap(NamedTuple):
    """Modulation of the air gap by eccentricity at the motor angle ``theta_m`` [rad] (M5).

    ``cosine`` and ``sine`` are zeta times cosine and sine of ``theta_m + phi`` [-].
    """

    theta_m: float
    cosine: float
    sine: float


@kernel()
def trapezoid(theta_e):
    """Return the unclipped back-EMF shape of a phase [-] at its electrical angle [rad] (M2).

    The phase is driven where the shape is outside +-1.
    """
    turn = theta_e / (2.0 * math.pi) + 0.25
    turn -= math.floor(turn)
    return 12.0 * (0.25 - abs(turn - 0.5))


@kernel()
def commutation(shape):
    """Return the sign of the current in a phase, +1, 0 or -1, for its back-EMF shape (M2)."""
    return (1.0 if shape > 1.0 else 0.0) - (1.0 if shape < -1.0 else 0.0)


@kernel()
def phase_in_sector(motor: MotorConstants, N, middle, half, shift):
    """Return sign, back-EMF constant and slope of a phase in a sector.

    ``N`` is the healthy fraction of the turns [-], ``middle`` and ``half`` are the middle and half
    width of the sector [rad], and ``shift`` is the electrical angle after phase A [rad].
    """
    sign = commutation(trapezoid(motor.P * middle - shift))
    before = clip(trapezoid(motor.P * (middle - half) - shift), 1.0)
    after = clip(trapezoid(motor.P * (middle + half) - shift), 1.0)
    k = 0.5 * motor.k_e * N
    return sign, k * (before + after) / 2.0, k * (after - before) / (2.0 * half)


@kernel()
def sector_at(motor: MotorConstants, mech: MechanicalConstants, theta_m):
    """Return the commutation sector at a motor angle [rad]."""
    half = math.pi / 6.0 / motor.P
    middle = 2.0 * half * round(theta_m / (2.0 * half))
    s_a, k_a, dk_a = phase_in_sector(motor, motor.N_a, middle, half, 0.0)
    s_b, k_b, dk_b = phase_in_sector(motor, motor.N_b, middle, half, _THIRD)
    s_c, k_c, dk_c = phase_in_sector(motor, motor.N_c, middle, half, 2.0 * _THIRD)
    start, end = max(middle - half, -mech.theta_stop), min(middle + half, mech.theta_stop)
    return Sector(start, end, middle, s_a, s_b, s_c, k_a, k_b, k_c, dk_a, dk_b, dk_c)


@kernel()
def windings(motor: MotorConstants):
    """Return the windings of a motor, for the healthy fractions of the turns of its phases.

    A healthy phase has half of the resistance and inductance between two terminals. The resistance
    is proportional to the number of turns, the inductance to its square.
    """
    R, L = 0.5 * motor.R_s, 0.5 * motor.L_s
    L_a, L_b, L_c = L * motor.N_a**2, L * motor.N_b**2, L * motor.N_c**2
    parallel = 1.0 / (1.0 / L_a + 1.0 / L_b + 1.0 / L_c)
    weights = parallel / L_a, parallel / L_b, parallel / L_c
    return Windings(R * motor.N_a, R * motor.N_b, R * motor.N_c, L_a, L_b, L_c, *weights)


@kernel()
def gap_at(motor: MotorConstants, theta_m):
    """Return the modulation of the air gap by eccentricity at a motor angle [rad] (M5)."""
    angle = theta_m + motor.phi
    return AirGap(theta_m, motor.zeta * math.cos(angle), motor.zeta * math.sin(angle))


@kernel()
def modulation(gap: AirGap, delta):
    """Return the relative change of the three back-EMF constants by eccentricity (M5).

    The motor angle is the angle of ``gap`` plus ``delta`` [rad]. The phases are a third of a turn
    apart. The largest omitted term of the Taylor series is delta^5 / 120.
    """
    square = delta * delta
    cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0))
    sine = delta * (1.0 - square * (1.0 / 6.0))
    along = gap.cosine * cosine - gap.sine * sine
    across = _SIN_THIRD * (gap.sine * cosine + gap.cosine * sine)
    return along, -0.5 * along - across, -0.5 * along + across


@kernel()
def overshoot(switch, current, target):
    """Return the excess of a current over its target [A], in the direction its leg drives (M3)."""
    return switch * (current - target)


@kernel()
def star_currents(phases: Windings, dt, v, i):
    """Return the phase currents [A] after a step with voltages ``v`` across the inductances (M4).

    The voltage of the floating star point keeps the sum of the currents constant.
    """
    v_n = phases.w_a * v[0] + phases.w_b * v[1] + phases.w_c * v[2]
    return (
        i[0] + dt / phases.L_a * (v[0] - v_n),
        i[1] + dt / phases.L_b * (v[1] - v_n),
        i[2] + dt / phases.L_c * (v[2] - v_n),
    )
