"""Kernels of the reference actuator: three-phase BLDC motor, inverter, control and mechanics.

One step is an explicit Euler step of 1 us, section 3.1 of the thesis; the numbers (M1) to (M8) are
those of ``docs/model.md``.
"""

import math
from typing import Final, NamedTuple

from ema_core._jit import kernel
from ema_core.dynamics import (
    clip,
    follow_in_play,
    next_speed,
    reference_current,
    speed_error,
)
from ema_core.parameters import ControlConstants, MechanicalConstants, MotorConstants

DT: Final = 1e-6
"""Integration step [s]."""

_THIRD = 2.0 * math.pi / 3.0


class State(NamedTuple):
    """State of the reference actuator between two steps.

    ``theta_m`` [rad] and ``omega`` [rad/s] belong to the motor shaft, ``theta_b`` [rad] is the
    fast-shaft angle behind the backlash, ``i_a`` to ``i_c`` are phase currents [A], ``q_a`` to
    ``q_c`` the switching states (+1 or -1 for plus or minus half the supply), ``lag_1`` to
    ``lag_3`` the filtered equivalent current [A], ``integral`` [rad] and ``error`` [rad/s] the
    memory of the speed loop, ``torque`` the motor torque of the last step [N.m].
    """

    theta_m: float
    omega: float
    theta_b: float
    i_a: float
    i_b: float
    i_c: float
    q_a: float
    q_b: float
    q_c: float
    lag_1: float
    lag_2: float
    lag_3: float
    integral: float
    error: float
    torque: float


@kernel()
def trapezoid(theta_e):
    """Unclipped back-EMF shape of a phase at its electrical angle; beyond +-1 it is driven (M2)."""
    turn = theta_e / (2.0 * math.pi) + 0.25
    turn -= math.floor(turn)
    return 12.0 * (0.25 - abs(turn - 0.5))


@kernel()
def commutation(shape):
    """Sign of the current that a phase is driven with: +1, 0 or -1 (M2)."""
    return (1.0 if shape > 1.0 else 0.0) - (1.0 if shape < -1.0 else 0.0)


@kernel()
def hysteresis(switch, current, target, h_b):
    """Switching state of a leg after comparing its current with the target (M3)."""
    if current < target - h_b:
        return 1.0
    if current > target + h_b:
        return -1.0
    return switch


@kernel()
def step(
    c: ControlConstants,
    motor: MotorConstants,
    mech: MechanicalConstants,
    x: State,
    command,
    disturbance,
    load,
    dt,
    lag,
):
    """Advance the state by one step.

    ``command`` is the angle at the step's start [rad], ``disturbance`` the noise on the reference
    current [A], ``load`` the external torque against positive motion [N.m], ``lag`` the share
    that ``lag_factor`` gives for ``dt``.
    """
    error = speed_error(c, command, x.theta_b * mech.tau, x.omega)
    I_ref = reference_current(c, error, x.integral, x.error, disturbance, dt)

    theta_e = motor.P * x.theta_m
    shape_a = trapezoid(theta_e)
    shape_b = trapezoid(theta_e - _THIRD)
    shape_c = trapezoid(theta_e - 2.0 * _THIRD)
    q_a = hysteresis(x.q_a, x.i_a, I_ref * commutation(shape_a), motor.h_b)
    q_b = hysteresis(x.q_b, x.i_b, I_ref * commutation(shape_b), motor.h_b)
    q_c = hysteresis(x.q_c, x.i_c, I_ref * commutation(shape_c), motor.h_b)

    # Eccentricity modulates the three back-EMF constants, a third of a turn apart (M5).
    gap_a, gap_b, gap_c = 1.0, 1.0, 1.0
    if motor.zeta != 0.0:
        angle = x.theta_m + motor.phi
        gap_a += motor.zeta * math.cos(angle)
        gap_b += motor.zeta * math.cos(angle + _THIRD)
        gap_c += motor.zeta * math.cos(angle + 2.0 * _THIRD)
    k_a = 0.5 * motor.k_e * motor.N_a * clip(shape_a, 1.0) * gap_a
    k_b = 0.5 * motor.k_e * motor.N_b * clip(shape_b, 1.0) * gap_b
    k_c = 0.5 * motor.k_e * motor.N_c * clip(shape_c, 1.0) * gap_c

    # Star with floating centre: its voltage is that which keeps the sum of the currents (M4).
    half_R, half_L, half_V = 0.5 * motor.R_s, 0.5 * motor.L_s, 0.5 * motor.V_max
    inverse_a = 1.0 / (half_L * motor.N_a * motor.N_a)
    inverse_b = 1.0 / (half_L * motor.N_b * motor.N_b)
    inverse_c = 1.0 / (half_L * motor.N_c * motor.N_c)
    drop_a = half_V * q_a - half_R * motor.N_a * x.i_a - k_a * x.omega
    drop_b = half_V * q_b - half_R * motor.N_b * x.i_b - k_b * x.omega
    drop_c = half_V * q_c - half_R * motor.N_c * x.i_c - k_c * x.omega
    v_n = (drop_a * inverse_a + drop_b * inverse_b + drop_c * inverse_c) / (
        inverse_a + inverse_b + inverse_c
    )
    i_a = x.i_a + dt * inverse_a * (drop_a - v_n)
    i_b = x.i_b + dt * inverse_b * (drop_b - v_n)
    i_c = x.i_c + dt * inverse_c * (drop_c - v_n)

    torque = clip(k_a * i_a + k_b * i_b + k_c * i_c, motor.T_max)
    sign = (1.0 if torque > 0.0 else 0.0) - (1.0 if torque < 0.0 else 0.0)
    equivalent = 0.5 * sign * (abs(i_a) + abs(i_b) + abs(i_c))
    lag_1 = x.lag_1 + lag * (equivalent - x.lag_1)
    lag_2 = x.lag_2 + lag * (lag_1 - x.lag_2)
    lag_3 = x.lag_3 + lag * (lag_2 - x.lag_3)

    omega = next_speed(mech, x.omega, torque - load, mech.f_s, dt)
    theta_m = x.theta_m + dt * omega
    if abs(theta_m) > mech.theta_stop:
        theta_m = math.copysign(mech.theta_stop, theta_m)
        omega = 0.0
    return State(
        theta_m,
        omega,
        follow_in_play(x.theta_b, theta_m, mech.half_backlash),
        i_a,
        i_b,
        i_c,
        q_a,
        q_b,
        q_c,
        lag_1,
        lag_2,
        lag_3,
        x.integral + dt * error,
        error,
        torque,
    )


@kernel()
def advance(
    c: ControlConstants,
    motor: MotorConstants,
    mech: MechanicalConstants,
    x: State,
    last_command,
    commands,
    last_load,
    loads,
    disturbances,
    hold,
    steps,
    dt,
    lag,
    current,
    position,
    speed,
):
    """Advance the state by ``n`` samples of ``steps`` steps and fill the telemetry columns.

    Command and load are interpolated linearly from the sample before (``last_command``,
    ``last_load``); a disturbance is held for ``hold`` steps. ``current``, ``position`` and
    ``speed`` are filled, all ``(n,)``. The new state is returned as a plain tuple.
    """
    tick = 0
    for k in range(len(commands)):
        total = 0.0
        for j in range(steps):
            share = j / steps
            x = step(
                c,
                motor,
                mech,
                x,
                last_command + share * (commands[k] - last_command),
                disturbances[tick // hold],
                last_load + share * (loads[k] - last_load),
                dt,
                lag,
            )
            total += x.lag_3
            tick += 1
        last_command = commands[k]
        last_load = loads[k]
        current[k] = total / steps
        position[k] = x.theta_b * mech.tau
        speed[k] = x.omega
    # Not the NamedTuple itself: to build one, numba runs Python code, and an interrupt that arrives
    # there (Ctrl-C) ends in a crash.
    return x[:]
