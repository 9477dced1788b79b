# SPDX-License-Identifier: Apache-2.0
"""Kernels of the reference actuator: three-phase BLDC motor, inverter, control and mechanics.

A step is an explicit Euler step of 1 us (section 3.1 of the thesis). The numbers (M1) to (M8) refer
to equations in ``docs/model.md``. Branches for rare events are cheap, because the processor
predicts them well.
"""

import math
from typing import Final, NamedTuple

from ema_core._jit import kernel
from ema_core.dynamics import CurrentSampling, clip, follow_in_play, reference_current, speed_error
from ema_core.parameters import ControlConstants, MechanicalConstants, MotorConstants
from ema_sim.effects import (
    effects_at,
    half_voltage,
    motor_speed,
    pauses_at,
    phase_currents,
    plant_at,
)
from ema_sim.motor import GAP_REACH, Windings, gap_at, modulation, overshoot, sector_at, windings

DT: Final = 1e-6
"""Integration step [s]."""


class Stepping(NamedTuple):
    """Time stepping within a sample, for kernels.

    A sample has ``steps`` steps of ``dt`` [s]; noise is held for ``hold`` steps. ``lag`` is
    ``lag_factor(dt)``; ``sampling`` has the constants for samples of the current.
    """

    steps: int
    hold: int
    dt: float
    lag: float
    sampling: CurrentSampling


class State(NamedTuple):
    """State of the reference actuator between two steps.

    ``theta_m`` [rad] and ``omega`` [rad/s] belong to the motor shaft, ``theta_b`` [rad] is the
    fast-shaft angle after the backlash, ``i_a`` to ``i_c`` are phase currents [A], ``q_a`` to
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
def advance_sample(
    c: ControlConstants,
    motor: MotorConstants,
    mech: MechanicalConstants,
    phases: Windings,
    effects,
    pauses,
    x: State,
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

    ``command`` is the angle at the start [rad], ``load`` the external torque against positive
    motion [N.m]; both grow by their slope in each step. ``disturbances`` is the noise on the
    reference current [A]; the sample starts at step ``first`` of the noise. ``sample`` is the final
    state of the previous sample of the current. ``effects`` are the effects of hidden causes, or
    ``NoEffects``, and ``pauses`` the remaining dead times of the legs [steps]. Returns the new
    state, the final state of the sample and the new ``pauses``.
    """
    steps, hold, dt, lag, sampling = stepping
    theta_m, omega, theta_b = x[:3]
    i, q = x[3:6], x[6:9]
    lag_1, lag_2, lag_3, integral, last_error, torque = x[9:]
    half_V, h_b = 0.5 * motor.V_max, motor.h_b
    # Recomputed in each sample, so that samples do not depend on the division into blocks.
    sector, gap = sector_at(motor, mech, theta_m), gap_at(motor, theta_m)
    sample *= sampling.carry
    for j in range(steps):
        error = speed_error(c, command + j * command_slope, theta_b * mech.tau, omega)
        disturbance = disturbances[(first + j) // hold]
        I_ref = reference_current(c, error, integral, last_error, disturbance, dt)
        integral += dt * error
        last_error = error

        over_a = overshoot(q[0], i[0], I_ref * sector.s_a)
        over_b = overshoot(q[1], i[1], I_ref * sector.s_b)
        over_c = overshoot(q[2], i[2], I_ref * sector.s_c)
        if max(over_a, over_b, over_c) > h_b:
            switches = over_a > h_b, over_b > h_b, over_c > h_b
            q = (
                -q[0] if switches[0] else q[0],
                -q[1] if switches[1] else q[1],
                -q[2] if switches[2] else q[2],
            )
            pauses = pauses_at(effects, pauses, switches, dt)

        delta = theta_m - sector.middle
        k_a = sector.k_a + sector.dk_a * delta
        k_b = sector.k_b + sector.dk_b * delta
        k_c = sector.k_c + sector.dk_c * delta
        if motor.zeta != 0.0:
            if abs(theta_m - gap.theta_m) > GAP_REACH:
                gap = gap_at(motor, theta_m)
            m_a, m_b, m_c = modulation(gap, theta_m - gap.theta_m)
            k_a += k_a * m_a
            k_b += k_b * m_b
            k_c += k_c * m_c

        rail = half_voltage(effects, half_V, j * dt)
        k = k_a, k_b, k_c
        i, pauses = phase_currents(effects, phases, pauses, rail, omega, dt, q, i, k)

        torque = clip(k_a * i[0] + k_b * i[1] + k_c * i[2], motor.T_max)
        sign = (1.0 if torque > 0.0 else 0.0) - (1.0 if torque < 0.0 else 0.0)
        equivalent = 0.5 * sign * (abs(i[0]) + abs(i[1]) + abs(i[2]))
        lag_1 += lag * (equivalent - lag_1)
        lag_2 += lag * (lag_1 - lag_2)
        lag_3 += lag * (lag_2 - lag_3)
        sample = sampling.keep * sample + sampling.gain * lag_3

        net = torque - (load + j * load_slope)
        omega = motor_speed(effects, mech, motor.P, omega, net, theta_m, theta_b, dt)
        theta_m += dt * omega
        if not sector.start <= theta_m <= sector.end:
            if abs(theta_m) > mech.theta_stop:
                theta_m = math.copysign(mech.theta_stop, theta_m)
                omega = 0.0
            sector = sector_at(motor, mech, theta_m)
        theta_b = follow_in_play(theta_b, theta_m, mech.half_backlash)
    loops = lag_1, lag_2, lag_3, integral, last_error, torque
    # pyright does not know the length of a slice of a tuple.
    state = State(theta_m, omega, theta_b, *i, *q, *loops)  # pyright: ignore[reportCallIssue]
    return state, sample, pauses


@kernel()
def advance(
    c: ControlConstants,
    motor: MotorConstants,
    mech: MechanicalConstants,
    effects,
    pauses,
    x: State,
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

    Command and load are interpolated linearly from their values before the block
    (``last_command``, ``last_load``). ``columns`` are current, position and speed, all ``(n,)``;
    further arguments are as in `advance_sample`. ``effects`` are the
    ``Courses`` of hidden causes, or ``NoEffects``. Returns the new state, as a plain tuple,
    ``pauses`` and the final state of the last sample of the current.
    """
    steps = stepping.steps
    current, position, speed = columns
    phases = windings(motor)
    for k in range(len(commands)):
        held = effects_at(effects, k)
        x, sample, pauses = advance_sample(
            c,
            *plant_at(held, motor, mech, phases),
            held,
            pauses,
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
    # A plain tuple: numba runs Python code to return a NamedTuple, and an interrupt (Ctrl-C) during
    # this code crashes the process.
    return x[:], pauses, sample
