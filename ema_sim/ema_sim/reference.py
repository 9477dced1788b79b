"""Kernels of the reference actuator: three-phase BLDC motor, inverter, control and mechanics.

One step is an explicit Euler step of 1 us, section 3.1 of the thesis; the numbers (M1) to (M8) are
those of ``docs/model.md``. Rare events (commutation, switching of a leg, the end stop) are behind
branches that the processor predicts well, so that the duration of a step is little more than the
latency from voltage over current and torque to speed.
"""

import math
from typing import Final, NamedTuple

from ema_core._jit import kernel
from ema_core.dynamics import (
    CurrentSampling,
    clip,
    follow_in_play,
    reference_current,
    speed_error,
)
from ema_core.parameters import ControlConstants, MechanicalConstants, MotorConstants
from ema_sim.effects import (
    effects_at,
    half_voltage,
    motor_speed,
    pauses_at,
    phase_currents,
    plant_at,
)
from ema_sim.motor import (
    GAP_REACH,
    Windings,
    gap_at,
    modulation,
    overshoot,
    sector_at,
    windings,
)

DT: Final = 1e-6
"""Integration step [s]."""


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
    hold,
    steps,
    dt,
    lag,
    sampling: CurrentSampling,
    sample,
):
    """Advance the state by the ``steps`` steps of a sample.

    ``command`` is the angle at the start [rad], ``load`` the external torque against positive
    motion [N.m]; both grow by their slope in each step. ``disturbances`` is the noise on the
    reference current [A], each held for ``hold`` steps; the sample starts at their step ``first``.
    ``lag`` is ``lag_factor(dt)``; ``sampling`` makes the sample of the current of ``lag_3`` in the
    steps, ``sample`` is what the one before ended with. ``effects`` are those of hidden causes, or
    ``NoEffects``, and ``pauses`` the remaining dead times of the legs [steps]. Returns the new
    state, what the sample ends with and the new ``pauses``.
    """
    theta_m, omega, theta_b, i_a, i_b, i_c, q_a, q_b, q_c = x[:9]
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

        over_a = overshoot(q_a, i_a, I_ref * sector.s_a)
        over_b = overshoot(q_b, i_b, I_ref * sector.s_b)
        over_c = overshoot(q_c, i_c, I_ref * sector.s_c)
        if max(over_a, over_b, over_c) > h_b:
            q_a = -q_a if over_a > h_b else q_a
            q_b = -q_b if over_b > h_b else q_b
            q_c = -q_c if over_c > h_b else q_c
            pauses = pauses_at(effects, pauses, over_a > h_b, over_b > h_b, over_c > h_b, dt)

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

        i_a, i_b, i_c, pauses = phase_currents(
            effects,
            phases,
            pauses,
            half_voltage(effects, half_V, j * dt),
            omega,
            dt,
            q_a,
            q_b,
            q_c,
            i_a,
            i_b,
            i_c,
            k_a,
            k_b,
            k_c,
        )

        torque = clip(k_a * i_a + k_b * i_b + k_c * i_c, motor.T_max)
        sign = (1.0 if torque > 0.0 else 0.0) - (1.0 if torque < 0.0 else 0.0)
        equivalent = 0.5 * sign * (abs(i_a) + abs(i_b) + abs(i_c))
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
    state = State(
        theta_m,
        omega,
        theta_b,
        i_a,
        i_b,
        i_c,
        q_a,
        q_b,
        q_c,
        lag_1,
        lag_2,
        lag_3,
        integral,
        last_error,
        torque,
    )
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
    hold,
    steps,
    dt,
    lag,
    sampling: CurrentSampling,
    sample,
    current,
    position,
    speed,
):
    """Advance the state by ``n`` samples of ``steps`` steps and fill the telemetry columns.

    Command and load are interpolated linearly from the sample before (``last_command``,
    ``last_load``); a disturbance is held for ``hold`` steps. ``current``, ``position`` and
    ``speed`` are filled, all ``(n,)``. ``effects`` are the ``Courses`` of hidden causes, or
    ``NoEffects``. The new state, as a plain tuple, ``pauses`` and what the last sample of the
    current ended with are returned.
    """
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
            hold,
            steps,
            dt,
            lag,
            sampling,
            sample,
        )
        last_command = commands[k]
        last_load = loads[k]
        current[k] = sample / sampling.divisor
        position[k] = x.theta_b * mech.tau
        speed[k] = x.omega
    # Not the NamedTuple itself: to return one, numba runs Python code, and an interrupt during it
    # (Ctrl-C) crashes the process.
    return x[:], pauses, sample
