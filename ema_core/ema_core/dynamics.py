# SPDX-License-Identifier: Apache-2.0
"""Kernels shared by the reference and monitor models: controller, mechanics, filter.

They accept single floats and lanes of `ema_core.simd`, except where a docstring states otherwise.
"""

import math
from typing import Final, NamedTuple

from ema_core._jit import kernel
from ema_core.acquisition import Acquisition
from ema_core.parameters import ControlConstants, MechanicalConstants
from ema_core.simd import select

LAG_TIME_CONSTANT: Final = 1e-5
"""Time constant of each of the three lags that filter the equivalent current [s]."""


def lag_factor(dt: float) -> float:
    """Return the fraction by which a first-order lag approaches its input per step ``dt`` [s].

    The factor is exact for an input that is constant over the step, so that models with different
    steps delay the current by the same time.
    """
    return -math.expm1(-dt / LAG_TIME_CONSTANT)


class CurrentSampling(NamedTuple):
    """Constants for the computation of current samples from the values at the steps (M6).

    A sample starts from ``carry`` times the final state of the previous sample. Each step updates
    the state to ``keep`` times the state plus ``gain`` times the value. The sample is the final
    state divided by ``divisor``.
    """

    carry: float
    keep: float
    gain: float
    divisor: float


def current_sampling(acquisition: Acquisition, steps: int, dt: float) -> CurrentSampling:
    """Return the constants for samples of ``steps`` steps of ``dt`` [s] each.

    If the current is not measured, the constants are those for averaging.
    """
    if acquisition.current == "instantaneous":
        return CurrentSampling(0.0, 0.0, 1.0, 1.0)
    if acquisition.current == "filtered":
        keep = math.exp(-dt / acquisition.current_filter)
        return CurrentSampling(1.0, keep, -math.expm1(-dt / acquisition.current_filter), 1.0)
    return CurrentSampling(0.0, 1.0, 1.0, float(steps))


@kernel()
def clip(x, limit):
    """Return ``x`` limited to the range from ``-limit`` to ``limit``."""
    return min(max(x, -limit), limit)


@kernel()
def speed_error(c: ControlConstants, command, theta_user, omega):
    """Return the speed error [rad/s]: reference from the position loop minus ``omega`` (M1)."""
    return clip(c.G_prop * (command - theta_user), c.omega_max) - omega


@kernel()
def reference_current(c: ControlConstants, error, integral, last_error, disturbance, dt):
    """Return the reference current [A] of the speed loop for a speed error [rad/s] (M1).

    ``integral`` is the integral of the error [rad], ``last_error`` the error one step before
    [rad/s]; ``disturbance`` [A] is added before the limit.
    """
    torque = c.GAP * error + c.GAI * integral + c.GAD * (error - last_error) / dt
    return clip(torque / c.k_t + disturbance, c.I_max)


@kernel()
def next_speed(m: MechanicalConstants, omega, torque, breakaway, dt):
    """Return the motor speed [rad/s] after a step with friction (M7).

    ``torque`` is the motor torque minus the load [N.m]. Friction follows Borello's model: at rest
    it balances any torque up to ``breakaway`` (at least ``f_d``), in motion it opposes the motion
    with ``f_d``, and a step that would cross zero speed ends at zero. For single floats only.
    """
    net = torque - m.C * omega
    if omega == 0.0:
        if abs(net) <= breakaway:
            return 0.0
        return dt / m.J * (net - math.copysign(m.f_d, net))
    stepped = omega + dt / m.J * (net - math.copysign(m.f_d, omega))
    return 0.0 if stepped * omega < 0.0 else stepped


@kernel()
def next_speed_of_lanes(m: MechanicalConstants, omega, torque, load, breakaway, friction, dt):
    """Return the motor speed [rad/s] after a step, as `next_speed` but without branches (M7).

    ``friction`` is the dynamic friction, and ``load`` opposes the motor's ``torque`` [N.m]. Lanes
    cannot branch; the reference actuator uses single floats and is 6 % faster with branches. The
    expressions that do not need the torque come first, because the torque is computed last.
    """
    drag = load + m.C * omega + math.copysign(friction, omega)
    moved = omega + dt / m.J * (torque - drag)
    net = torque - load
    started = select(abs(net) <= breakaway, 0.0, dt / m.J * (net - math.copysign(friction, net)))
    stepped = select(omega > 0.0, max(moved, 0.0), min(moved, 0.0))
    return select(omega == 0.0, started, stepped)


@kernel()
def follow_in_play(theta_out, theta_motor, half_backlash):
    """Return the fast-shaft angle [rad] after the backlash, for a motor angle (M8).

    ``theta_out`` is the fast-shaft angle before the step.
    """
    return min(max(theta_out, theta_motor - half_backlash), theta_motor + half_backlash)
