# SPDX-License-Identifier: Apache-2.0
"""Kernels of the one-phase monitor model, vectorized over fault vectors.

Each fault vector occupies one lane of `ema_core.simd`; the equation numbers refer to
``docs/model.md``.
"""

import math
from typing import Any, Final, NamedTuple

from ema_core._jit import kernel
from ema_core.dynamics import (
    CurrentSampling,
    clip,
    follow_in_play,
    next_speed_of_lanes,
    reference_current,
    speed_error,
)
from ema_core.parameters import ControlConstants, MechanicalConstants
from ema_core.simd import any_lane, broadcast, load, select, store
from ema_monitor.model.drives import (
    FastDrive,
    SourceDrive,
    currents_at_rest,
    drive_current,
    equivalent_current,
    first_stage,
    next_stage,
)
from ema_monitor.model.field_oriented import FieldOrientedDrive

_RIPPLE_SPEED_SQUARE: Final = 0.1**2
"""Square of the speed that the PWM ripple causes in a motor at rest [rad^2/s^2]."""


class ShaftConstants(NamedTuple):
    """Load and Stribeck friction at the motor shaft, in addition to the nominal mechanics.

    ``torque`` [N.m] and ``stiffness`` per user angle [N.m/rad] describe a load;
    ``stribeck_speed`` [rad/s] is the speed at which the excess of static over dynamic friction has
    fallen to a quarter.
    """

    torque: Any
    stiffness: Any
    stribeck_speed: Any


class ModelState(NamedTuple):
    """State of the monitor model between two steps; each field is a vector of lanes.

    ``theta_m`` [rad] and ``omega`` [rad/s] belong to the motor shaft, ``cos`` and ``sin`` to the
    angle of the eccentricity. ``theta_b`` [rad] is the fast-shaft angle on the user side of the
    backlash. ``I`` is the current [A], together with the integral of its loop [V] if there is one.
    ``integral`` [rad] and ``error`` [rad/s] belong to the speed loop.
    """

    theta_m: Any
    cos: Any
    sin: Any
    omega: Any
    theta_b: Any
    I: Any
    integral: Any
    error: Any


@kernel()
def rotate(cos, sin, angle):
    """Return cosine and sine after a rotation by up to 0.02 rad, by series, accurate to 1e-13."""
    square, d_cos, d_sin = angle * angle, angle * cos, angle * sin
    c = square * (0.5 - square * (1.0 / 24.0))
    s = square * (1.0 / 6.0 - square * (1.0 / 120.0))
    # A short chain of dependent operations, because the next step depends on the result.
    return cos - d_sin - c * cos + s * d_sin, sin + d_cos - c * sin - s * d_cos


@kernel()
def advance(
    c: ControlConstants,
    drive: FastDrive | SourceDrive | FieldOrientedDrive,
    mech: MechanicalConstants,
    x: ModelState,
    stage,
    speed_loop,
    command,
    opposing,
    friction,
    dt,
):
    """Return the state after one step of ``dt`` [s] under a ``command`` [rad].

    ``stage`` depends on the drive: the constants of the driven pair (`FastDrive`), the position of
    the motor angle in the cycle of pairs, 0 to 1 (`SourceDrive`), or 0 (`FieldOrientedDrive`).
    ``opposing`` is the load torque against positive motion and ``friction`` the dry friction
    in motion [N.m]. ``speed_loop`` is None for a proportional speed loop, which has no state.
    """
    error = speed_error(c, command, x.theta_b * mech.tau, x.omega)
    integral = x.integral
    if speed_loop is None:
        I_ref = clip(c.GAP / c.k_t * error, c.I_max)
    else:
        I_ref = reference_current(c, error, integral, x.error, 0.0, dt)
        integral += dt * error
    I, torque, ripple = drive_current(drive, stage, x.cos, x.sin, x.I, I_ref, x.omega)
    # The ripple of the PWM reduces the breakaway torque below the static friction (M12).
    breakaway = max(mech.f_s - ripple, friction)
    omega = next_speed_of_lanes(mech, x.omega, torque, opposing, breakaway, friction, dt)
    theta_m, angle = x.theta_m + dt * omega, drive.waves * dt * omega
    if any_lane(abs(theta_m) > mech.theta_stop):
        omega = select(abs(theta_m) > mech.theta_stop, 0.0, omega)
        theta_m = clip(theta_m, mech.theta_stop)
        angle = drive.waves * (theta_m - x.theta_m)
    cos, sin = rotate(x.cos, x.sin, angle)
    theta_b = follow_in_play(x.theta_b, theta_m, mech.half_backlash)
    return ModelState(theta_m, cos, sin, omega, theta_b, I, integral, error)


@kernel()
def run_lanes(
    control: ControlConstants,
    drive_of_lanes: FastDrive | SourceDrive | FieldOrientedDrive,
    mechanics: MechanicalConstants,
    shaft_of_lanes: ShaftConstants,
    play,
    first,
    command,
    position_0,
    speed_0,
    current_0,
    speed_loop,
    steps,
    dt,
    lag,
    sampling: CurrentSampling,
    of_shaft,
    corrections,
    response,
):
    """Simulate `LANES` individuals, beginning at row ``first``, and store their responses.

    ``response`` is current [A] and speed [rad/s], ``(n_lanes, n)`` each; ``corrections``, ``(n,)``
    each, are added. Constants that differ between individuals are arrays, ``(n_lanes,)``. So are
    the initial positions: ``play`` of the motor within the backlash [half-widths], and
    ``position_0`` of the user shaft [rad]. ``command`` is ``(n + 1,)`` and begins with the command
    at the start. The initial state of the motor is ``speed_0`` [rad/s] and ``current_0`` [A].
    ``speed_loop`` is None for a proportional speed loop; ``sampling`` holds the constants for the
    sampling of the current. If ``of_shaft``, the speed is the mean speed of the fast shaft behind
    the play over a sample. Otherwise it is the motor speed at the end of the sample.
    """
    (current_correction, speed_correction), (current, speed) = corrections, response
    c, drive, mech = load(control, first), load(drive_of_lanes, first), load(mechanics, first)
    shaft = load(shaft_of_lanes, first)
    stiffness = shaft.stiffness * mech.tau
    stribeck_square = shaft.stribeck_speed * shaft.stribeck_speed
    user = load(position_0, first)
    theta_b = user / mech.tau
    theta_m = theta_b + load(play, first) * mech.half_backlash
    angle = drive.waves * theta_m
    omega = broadcast(speed_0)
    error = speed_error(c, command[0], user, omega)
    # The initial integral follows from the measured current.
    integral = broadcast(0.0)
    if c.GAI > 0.0:
        integral = (current_0 * c.k_t - c.GAP * error) / c.GAI
    I = currents_at_rest(drive, reference_current(c, error, integral, error, 0.0, dt))
    x = ModelState(theta_m, math.cos(angle), math.sin(angle), omega, theta_b, I, integral, error)
    stage = first_stage(drive, theta_m)
    equivalent = equivalent_current(drive, stage, I)
    lag_1, lag_2, lag_3 = equivalent, equivalent, equivalent
    sample = broadcast(current_0)
    for k in range(current.shape[1]):
        sample *= sampling.carry
        before = x.theta_b
        slope = (command[k + 1] - command[k]) / steps
        for j in range(steps):
            stage = next_stage(drive, stage, x.theta_m)
            # An Euler step responds half a step too early: delay the command by half a step.
            delayed = command[k] + (j - 0.5) * slope
            opposing = shaft.torque + stiffness * x.theta_b
            square = x.omega * x.omega + _RIPPLE_SPEED_SQUARE
            slowness = stribeck_square / (stribeck_square + square)
            friction = mech.f_d + (mech.f_s - mech.f_d) * slowness * slowness
            x = advance(c, drive, mech, x, stage, speed_loop, delayed, opposing, friction, dt)
            lag_1 += lag * (equivalent_current(drive, stage, x.I) - lag_1)
            lag_2 += lag * (lag_1 - lag_2)
            lag_3 += lag * (lag_2 - lag_3)
            sample = sampling.keep * sample + sampling.gain * lag_3
        store(current, first, k, sample / sampling.divisor + current_correction[k])
        omega = (x.theta_b - before) / (steps * dt) if of_shaft else x.omega
        store(speed, first, k, omega + speed_correction[k])
