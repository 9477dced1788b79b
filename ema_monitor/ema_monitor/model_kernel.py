"""Kernels of the monitor model: one equivalent phase, run for many fault vectors at once.

The numbers (M10) to (M12) are those of ``docs/model.md``.
"""

import math
from typing import NamedTuple

import numba
from numpy.typing import NDArray

from ema_core._jit import kernel
from ema_core.dynamics import (
    clip,
    follow_in_play,
    next_speed,
    reference_current,
    speed_error,
)
from ema_core.parameters import ControlConstants, MechanicalConstants, MotorConstants

_THIRD = 2.0 * math.pi / 3.0


class Lanes(NamedTuple):
    """What differs between the individuals of one call, each ``(n,)``.

    ``play`` is where in its play the motor stands at the start, in half-widths of the backlash.
    """

    G_prop: NDArray
    f_s: NDArray
    f_d: NDArray
    half_backlash: NDArray
    N_a: NDArray
    N_b: NDArray
    N_c: NDArray
    zeta: NDArray
    phi: NDArray
    play: NDArray


@kernel()
def active_pair(theta_e):
    """Return which two phases are driven at an electrical angle: 0 BC, 1 AB, 2 AC (eq. 4.13)."""
    turn = theta_e / math.pi + 1.0 / 6.0
    return int(3.0 * (turn - math.floor(turn)))


@kernel()
def fast_drive(motor: MotorConstants, I, I_ref, omega, theta_m, dt):
    """Return current, torque and ripple of the torque one step on.

    The current follows its reference as fast as V_max lets it. Resistance, inductance and torque
    constant are those of the driven pair (M10).
    """
    pair = active_pair(motor.P * theta_m)
    N_1, delta_1 = motor.N_a, 0.0
    N_2, delta_2 = motor.N_b, _THIRD
    if pair == 0:
        N_1, delta_1 = motor.N_c, 2.0 * _THIRD
    elif pair == 2:
        N_2, delta_2 = motor.N_c, 2.0 * _THIRD
    K_1, K_2 = N_1, N_2
    if motor.zeta != 0.0:
        angle = theta_m + motor.phi
        K_1 *= 1.0 + motor.zeta * math.cos(angle + delta_1)
        K_2 *= 1.0 + motor.zeta * math.cos(angle + delta_2)
    K = 0.5 * motor.k_e * (K_1 + K_2)
    R = 0.5 * motor.R_s * (N_1 + N_2)
    L = 0.5 * motor.L_s * (N_1 * N_1 + N_2 * N_2)
    drop = R * I + K * omega
    fall = dt / L * (-motor.V_max - drop)
    rise = dt / L * (motor.V_max - drop)
    I = I + min(max(I_ref - I, fall), rise)
    return I, clip(K * I, motor.T_max), K * motor.h_b


@kernel()
def source_drive(motor: MotorConstants, I, I_ref, omega, theta_m, dt):
    """Return current, torque and its ripple by the thesis: full voltage by the error's sign.

    The form of the eccentricity is that printed in the thesis, eq. 4.24 and 4.25, which does not
    describe the reference actuator (M11).
    """
    theta_e = motor.P * theta_m
    pair = active_pair(theta_e)
    f = 0.5 * (motor.N_a + motor.N_b)
    if pair == 0:
        f = 0.5 * (motor.N_b + motor.N_c)
    elif pair == 2:
        f = 0.5 * (motor.N_a + motor.N_c)
    K = f
    if motor.zeta != 0.0:
        turn = (6.0 * theta_e - math.pi) / (2.0 * math.pi)
        sawtooth = 2.0 * (turn - math.floor(turn))
        K *= 1.0 - 0.42 * motor.zeta * (
            math.cos(theta_e + motor.phi) + sawtooth * math.sin(theta_e - math.pi)
        )
    L = motor.L_s * (motor.N_a**2 + motor.N_b**2 + motor.N_c**2) / 3.0
    error = I_ref - I
    sign = (1.0 if error > 0.0 else 0.0) - (1.0 if error < 0.0 else 0.0)
    I = I + dt / L * (sign * motor.V_max - motor.k_e * K * omega - motor.R_s * f * I)
    return I, clip(motor.G_M * K * I, motor.T_max), 0.0


@kernel()
def run_lane(
    c: ControlConstants,
    motor: MotorConstants,
    mech: MechanicalConstants,
    play,
    command,
    position_0,
    speed_0,
    current_0,
    source,
    steps,
    dt,
    lag,
    current,
):
    """Run one individual through a window and fill its ``current``, ``(n,)`` [A].

    ``command`` is ``(n + 1,)``: its first value belongs to the start, at which the user shaft
    stands at ``position_0`` [rad], the motor turns with ``speed_0`` [rad/s] and draws
    ``current_0`` [A]. ``source`` selects the source form.
    """
    theta_b = position_0 / mech.tau
    theta_m = theta_b + play * mech.half_backlash
    omega = speed_0
    error = speed_error(c, command[0], position_0, omega)
    # What the integrator holds at the start shows only in the current.
    integral = (current_0 * c.k_t - c.GAP * error) / c.GAI if c.GAI > 0.0 else 0.0
    I = reference_current(c, error, integral, error, 0.0, dt)
    lag_1, lag_2, lag_3 = I, I, I
    for k in range(len(current)):
        total = 0.0
        for j in range(steps):
            # An Euler step answers half a step too soon: the command is read half a step late.
            now = command[k] + (j - 0.5) / steps * (command[k + 1] - command[k])
            last_error = error
            error = speed_error(c, now, theta_b * mech.tau, omega)
            I_ref = reference_current(c, error, integral, last_error, 0.0, dt)
            integral += dt * error
            if source:
                I, torque, ripple = source_drive(motor, I, I_ref, omega, theta_m, dt)
            else:
                I, torque, ripple = fast_drive(motor, I, I_ref, omega, theta_m, dt)
            lag_1 += lag * (I - lag_1)
            lag_2 += lag * (lag_1 - lag_2)
            lag_3 += lag * (lag_2 - lag_3)
            total += lag_3
            # The ripple of the PWM breaks the motor away below its static friction (M12).
            breakaway = max(mech.f_s - ripple, mech.f_d)
            omega = next_speed(mech, omega, torque, breakaway, dt)
            theta_m += dt * omega
            if abs(theta_m) > mech.theta_stop:
                theta_m = math.copysign(mech.theta_stop, theta_m)
                omega = 0.0
            theta_b = follow_in_play(theta_b, theta_m, mech.half_backlash)
        current[k] = total / steps


@kernel(parallel=True)
def run_lanes(
    c: ControlConstants,
    motor: MotorConstants,
    mech: MechanicalConstants,
    lanes: Lanes,
    command,
    position_0,
    speed_0,
    current_0,
    source,
    steps,
    dt,
    lag,
    current,
):
    """Run all individuals through one window; ``current`` is ``(n_lanes, n)`` [A]."""
    for i in numba.prange(len(lanes.play)):
        run_lane(
            ControlConstants(lanes.G_prop[i], c.GAP, c.GAI, c.GAD, c.omega_max, c.k_t, c.I_max),
            MotorConstants(
                motor.V_max,
                motor.T_max,
                motor.k_e,
                motor.G_M,
                motor.R_s,
                motor.L_s,
                motor.P,
                motor.h_b,
                lanes.N_a[i],
                lanes.N_b[i],
                lanes.N_c[i],
                lanes.zeta[i],
                lanes.phi[i],
            ),
            MechanicalConstants(
                mech.J,
                mech.C,
                lanes.f_s[i],
                lanes.f_d[i],
                lanes.half_backlash[i],
                mech.tau,
                mech.theta_stop,
            ),
            lanes.play[i],
            command,
            position_0,
            speed_0,
            current_0,
            source,
            steps,
            dt,
            lag,
            current[i],
        )
