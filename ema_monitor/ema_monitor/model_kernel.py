"""Kernels of the monitor model: one equivalent phase, run for many fault vectors at once.

Individuals run in the lanes of `ema_core.simd`; the equation numbers are those of
``docs/model.md``.
"""

import math

from ema_core._jit import kernel
from ema_core.dynamics import (
    clip,
    follow_in_play,
    next_speed_of_lanes,
    reference_current,
    speed_error,
)
from ema_core.parameters import ControlConstants, MechanicalConstants
from ema_core.simd import broadcast, load, select, store
from ema_monitor.drives import (
    FastDrive,
    SourceDrive,
    drive_current,
    equivalent_current,
    pair_position,
)


@kernel()
def turned(cos, sin, angle):
    """Return cosine and sine after a small turn: their series, to 1e-13 for 0.02 rad."""
    square = angle * angle
    c = 1.0 - square * (0.5 - square * (1.0 / 24.0))
    s = angle * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0)))
    return c * cos - s * sin, c * sin + s * cos


@kernel()
def run_lanes(
    control: ControlConstants,
    drive_of_lanes: FastDrive | SourceDrive,
    mechanics: MechanicalConstants,
    play,
    first,
    command,
    position_0,
    speed_0,
    current_0,
    steps,
    dt,
    lag,
    current_correction,
    speed_correction,
    current,
    speed,
):
    """Run the individuals from ``first`` on, one a lane, and fill their rows of the response.

    ``current`` [A] and ``speed`` [rad/s] are ``(n_lanes, n)``; their corrections, ``(n,)``, are
    added. Constants that differ between individuals are arrays ``(n_lanes,)``, as is ``play``:
    where in its play the motor stands at the start, in half-widths of the backlash. ``command`` is
    ``(n + 1,)``: its first value belongs to the start, at which the user shaft stands at
    ``position_0`` [rad], the motor turns with ``speed_0`` [rad/s] and draws ``current_0`` [A].
    """
    c, drive, mech = load(control, first), load(drive_of_lanes, first), load(mechanics, first)
    theta_b = broadcast(position_0 / mech.tau)
    theta_m = theta_b + load(play, first) * mech.half_backlash
    cos, sin = math.cos(drive.waves * theta_m), math.sin(drive.waves * theta_m)
    omega = broadcast(speed_0)
    error = speed_error(c, command[0], position_0, omega)
    # What the integrator holds at the start shows only in the current.
    integral = broadcast(0.0)
    if c.GAI > 0.0:
        integral = (current_0 * c.k_t - c.GAP * error) / c.GAI
    I = reference_current(c, error, integral, error, 0.0, dt)
    equivalent = equivalent_current(drive, pair_position(drive.half_turns * theta_m), I)
    lag_1, lag_2, lag_3 = equivalent, equivalent, equivalent
    proportional = c.GAI == 0.0 and c.GAD == 0.0
    for k in range(current.shape[1]):
        total = broadcast(0.0)
        slope = (command[k + 1] - command[k]) / steps
        for j in range(steps):
            # An Euler step answers half a step too soon: the command is read half a step late.
            now = command[k] + (j - 0.5) * slope
            last_error = error
            error = speed_error(c, now, theta_b * mech.tau, omega)
            if proportional:
                I_ref = clip(c.GAP / c.k_t * error, c.I_max)
            else:
                I_ref = reference_current(c, error, integral, last_error, 0.0, dt)
                integral += dt * error
            position = pair_position(drive.half_turns * theta_m)
            I, torque, ripple = drive_current(drive, position, cos, sin, I, I_ref, omega)
            lag_1 += lag * (equivalent_current(drive, position, I) - lag_1)
            lag_2 += lag * (lag_1 - lag_2)
            lag_3 += lag * (lag_2 - lag_3)
            total += lag_3
            # The ripple of the PWM breaks the motor away below its static friction (M12).
            breakaway = max(mech.f_s - ripple, mech.f_d)
            omega = next_speed_of_lanes(mech, omega, torque, breakaway, dt)
            start = theta_m
            theta_m += dt * omega
            omega = select(abs(theta_m) > mech.theta_stop, 0.0, omega)
            theta_m = clip(theta_m, mech.theta_stop)
            cos, sin = turned(cos, sin, drive.waves * (theta_m - start))
            theta_b = follow_in_play(theta_b, theta_m, mech.half_backlash)
        store(current, first, k, total / steps + current_correction[k])
        store(speed, first, k, omega + speed_correction[k])
