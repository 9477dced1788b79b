# SPDX-License-Identifier: Apache-2.0
"""Kernel of the foreign actuator: currents by backward Euler, mechanics at a longer step.

The electrical equations have the step ``ELECTRIC_STEP``, with the resistive drop implicit. The
mechanical equations have the step ``MECHANIC_STEP``, with the mean torque of the electrical steps
and linearly implicit dry friction. The loops of the drive have a separate period. Quantities that
depend on an angle or on time are tables over one turn or period, which the caller chooses.
"""

import math
from typing import Final, NamedTuple

from ema_core._jit import kernel
from ema_core.parameters import ControlConstants, MechanicalConstants, MotorConstants

ELECTRIC_STEP: Final = 5e-7
"""Time step of the currents [s]."""

SUBSTEPS: Final = 4
"""Steps of the currents in one step of the mechanics [-]."""

MECHANIC_STEP: Final = SUBSTEPS * ELECTRIC_STEP
"""Time step of the mechanics [s]."""

_ZERO_CURRENT = 0.05
_THIRD_OF_A_TURN = 1.0 / 3.0


class Inverter(NamedTuple):
    """Parameters of the inverter and the digital drive.

    ``carrier`` 1 selects PWM with a carrier, 0 selects hysteresis control of the currents.
    ``period`` is the period of the loops, and of the carrier if there is one, in steps of the
    mechanics. ``gain`` [V/A] and ``integral_gain`` [V/(A.s)] belong to the current loops with a
    carrier. ``dead_steps`` is the dead time in steps of the currents. ``drop`` [V] and
    ``drop_resistance`` [ohm] give the voltage lost in a leg. ``source_resistance`` [ohm] is the
    resistance of the supply, ``link_lag`` [s] the time constant of the supply current.
    ``angle_resolution`` [rad, user shaft] and ``speed_resolution`` [rad/s] quantise the feedback.
    ``hall_a`` to ``hall_c`` displace the commutation [electrical turns]. ``open_a`` to ``open_c``
    are resistances in series with each phase [ohm]. ``dead_switch`` 1 keeps the upper switch of
    leg A open.
    """

    period: int
    carrier: float
    gain: float
    integral_gain: float
    dead_steps: int
    drop: float
    drop_resistance: float
    source_resistance: float
    link_lag: float
    angle_resolution: float
    speed_resolution: float
    hall_a: float
    hall_b: float
    hall_c: float
    open_a: float
    open_b: float
    open_c: float
    dead_switch: float


class Iron(NamedTuple):
    """Saturation of the iron.

    ``inductance_loss`` and ``torque_loss`` [-] are the relative losses per unit of ``saturation``,
    which counts up to 2. ``knee`` [A] is its reference current. With ``beyond`` 1 the losses begin
    at the knee; with 0 they grow with the square of the current.
    """

    inductance_loss: float
    torque_loss: float
    knee: float
    beyond: float


class Friction(NamedTuple):
    """Dry friction: ``bristle`` 0 for tanh(omega / ``omega_0``), 1 for LuGre.

    ``omega_s`` [rad/s] is the Stribeck speed. ``deflection`` [rad] is the deflection of the
    bristles at the dynamic friction, ``damping`` [-] their damping ratio.
    """

    bristle: float
    omega_0: float
    omega_s: float
    deflection: float
    damping: float


class Load(NamedTuple):
    """External load: ``stiffness`` [N.m/rad, user shaft]; ``jam`` 1 blocks the shaft."""

    stiffness: float
    jam: float


class Filter(NamedTuple):
    """Low-pass of the current sensor: time constants of two poles [s]; 0 for no pole."""

    first: float
    second: float


@kernel()
def looked_up(table, turn):
    """Return the value of a periodic table at an angle [turns], by linear interpolation.

    The last value of the table equals the first.
    """
    n = len(table) - 1
    x = (turn - math.floor(turn)) * n
    i = int(x)
    if i >= n:
        i = n - 1
    return table[i] + (x - i) * (table[i + 1] - table[i])


@kernel()
def hall(turn):
    """Return the output of a Hall sensor at its electrical angle [turns]: +1 or -1 for half a turn.

    Half the difference of two neighbouring sensors is the sign of the current in a phase. A phase
    is driven from 30 to 150 and from 210 to 330 degrees of its electrical angle. Two phases are
    driven at a time if each sensor is displaced by less than 30 degrees.
    """
    turn -= 1.0 / 12.0
    return 1.0 if turn - math.floor(turn) < 0.5 else -1.0


@kernel()
def leg_voltage(v, half, i, dead, width, stays_open):
    """Return the output voltage of a leg switched to ``v`` (+1, -1), against mid-supply [V].

    ``half`` is half of the supply [V]. During dead time (``dead`` > 0), or if the upper switch
    ``stays_open`` although ``v`` is +1, the voltage opposes the current ``i`` [A]; below ``width``
    [A] it is proportional to the current.
    """
    if dead > 0 or (stays_open and v > 0.0):
        # Both switches are open: the current flows through a diode, which opposes it.
        return -half * min(max(i / width, -1.0), 1.0)
    return v * half


@kernel()
def lost(inverter: Inverter, i):
    """Return the voltage lost in the conducting switch or diode at a current ``i`` [A], in V."""
    return inverter.drop * min(max(i / _ZERO_CURRENT, -1.0), 1.0) + inverter.drop_resistance * i


@kernel()
def saturation(iron: Iron, i):
    """Return the saturation of a phase [-]: 1 at the knee, or with ``beyond`` at twice the knee."""
    x = abs(i) / iron.knee
    return max(x - 1.0, 0.0) if iron.beyond > 0.0 else x * x


@kernel()
def rounded_to(x, resolution):
    """Return a value rounded to a resolution; a resolution of 0 does not round."""
    return resolution * math.floor(x / resolution + 0.5) if resolution > 0.0 else x


@kernel()
def simulate(
    control: ControlConstants,
    motor: MotorConstants,
    mech: MechanicalConstants,
    inverter: Inverter,
    iron: Iron,
    law: Friction,
    external: Load,
    sensor: Filter,
    emf,
    cogging,
    friction_by_turn,
    friction_slope,
    supply,
    supply_hz,
    supply_phase,
    start,
    commands,
    loads,
    disturbances,
    steps,
    current,
    position,
    speed,
):
    """Simulate the samples of a command from rest, and fill the columns of telemetry, ``(n,)``.

    ``emf`` is a table of the shape of the back-EMF over an electrical turn. The tables ``cogging``
    [N.m] and ``friction_by_turn`` [-] cover a turn of the motor, ``supply`` [-] a period of
    1/``supply_hz``. ``friction_slope`` [1/rad] is the relative change of friction with the position
    of the user shaft. ``start`` is the angle of the user shaft at rest [rad]. ``commands``
    [rad, user shaft] and ``loads`` [N.m, against positive motion of the motor] have a value per
    sample. ``supply_phase`` is the phase of the supply at the start [periods]. ``disturbances``
    [rad] are added to the position feedback, one per tick of the loops. A sample consists of
    ``steps`` steps of the mechanics.
    """
    h, H = ELECTRIC_STEP, MECHANIC_STEP
    R, L = 0.5 * motor.R_s, 0.5 * motor.L_s
    L_a, L_b, L_c = L * motor.N_a**2, L * motor.N_b**2, L * motor.N_c**2
    R_a = R * motor.N_a + inverter.open_a
    R_b = R * motor.N_b + inverter.open_b
    R_c = R * motor.N_c + inverter.open_c
    third = 2.0 * math.pi / 3.0
    theta = theta_b = start / mech.tau
    omega = 0.0
    z = 0.0
    i_a = i_b = i_c = 0.0
    q_a, q_b, q_c = 1.0, -1.0, 1.0
    dead_a = dead_b = dead_c = 0
    u_a = u_b = u_c = 0.0
    held_a = held_b = held_c = 0.0
    lag_1 = lag_2 = 0.0
    factor_1 = 1.0 if sensor.first <= 0.0 else -math.expm1(-H / sensor.first)
    factor_2 = 1.0 if sensor.second <= 0.0 else -math.expm1(-H / sensor.second)
    link = 0.0
    I_ref = 0.0
    integral = 0.0
    last_error = 0.0
    tick_s = inverter.period * H
    carrier_steps = inverter.period * SUBSTEPS
    tick = 0
    wait = 0
    carrier_step = 0
    before = start
    for k in range(len(commands)):
        total = 0.0
        for m in range(steps):
            now = (k * steps + m) * H
            turn = theta / (2.0 * math.pi)
            e_turn = motor.P * turn
            wave_a = looked_up(emf, e_turn)
            wave_b = looked_up(emf, e_turn - _THIRD_OF_A_TURN)
            wave_c = looked_up(emf, e_turn - 2.0 * _THIRD_OF_A_TURN)
            angle = theta + motor.phi
            half_k = 0.5 * motor.k_e
            k_a = half_k * motor.N_a * wave_a * (1.0 + motor.zeta * math.cos(angle))
            k_b = half_k * motor.N_b * wave_b * (1.0 + motor.zeta * math.cos(angle + third))
            k_c = half_k * motor.N_c * wave_c * (1.0 + motor.zeta * math.cos(angle + 2.0 * third))
            hall_a = hall(e_turn + inverter.hall_a)
            hall_b = hall(e_turn - _THIRD_OF_A_TURN + inverter.hall_b)
            hall_c = hall(e_turn - 2.0 * _THIRD_OF_A_TURN + inverter.hall_c)
            s_a = 0.5 * (hall_a - hall_b)
            s_b = 0.5 * (hall_b - hall_c)
            s_c = 0.5 * (hall_c - hall_a)

            half = 0.5 * motor.V_max * looked_up(supply, now * supply_hz + supply_phase)
            half -= 0.5 * inverter.source_resistance * link
            if wait == 0:
                command = before + (commands[k] - before) * m / steps
                seen = theta_b * mech.tau + disturbances[tick]
                seen = rounded_to(seen, inverter.angle_resolution)
                seen_omega = rounded_to(omega, inverter.speed_resolution)
                omega_ref = control.G_prop * (command - seen)
                omega_ref = min(max(omega_ref, -control.omega_max), control.omega_max)
                error = omega_ref - seen_omega
                integral += tick_s * error
                wanted = control.GAP * error + control.GAI * integral
                wanted += control.GAD * (error - last_error) / tick_s
                last_error = error
                I_ref = min(max(wanted / control.k_t, -control.I_max), control.I_max)
                tick += 1
                wait = inverter.period
                if inverter.carrier > 0.0:
                    # The drive feeds the back-EMF of a motor without faults forward.
                    miss_a, miss_b, miss_c = I_ref * s_a - i_a, I_ref * s_b - i_b, I_ref * s_c - i_c
                    held_a += inverter.integral_gain * tick_s * miss_a
                    held_b += inverter.integral_gain * tick_s * miss_b
                    held_c += inverter.integral_gain * tick_s * miss_c
                    most = 0.25 * motor.V_max
                    held_a = min(max(held_a, -most), most)
                    held_b = min(max(held_b, -most), most)
                    held_c = min(max(held_c, -most), most)
                    forward = half_k * seen_omega
                    u_a = (
                        inverter.gain * miss_a + held_a + forward * wave_a + R * I_ref * s_a
                    ) / half
                    u_b = (
                        inverter.gain * miss_b + held_b + forward * wave_b + R * I_ref * s_b
                    ) / half
                    u_c = (
                        inverter.gain * miss_c + held_c + forward * wave_c + R * I_ref * s_c
                    ) / half
                    carrier_step = 0
            wait -= 1

            torque = 0.0
            magnitude = 0.0
            drawn = 0.0
            for _ in range(SUBSTEPS):
                if inverter.carrier > 0.0:
                    ramp = 2.0 * abs(2.0 * carrier_step / carrier_steps - 1.0) - 1.0
                    carrier_step += 1
                    next_a = 1.0 if u_a > ramp else -1.0
                    next_b = 1.0 if u_b > ramp else -1.0
                    next_c = 1.0 if u_c > ramp else -1.0
                else:
                    next_a = -q_a if q_a * (i_a - I_ref * s_a) > motor.h_b else q_a
                    next_b = -q_b if q_b * (i_b - I_ref * s_b) > motor.h_b else q_b
                    next_c = -q_c if q_c * (i_c - I_ref * s_c) > motor.h_b else q_c
                dead_a = inverter.dead_steps if next_a != q_a else max(dead_a - 1, 0)
                dead_b = inverter.dead_steps if next_b != q_b else max(dead_b - 1, 0)
                dead_c = inverter.dead_steps if next_c != q_c else max(dead_c - 1, 0)
                q_a, q_b, q_c = next_a, next_b, next_c

                sat_a, sat_b, sat_c = (
                    saturation(iron, i_a),
                    saturation(iron, i_b),
                    saturation(iron, i_c),
                )
                now_a = L_a / h * (1.0 - iron.inductance_loss * min(sat_a, 2.0))
                now_b = L_b / h * (1.0 - iron.inductance_loss * min(sat_b, 2.0))
                now_c = L_c / h * (1.0 - iron.inductance_loss * min(sat_c, 2.0))
                # A diode must not reverse a small current within a step.
                width_a = max(_ZERO_CURRENT, 1.5 * half / now_a)
                width_b = max(_ZERO_CURRENT, 1.5 * half / now_b)
                width_c = max(_ZERO_CURRENT, 1.5 * half / now_c)
                v_a = leg_voltage(q_a, half, i_a, dead_a, width_a, inverter.dead_switch > 0.0)
                v_b = leg_voltage(q_b, half, i_b, dead_b, width_b, False)
                v_c = leg_voltage(q_c, half, i_c, dead_c, width_c, False)
                a = now_a * i_a + v_a - lost(inverter, i_a) - k_a * omega
                b = now_b * i_b + v_b - lost(inverter, i_b) - k_b * omega
                c = now_c * i_c + v_c - lost(inverter, i_c) - k_c * omega
                y_a, y_b, y_c = 1.0 / (now_a + R_a), 1.0 / (now_b + R_b), 1.0 / (now_c + R_c)
                star = (a * y_a + b * y_b + c * y_c) / (y_a + y_b + y_c)
                i_a, i_b, i_c = (a - star) * y_a, (b - star) * y_b, (c - star) * y_c

                loss = iron.torque_loss
                made = k_a * i_a * (1.0 - loss * min(sat_a, 2.0))
                made += k_b * i_b * (1.0 - loss * min(sat_b, 2.0))
                made += k_c * i_c * (1.0 - loss * min(sat_c, 2.0))
                torque += min(max(made, -motor.T_max), motor.T_max) / SUBSTEPS
                sign = math.copysign(0.5, made) if made != 0.0 else 0.0
                magnitude += sign * (abs(i_a) + abs(i_b) + abs(i_c)) / SUBSTEPS
                drawn += 0.5 * (q_a * i_a + q_b * i_b + q_c * i_c) / SUBSTEPS
            if inverter.link_lag > 0.0:
                link += H / inverter.link_lag * (drawn - link)
            lag_1 += factor_1 * (magnitude - lag_1)
            lag_2 += factor_2 * (lag_1 - lag_2)
            total += lag_2

            load = loads[k] + external.stiffness * theta_b * mech.tau
            net = torque - looked_up(cogging, turn) - load
            scale = looked_up(friction_by_turn, turn) + friction_slope * theta_b * mech.tau
            stribeck = math.exp(-((omega / law.omega_s) ** 2))
            level = scale * (mech.f_d + (mech.f_s - mech.f_d) * stribeck)
            if law.bristle > 0.0:
                stiffness = mech.f_d / law.deflection
                was = z
                z = (z + H * omega) / (1.0 + H * stiffness * abs(omega) / max(level, 1e-12))
                soft = 2.0 * law.damping * math.sqrt(stiffness * mech.J) * stribeck
                net -= stiffness * z + soft * (z - was) / H
                slope = mech.C
            else:
                s = math.tanh(omega / law.omega_0)
                net -= level * s
                slope = mech.C + level * (1.0 - s * s) / law.omega_0
            net -= mech.C * omega
            omega += H / mech.J * net / (1.0 + H / mech.J * slope)
            if external.jam > 0.0:
                omega = 0.0
            theta += H * omega
            theta_b = min(max(theta_b, theta - mech.half_backlash), theta + mech.half_backlash)
        before = commands[k]
        current[k] = total / steps
        position[k] = theta_b * mech.tau
        speed[k] = omega
