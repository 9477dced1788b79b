# SPDX-License-Identifier: Apache-2.0
"""Kernel of the reference actuator with a sinusoidal motor under field-oriented control.

The three phases are as in the six-step motor, but with sinusoidal back-EMF; the inverter is
averaged over its modulation. Two stationary axes describe three star-connected phases without a
neutral conductor exactly, for any numbers of turns. A step is an Euler step of 1 us, implicit in
the current, because a phase with few turns has a short time constant. The numbers (M33) and (M34)
refer to equations in ``docs/model.md``.
"""

import math
from collections.abc import Container
from typing import Final, NamedTuple

from ema_core._jit import kernel
from ema_core.current_loop import LINEAR_RANGE, CurrentLoop
from ema_core.dynamics import clip, follow_in_play, reference_current, speed_error
from ema_core.parameters import ControlConstants, MechanicalConstants, MotorConstants
from ema_sim.effects import effects_at, half_voltage, motor_speed, plant_at, resistances_at
from ema_sim.motor import GAP_REACH, gap_at, modulation, windings
from ema_sim.reference import Stepping

_HALF_ROOT: Final = math.sqrt(3.0) / 2.0
_NOT_AVERAGED: Final = ("dead_time", "dead_switch")


class FieldOrientedState(NamedTuple):
    """State of the actuator between two steps.

    ``i_alpha`` and ``i_beta`` are the currents on the stationary axes [A], ``i_alpha`` the current
    of phase A; ``z_d`` and ``z_q`` the integrals of the current loops [V]. The other fields are as
    in `ema_sim.reference.State`.
    """

    theta_m: float
    omega: float
    theta_b: float
    i_alpha: float
    i_beta: float
    z_d: float
    z_q: float
    lag_1: float
    lag_2: float
    lag_3: float
    integral: float
    error: float
    torque: float


class Symmetric(NamedTuple):
    """Symmetric matrix on the stationary axes."""

    aa: float
    ab: float
    bb: float


@kernel()
def on_axes(a, b, c):
    """Return the stationary-axes matrix of a quantity of three star-connected phases (M34)."""
    return Symmetric((4.0 * a + b + c) / 6.0, (c - b) / (4.0 * _HALF_ROOT), 0.5 * (b + c))


@kernel()
def step_matrix(M: Symmetric, R: Symmetric, gain, dt):
    """Return the inverse of ``M + dt (R + gain)``, the matrix of an implicit step."""
    aa, ab, bb = M.aa + dt * (R.aa + gain), M.ab + dt * R.ab, M.bb + dt * (R.bb + gain)
    scale = 1.0 / (aa * bb - ab * ab)
    return Symmetric(scale * bb, -scale * ab, scale * aa)


@kernel()
def times(m: Symmetric, a, b):
    """Return the product of a symmetric matrix and the vector ``(a, b)``."""
    return m.aa * a + m.ab * b, m.ab * a + m.bb * b


@kernel()
def turned(cosine, sine, angle):
    """Return cosine and sine of an angle after a rotation by ``angle``.

    The series is accurate to 1e-14 for rotations of up to 0.01 rad.
    """
    square = angle * angle
    c = 1.0 - square * (0.5 - square * (1.0 / 24.0))
    s = angle * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0)))
    return c * cosine - s * sine, c * sine + s * cosine


@kernel()
def advance_sample(
    c: ControlConstants,
    motor: MotorConstants,
    mech: MechanicalConstants,
    phases,
    loop: CurrentLoop,
    effects,
    x: FieldOrientedState,
    command,
    command_slope,
    load,
    load_slope,
    disturbances,
    first,
    stepping: Stepping,
    sample,
):
    """Advance the state by the steps of a sample.

    ``loop`` has the constants of the current loops; the other arguments are as in
    `ema_sim.reference.advance_sample`. Returns the new state and the final state of the sample of
    the current.
    """
    steps, hold, dt, lag, sampling = stepping
    theta_m, omega, theta_b, i_alpha, i_beta, z_d, z_q = x[:7]
    lag_1, lag_2, lag_3, integral, last_error, torque = x[7:]
    # Recomputed in each sample, so that samples do not depend on the division into blocks.
    cosine, sine = math.cos(motor.P * theta_m), math.sin(motor.P * theta_m)
    gap = gap_at(motor, theta_m)
    M = on_axes(phases.L_a, phases.L_b, phases.L_c)
    R = on_axes(*resistances_at(effects, phases.R_a, phases.R_b, phases.R_c))
    controlled, saturated = step_matrix(M, R, loop.K_p, dt), step_matrix(M, R, 0.0, dt)
    k = motor.k_e / (2.0 * _HALF_ROOT)
    sample *= sampling.carry
    for j in range(steps):
        error = speed_error(c, command + j * command_slope, theta_b * mech.tau, omega)
        disturbance = disturbances[(first + j) // hold]
        I_ref = reference_current(c, error, integral, last_error, disturbance, dt)
        integral += dt * error
        last_error = error

        # Torque per ampere of each phase, equal to its voltage per speed (M34).
        sine_b, sine_c = -0.5 * sine - _HALF_ROOT * cosine, -0.5 * sine + _HALF_ROOT * cosine
        k_a, k_b, k_c = k * motor.N_a * sine, k * motor.N_b * sine_b, k * motor.N_c * sine_c
        if motor.zeta != 0.0:
            if abs(theta_m - gap.theta_m) > GAP_REACH:
                gap = gap_at(motor, theta_m)
            m_a, m_b, m_c = modulation(gap, theta_m - gap.theta_m)
            k_a += k_a * m_a
            k_b += k_b * m_b
            k_c += k_c * m_c
        e_alpha = omega * (2.0 * k_a - k_b - k_c) / 3.0
        e_beta = omega * (k_b - k_c) / (2.0 * _HALF_ROOT)

        # The axis q lies along (sine, -cosine), the axis d along (-cosine, -sine).
        i_d = -cosine * i_alpha - sine * i_beta
        i_q = sine * i_alpha - cosine * i_beta
        omega_e = loop.P * omega
        u_d = z_d - omega_e * loop.L * i_q
        u_q = z_q + loop.K_p * I_ref + omega_e * loop.L * i_d + loop.k * omega
        u_alpha, u_beta = sine * u_q - cosine * u_d, -cosine * u_q - sine * u_d
        flux_alpha, flux_beta = times(M, i_alpha, i_beta)
        i_alpha, i_beta = times(
            controlled, flux_alpha + dt * (u_alpha - e_alpha), flux_beta + dt * (u_beta - e_beta)
        )
        v_alpha, v_beta = u_alpha - loop.K_p * i_alpha, u_beta - loop.K_p * i_beta
        most = 2.0 * LINEAR_RANGE * half_voltage(effects, 0.5 * motor.V_max, j * dt)
        magnitude = math.hypot(v_alpha, v_beta)
        share = 1.0
        if magnitude > most:
            share = most / magnitude
            i_alpha, i_beta = times(
                saturated,
                flux_alpha + dt * (share * v_alpha - e_alpha),
                flux_beta + dt * (share * v_beta - e_beta),
            )
        i_d = -cosine * i_alpha - sine * i_beta
        i_q = sine * i_alpha - cosine * i_beta
        # Anti-windup: the voltage that the inverter cannot supply reduces the integrals.
        lost = (share - 1.0) / loop.K_p
        z_d += dt * loop.K_i * (-i_d - lost * (cosine * v_alpha + sine * v_beta))
        z_q += dt * loop.K_i * (I_ref - i_q + lost * (sine * v_alpha - cosine * v_beta))

        half_beta = _HALF_ROOT * i_beta
        torque = k_a * i_alpha + k_b * (half_beta - 0.5 * i_alpha)
        torque = clip(torque - k_c * (half_beta + 0.5 * i_alpha), motor.T_max)
        lag_1 += lag * (i_q - lag_1)
        lag_2 += lag * (lag_1 - lag_2)
        lag_3 += lag * (lag_2 - lag_3)
        sample = sampling.keep * sample + sampling.gain * lag_3

        net = torque - (load + j * load_slope)
        omega = motor_speed(effects, mech, motor.P, omega, net, theta_m, theta_b, dt)
        before = theta_m
        theta_m += dt * omega
        if abs(theta_m) > mech.theta_stop:
            theta_m = math.copysign(mech.theta_stop, theta_m)
            omega = 0.0
        cosine, sine = turned(cosine, sine, motor.P * (theta_m - before))
        theta_b = follow_in_play(theta_b, theta_m, mech.half_backlash)
    electrical = i_alpha, i_beta, z_d, z_q
    loops = lag_1, lag_2, lag_3, integral, last_error, torque
    return FieldOrientedState(theta_m, omega, theta_b, *electrical, *loops), sample


@kernel()
def advance_field_oriented(
    c: ControlConstants,
    motor: MotorConstants,
    mech: MechanicalConstants,
    loop: CurrentLoop,
    effects,
    x: FieldOrientedState,
    last_command,
    commands,
    last_load,
    loads,
    disturbances,
    stepping: Stepping,
    sample,
    columns,
):
    """Advance the state by ``n`` samples and fill the telemetry columns.

    The arguments are as in `ema_sim.reference.advance`; the current is i_q. Returns the new state,
    as a plain tuple, and the final state of the last sample of the current.
    """
    steps = stepping.steps
    current, position, speed = columns
    phases = windings(motor)
    for k in range(len(commands)):
        held = effects_at(effects, k)
        motor_k, mech_k, phases_k = plant_at(held, motor, mech, phases)
        x, sample = advance_sample(
            c,
            motor_k,
            mech_k,
            phases_k,
            loop,
            held,
            x,
            last_command,
            (commands[k] - last_command) / steps,
            last_load,
            (loads[k] - last_load) / steps,
            disturbances,
            k * steps,
            stepping,
            sample,
        )
        last_command = commands[k]
        last_load = loads[k]
        current[k] = sample / stepping.sampling.divisor
        position[k] = x.theta_b * mech.tau
        speed[k] = x.omega
    # A plain tuple, as in `ema_sim.reference.advance`: an interrupt would crash a NamedTuple.
    return x[:], sample


def field_oriented_at_rest(theta_m: float = 0.0, theta_b: float = 0.0) -> FieldOrientedState:
    """Return the state of an actuator at rest without current.

    Parameters
    ----------
    theta_m, theta_b
        Angle of the motor, and of the fast shaft on the user side of the backlash [rad].
    """
    return FieldOrientedState(float(theta_m), 0.0, float(theta_b), *(0.0,) * 10)


def unlike_causes(names: Container[str]) -> str:
    """Return why hidden causes cannot be simulated with this drive, or "" if all can be."""
    wrong = [name for name in _NOT_AVERAGED if name in names]
    if not wrong:
        return ""
    return (
        f"{', '.join(wrong)}: the inverter of a field_oriented drive is averaged over its "
        "modulation and has no switches; simulate this cause with drive six_step"
    )
