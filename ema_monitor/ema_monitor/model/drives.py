# SPDX-License-Identifier: Apache-2.0
"""Drives of the monitor model, which convert a reference current to current and torque.

The kernels accept lanes of `ema_core.simd` as well as single floats; the numbers (M10) to (M12)
refer to ``docs/model.md``.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numba.extending import overload

from ema_core._jit import kernel
from ema_core.arrays import Array
from ema_core.dynamics import clip
from ema_core.parameters import ActuatorParameters, MotorConstants
from ema_core.simd import any_lane, select
from ema_monitor.model.field_oriented import (
    FieldOrientedDrive,
    PerLane,
    available_axis_current,
    axis_current,
    field_oriented_drive,
    memory_of_current,
    no_stage,
)

IDLE_CONTRAST: Final = 0.5
"""Relative increase of the lift per difference in the fraction of healthy turns between driven pair
and idle phase [-]."""

_PHASE_ANGLES = (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)
# Phases of the driven pairs, and the idle phase.
_FIRST, _SECOND, _IDLE = [1, 0, 0], [2, 1, 2], [0, 2, 1]

Pairs = tuple[PerLane, PerLane, PerLane]
"""Values of a constant for the driven pairs BC, AB and AC."""


class FastDrive(NamedTuple):
    """Constants of the fast form; tuples hold the values for the driven pairs BC, AB and AC.

    The torque constant is ``K + K_cos cos(theta_m) + K_sin sin(theta_m)`` [N.m/A]; ``slew`` is
    dt / L [s/H], ``waves`` the number of periods of the eccentricity per turn of the shaft,
    ``lift`` the lift of the idle phase (M12) [A], ``ripples`` the inverse of the half-band, 1 / h_b
    [1/A], and ``delay`` the delay of the current loop in steps (M12).
    """

    V_max: float
    T_max: float
    h_b: float
    ripples: float
    delay: PerLane
    half_turns: float
    waves: float
    R: Pairs
    slew: Pairs
    K: Pairs
    K_cos: Pairs
    K_sin: Pairs
    lift: Pairs


class SourceDrive(NamedTuple):
    """Constants of the source form; ``f`` holds the values for the driven pairs BC, AB and AC.

    The eccentricity is ``1 + e_cos cos(theta_e) + (e_sin + e_saw sawtooth) sin(theta_e)``, with
    ``waves`` periods per turn of the shaft; ``slew`` is dt / L [s/H].
    """

    V_max: float
    T_max: float
    k_e: float
    G_M: float
    R_s: float
    half_turns: float
    waves: float
    slew: PerLane
    f: Pairs
    e_cos: PerLane
    e_sin: PerLane
    e_saw: PerLane


def fast_constants(
    motor: MotorConstants, dt: float, lift: PerLane = 0.0, loop_delay: PerLane = 0.0
) -> FastDrive:
    """Return the constants of the fast form for an integration step ``dt`` [s].

    ``lift`` [A] is the lift of the healthy motor, ``loop_delay`` [s] the delay of the current loop;
    both are defined in ``docs/model.md``, M12.
    """
    N = np.stack([motor.N_a, motor.N_b, motor.N_c])
    k, angle = 0.5 * motor.k_e * N, np.add.outer(_PHASE_ANGLES, motor.phi)
    wave, R_s, L_s = k * motor.zeta, 0.5 * motor.R_s * N, 0.5 * motor.L_s * N * N
    phases = np.stack([N, R_s, L_s, k, wave * np.cos(angle), -wave * np.sin(angle)])
    turns, R, L, K, K_cos, K_sin = phases[:, _FIRST] + phases[:, _SECOND]
    contrasts = turns / 2.0 - N[_IDLE]
    return FastDrive(
        V_max=motor.V_max,
        T_max=motor.T_max,
        h_b=motor.h_b,
        ripples=1.0 / motor.h_b,
        delay=loop_delay / dt,
        half_turns=motor.P / math.pi,
        waves=1.0,
        R=tuple(R),
        slew=tuple(dt / L),
        K=tuple(K),
        K_cos=tuple(K_cos),
        K_sin=tuple(K_sin),
        lift=tuple(lift * (1.0 + IDLE_CONTRAST * contrasts)),
    )


def source_constants(motor: MotorConstants, dt: float) -> SourceDrive:
    """Return the constants of the source form for an integration step ``dt`` [s]."""
    N_a, N_b, N_c, wave = motor.N_a, motor.N_b, motor.N_c, 0.42 * motor.zeta
    return SourceDrive(
        V_max=motor.V_max,
        T_max=motor.T_max,
        k_e=motor.k_e,
        G_M=motor.G_M,
        R_s=motor.R_s,
        half_turns=motor.P / math.pi,
        waves=motor.P,
        slew=3.0 * dt / (motor.L_s * (N_a**2 + N_b**2 + N_c**2)),
        f=(0.5 * (N_b + N_c), 0.5 * (N_a + N_b), 0.5 * (N_a + N_c)),
        e_cos=-wave * np.cos(motor.phi),
        e_sin=wave * np.sin(motor.phi),
        e_saw=wave,
    )


def lifts_of_pairs(parameters: ActuatorParameters, position: Array, current: Array) -> Array:
    """Return the derivative of the current with respect to the idle phase's lift, ``(3, n)`` [-].

    The rows belong to the driven pairs BC, AB and AC. A row is 0 while its pair is not driven.
    ``position`` is the angle of the user shaft, ``(n,)`` [rad].
    """
    half_turns = position / parameters.tau * parameters.P / math.pi
    pair = np.floor(3.0 * ((half_turns + 1.0 / 6.0) % 1.0))
    return (pair == np.arange(3.0)[:, None]) * np.clip(current / parameters.h_b, -1.0, 1.0)


class DrivenPair(NamedTuple):
    """Constants of the driven pair of the fast form.

    The constants are valid for motor angles from ``lowest`` to ``highest`` [rad]. ``decay`` is
    ``slew R`` [-], ``rise`` the largest increase of the current per step that the supply permits
    [A], ``band`` half the width of the current band [A]. All other fields are as in `FastDrive`.
    """

    lowest: Any
    highest: Any
    R: Any
    slew: Any
    decay: Any
    K: Any
    K_cos: Any
    K_sin: Any
    lift: Any
    rise: Any
    band: Any


@kernel()
def pair_position(half_turns):
    """Return the position of an electrical angle within the cycle of driven pairs, 0 to 1.

    The cycle is half an electrical turn: BC below 1/3, AB below 2/3, then AC (eq. 4.13).
    """
    from_bc = half_turns + 1.0 / 6.0
    return from_bc - math.floor(from_bc)


@kernel()
def of_pair(position, constants):
    """Return the value for the driven pair, selected from the values for BC, AB and AC."""
    bc, ab, ac = constants
    return select(position < 1.0 / 3.0, bc, select(position < 2.0 / 3.0, ab, ac))


@kernel()
def pair_at(drive: FastDrive, theta_m):
    """Return the constants of the driven pair at a motor angle ``theta_m`` [rad]."""
    half_turns = drive.half_turns * theta_m
    position = pair_position(half_turns)
    start = half_turns - position + of_pair(position, (0.0, 1.0 / 3.0, 2.0 / 3.0))
    R, slew = of_pair(position, drive.R), of_pair(position, drive.slew)
    rise = slew * drive.V_max
    return DrivenPair(
        start / drive.half_turns,
        (start + 1.0 / 3.0) / drive.half_turns,
        R,
        slew,
        slew * R,
        of_pair(position, drive.K),
        of_pair(position, drive.K_cos),
        of_pair(position, drive.K_sin),
        of_pair(position, drive.lift),
        rise,
        drive.h_b + drive.delay * rise,
    )


@kernel()
def pair_after(drive: FastDrive, pair, theta_m):
    """Return the driven pair of each lane; select it again if any lane has left its range.

    The selection takes as long as the rest of a step, and occurs in at most one of ten steps.
    """
    if any_lane((theta_m < pair.lowest) | (theta_m >= pair.highest)):
        return pair_at(drive, theta_m)
    return pair


@kernel()
def fast_drive(drive: FastDrive, pair: DrivenPair, cos, sin, I, I_ref, omega):
    """Return current [A], torque and torque ripple [N.m] after one step.

    The current follows its reference, less the decay within the delay of the loop, at a rate that
    V_max limits. Resistance, inductance and torque constant describe the driven pair (M10);
    ``cos`` and ``sin`` are the cosine and sine of theta_m.
    """
    K = pair.K + pair.K_cos * cos + pair.K_sin * sin
    fall = pair.decay * I + K * (pair.slew * omega)
    I = min(max(I_ref - drive.delay * fall, I - fall - pair.rise), I - fall + pair.rise)
    return I, clip(K * I, drive.T_max), K * pair.band


@kernel()
def source_drive(drive: SourceDrive, position, cos, sin, I, I_ref, omega):
    """Return current [A], torque and torque ripple [N.m] after one step, as in the thesis.

    The full voltage is applied with the sign of the current error. The eccentricity follows eq.
    4.24 and 4.25 of the thesis, which do not describe the reference actuator (M11); ``cos`` and
    ``sin`` are the cosine and sine of theta_e.
    """
    f = of_pair(position, drive.f)
    sawtooth = 2.0 * (3.0 * position - math.floor(3.0 * position))
    K = f * (1.0 + drive.e_cos * cos + (drive.e_sin + drive.e_saw * sawtooth) * sin)
    error = I_ref - I
    voltage = select(error > 0.0, drive.V_max, select(error < 0.0, -drive.V_max, 0.0))
    I = I + drive.slew * (voltage - drive.k_e * K * omega - drive.R_s * f * I)
    return I, clip(drive.G_M * K * I, drive.T_max), 0.0


@kernel()
def lifted_current(drive: FastDrive, pair: DrivenPair, I):
    """Return the equivalent current: the pair current plus the lift of the idle phase [A].

    The lift is defined in ``docs/model.md``, M12.
    """
    return I + pair.lift * clip(drive.ripples * I, 1.0)


@kernel()
def place_in_cycle(drive: SourceDrive, theta_m):
    """Return the position of a motor angle in the cycle of driven pairs, 0 to 1."""
    return pair_position(drive.half_turns * theta_m)


@kernel()
def place_after(drive: SourceDrive, position, theta_m):
    """Return the position of a motor angle in the cycle of driven pairs; ``position`` is unused."""
    return place_in_cycle(drive, theta_m)


@kernel()
def only_current(drive: FastDrive | SourceDrive, I):
    """Return the current unchanged, because the current loop has no state."""
    return I


@kernel()
def bare_current(drive: FastDrive | SourceDrive, stage, I):
    """Return the current of the driven pair, or of the single phase [A]."""
    return I


@kernel()
def available_pair_current(drive: FastDrive, pair: DrivenPair, cos, sin, omega, I):
    """Return the magnitude of the largest steady current in the direction of ``I`` [A].

    Voltage and torque limit it; it is 0 if the back-EMF exceeds the voltage. ``cos`` and ``sin``
    are the cosine and sine of theta_m, ``omega`` is the motor speed [rad/s].
    """
    K = pair.K + (pair.K_cos * cos + pair.K_sin * sin)
    voltage = drive.V_max - math.copysign(K, I) * omega
    by_voltage = max(voltage / pair.R, 0.0)
    return min(by_voltage, drive.T_max / abs(K))


def _by_form(fast: Any, source: Any, field_oriented: Any) -> Any:
    """Return a function that selects a kernel by the type of its first argument."""
    forms = {FastDrive: fast, SourceDrive: source, FieldOrientedDrive: field_oriented}

    def dispatch(drive, *arguments):
        raise NotImplementedError

    @overload(dispatch)
    def choose(drive, *arguments):
        form = forms[drive.instance_class]
        return lambda drive, *arguments: form(drive, *arguments)

    return dispatch


drive_current: Final = _by_form(fast_drive, source_drive, field_oriented_drive)
equivalent_current: Final = _by_form(lifted_current, bare_current, axis_current)
motor_current: Final = _by_form(bare_current, bare_current, axis_current)
first_stage: Final = _by_form(pair_at, place_in_cycle, no_stage)
next_stage: Final = _by_form(pair_after, place_after, no_stage)
currents_at_rest: Final = _by_form(only_current, only_current, memory_of_current)
available_current: Final = _by_form(
    available_pair_current, available_pair_current, available_axis_current
)
