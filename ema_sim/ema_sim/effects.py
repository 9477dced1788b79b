# SPDX-License-Identifier: Apache-2.0
"""Effects of hidden causes in a step of the reference actuator.

The kernels come in pairs, without and with causes. numba selects a kernel at compilation by the
type of ``effects``, so that the code for causes does not slow down an actuator without causes. The
numbers (M20) to (M25) refer to equations in ``docs/model.md``.
"""

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numba.extending import overload
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from ema_core._jit import kernel
from ema_core.cause_profiles import Profile
from ema_core.causes import COPPER
from ema_core.dynamics import next_speed
from ema_core.parameters import MechanicalConstants, MotorConstants
from ema_sim.motor import Windings, star_currents, windings

STRIBECK_SPEED: Final = 10.0
"""Motor speed at which the Stribeck friction has fallen to 1/e [rad/s]."""

RIPPLE_FREQUENCY: Final = 2400.0
"""Frequency of the supply ripple: six pulses per period of a rectified 400 Hz supply [Hz]."""


OPEN: Final = 1e7
"""Resistance of an open phase in the implicit step, which cannot set a current to zero [ohm]."""


class NoEffects(NamedTuple):
    """Type of ``effects`` if there are no hidden causes."""


class Effects(NamedTuple):
    """Values of the hidden causes during a sample; names and units as in `ema_core.causes`.

    ``time`` is the start of the sample [s].
    """

    time: float
    load_torque: float
    load_stiffness: float
    torque_constant: float
    winding_temperature: float
    supply_voltage: float
    viscous_friction: float
    inertia: float
    dead_time: float
    cogging: float
    stribeck: float
    friction_ripple: float
    supply_ripple: float
    open_phase_a: float
    open_phase_b: float
    open_phase_c: float
    dead_switch: float
    jam: float


class Courses(NamedTuple):
    """Hidden causes over a block: one row per sample, one column per field of `Effects`."""

    rows: NDArray[np.float64]


NO_EFFECTS: Final = NoEffects()
NO_PAUSES: Final = (0.0, 0.0, 0.0)
"""Remaining dead times of the legs if no leg has switched recently [steps]."""

_FIELDS: Final = len(Effects._fields)


def courses(
    profiles: Mapping[str, Profile], sample_period: float, first: int, origin: int, n: int
) -> Courses | NoEffects:
    """Return the values of the hidden causes over a block, except sensor causes.

    The result is ``NO_EFFECTS`` if there are only sensor causes, or none. Each cause is constant
    over a sample, with its value at mid-sample.

    Parameters
    ----------
    profiles
        Hidden causes, keyed by name.
    sample_period
        Sample period [s].
    first
        Number of samples before the block.
    origin
        Number of samples before time 0 of the profiles.
    n
        Number of samples of the block.
    """
    inside = {name: profile for name, profile in profiles.items() if name in Effects._fields}
    if not inside:
        return NO_EFFECTS
    number = first + np.arange(n)
    middles = (number - origin + 0.5) * sample_period
    rows = np.zeros((n, _FIELDS))
    rows[:, Effects._fields.index("time")] = number * sample_period
    for name, profile in inside.items():
        rows[:, Effects._fields.index(name)] = profile.at(middles)
    return Courses(rows)


def _by_effects(without: Any, with_causes: Any) -> Any:
    """Return a function that selects one of two kernels by the type of its first argument."""

    def dispatch(effects, *arguments):
        raise NotImplementedError

    @overload(dispatch)
    def choose(effects, *arguments):
        chosen = without if effects.instance_class is NoEffects else with_causes
        return lambda effects, *arguments: chosen(effects, *arguments)

    return dispatch


@kernel()
def _still_none(effects: NoEffects, k):
    return effects


@kernel()
def effects_of_sample(effects: Courses, k):
    """Return the hidden causes during sample ``k`` of the block."""
    # pyright requires the first argument, which numba adds.
    return Effects(*to_fixed_tuple(effects.rows[k], _FIELDS))  # pyright: ignore[reportCallIssue]


@kernel()
def _same_plant(effects: NoEffects, motor, mech, phases):
    return motor, mech, phases


@kernel()
def changed_plant(
    effects: Effects, motor: MotorConstants, mech: MechanicalConstants, phases: Windings
):
    """Return motor, mechanics and windings as changed by hidden causes during a sample (M20)."""
    V_max = motor.V_max * (1.0 + effects.supply_voltage)
    k_e = motor.k_e * (1.0 + effects.torque_constant)
    R_s = motor.R_s * (1.0 + COPPER * effects.winding_temperature)
    motor = MotorConstants(V_max, motor.T_max, k_e, motor.G_M, R_s, *motor[5:])
    J, C = mech.J * (1.0 + effects.inertia), mech.C * (1.0 + effects.viscous_friction)
    mech = MechanicalConstants(J, C, *mech[2:])
    return motor, mech, windings(motor)


@kernel()
def _same_voltage(effects: NoEffects, half_V, time):
    return half_V


@kernel()
def rippled_voltage(effects: Effects, half_V, time):
    """Return half of the supply voltage [V], ``time`` [s] after the start of the sample (M21)."""
    if effects.supply_ripple == 0.0:
        return half_V
    angle = 2.0 * math.pi * RIPPLE_FREQUENCY * (effects.time + time)
    return half_V * (1.0 + effects.supply_ripple * math.sin(angle))


@kernel()
def _plain_speed(effects: NoEffects, mech, P, omega, torque, theta_m, theta_b, dt):
    return next_speed(mech, omega, torque, mech.f_s, dt)


@kernel()
def disturbed_speed(
    effects: Effects, mech: MechanicalConstants, P, omega, torque, theta_m, theta_b, dt
):
    """Return the motor speed [rad/s] after a step with load, cogging and friction (M22, M23).

    ``torque`` is the motor torque minus the external load [N.m].
    """
    if effects.jam != 0.0:
        return 0.0
    torque -= effects.load_torque + effects.load_stiffness * mech.tau * theta_b
    if effects.cogging != 0.0:
        torque -= effects.cogging * math.sin(6.0 * P * theta_m)
    f_s, f_d = mech.f_s, mech.f_d
    if effects.stribeck != 0.0:
        f_d *= 1.0 + effects.stribeck * math.exp(-abs(omega) / STRIBECK_SPEED)
    if effects.friction_ripple != 0.0:
        ripple = 1.0 + effects.friction_ripple * math.sin(theta_m)
        f_s *= ripple
        f_d *= ripple
    mech = MechanicalConstants(mech.J, mech.C, f_s, f_d, *mech[4:])
    return next_speed(mech, omega, torque, max(f_s, f_d), dt)


@kernel()
def _same_resistances(effects: NoEffects, R_a, R_b, R_c):
    return R_a, R_b, R_c


@kernel()
def opened_resistances(effects: Effects, R_a, R_b, R_c):
    """Return the phase resistances [ohm]; an open phase carries almost no current (M25)."""
    return (
        R_a + (OPEN if effects.open_phase_a != 0.0 else 0.0),
        R_b + (OPEN if effects.open_phase_b != 0.0 else 0.0),
        R_c + (OPEN if effects.open_phase_c != 0.0 else 0.0),
    )


@kernel()
def _no_pauses(effects: NoEffects, pauses, switches, dt):
    return pauses


@kernel()
def pauses_after(effects: Effects, pauses, switches, dt):
    """Return the remaining dead times of the legs [steps] after some legs have switched (M24)."""
    # Rounding to a thousandth of a step removes the rounding error of the quotient.
    pause = round(1e3 * effects.dead_time / dt) / 1e3
    return (
        pause if switches[0] else pauses[0],
        pause if switches[1] else pauses[1],
        pause if switches[2] else pauses[2],
    )


@kernel()
def leg_voltage(q, i, half_V, off):
    """Return the voltage [V] of a leg whose switches are both open for a share of the step (M24).

    During the share ``off`` of the step, the current flows through a diode; the sign of the current
    determines which.
    """
    diode = (half_V if i < 0.0 else 0.0) - (half_V if i > 0.0 else 0.0)
    return off * diode + (1.0 - off) * half_V * q


@kernel()
def undisturbed_currents(effects: Effects | NoEffects, phases, pauses, half_V, omega, dt, q, i, k):
    """Return phase currents [A] and ``pauses`` after a step in which no leg is interrupted (M4).

    There is no open phase, no dead switch and no remaining dead time. ``effects`` is not read, and
    ``pauses``, the remaining dead times of the legs [steps], are unchanged.
    ``half_V`` is half of the supply voltage [V], ``omega`` the motor speed [rad/s] and ``dt`` the
    step [s]. ``q``, ``i`` and ``k`` are the switching states (+1 or -1), currents [A] and back-EMF
    constants [V.s/rad] of the phases.
    """
    v_a = half_V * q[0] - phases.R_a * i[0] - k[0] * omega
    v_b = half_V * q[1] - phases.R_b * i[1] - k[1] * omega
    v_c = half_V * q[2] - phases.R_c * i[2] - k[2] * omega
    return star_currents(phases, dt, (v_a, v_b, v_c), i), pauses


@kernel()
def disturbed_currents(effects: Effects, phases, pauses, half_V, omega, dt, q, i, k):
    """Return phase currents [A] and remaining dead times [steps] after a step (M24, M25).

    The arguments are as in `undisturbed_currents`. Rare cases have a separate function, so that
    this function is short enough to be inlined.
    """
    opens = effects.open_phase_a + effects.open_phase_b + effects.open_phase_c
    if opens + effects.dead_switch + pauses[0] + pauses[1] + pauses[2] == 0.0:
        return undisturbed_currents(effects, phases, pauses, half_V, omega, dt, q, i, k)
    off_a = 1.0 if effects.dead_switch != 0.0 and q[0] > 0.0 else min(pauses[0], 1.0)
    offs = off_a, min(pauses[1], 1.0), min(pauses[2], 1.0)
    pauses = max(pauses[0] - 1.0, 0.0), max(pauses[1] - 1.0, 0.0), max(pauses[2] - 1.0, 0.0)
    open_phases = effects.open_phase_a, effects.open_phase_b, effects.open_phase_c
    emf = k[0] * omega, k[1] * omega, k[2] * omega
    return interrupted_currents(open_phases, offs, phases, half_V, dt, q, i, emf), pauses


@kernel()
def interrupted_currents(opens, offs, phases: Windings, half_V, dt, q, i, emf):
    """Return phase currents [A] after a step in which legs or phases are interrupted (M24, M25).

    ``opens`` is nonzero for open phases, ``offs`` is the share of the step in which both switches
    of a leg are open; ``q``, ``i`` and ``emf`` are switching states, currents [A] and induced
    voltages of the phases [V].
    """
    (i_a, i_b, i_c), (off_a, off_b, off_c) = i, offs
    open_a, open_b, open_c = opens[0] != 0.0, opens[1] != 0.0, opens[2] != 0.0
    u_a = leg_voltage(q[0], i_a, half_V, off_a)
    u_b = leg_voltage(q[1], i_b, half_V, off_b)
    u_c = leg_voltage(q[2], i_c, half_V, off_c)
    floats_a = off_a == 1.0 and i_a == 0.0
    floats_b = off_b == 1.0 and i_b == 0.0
    floats_c = off_c == 1.0 and i_c == 0.0
    v_a = u_a - phases.R_a * i_a - emf[0]
    v_b = u_b - phases.R_b * i_b - emf[1]
    v_c = u_c - phases.R_c * i_c - emf[2]
    g_a = 0.0 if open_a or floats_a else dt / phases.L_a
    g_b = 0.0 if open_b or floats_b else dt / phases.L_b
    g_c = 0.0 if open_c or floats_c else dt / phases.L_c
    v_n = _star_voltage(g_a, g_b, g_c, v_a, v_b, v_c)
    # A diode drives a leg without current if its terminal would exceed the supply voltage.
    if floats_a and not open_a and abs(v_n + emf[0]) > half_V:
        u_a = math.copysign(half_V, v_n + emf[0])
        v_a, g_a = v_a + u_a, dt / phases.L_a
    if floats_b and not open_b and abs(v_n + emf[1]) > half_V:
        u_b = math.copysign(half_V, v_n + emf[1])
        v_b, g_b = v_b + u_b, dt / phases.L_b
    if floats_c and not open_c and abs(v_n + emf[2]) > half_V:
        u_c = math.copysign(half_V, v_n + emf[2])
        v_c, g_c = v_c + u_c, dt / phases.L_c
    v_n = _star_voltage(g_a, g_b, g_c, v_a, v_b, v_c)
    i_a += g_a * (v_a - v_n)
    i_b += g_b * (v_b - v_n)
    i_c += g_c * (v_c - v_n)
    # A diode blocks reverse current; a break blocks all current of its phase.
    if open_a or (off_a == 1.0 and i_a * u_a > 0.0):
        i_a = g_a = 0.0
    if open_b or (off_b == 1.0 and i_b * u_b > 0.0):
        i_b = g_b = 0.0
    if open_c or (off_c == 1.0 and i_c * u_c > 0.0):
        i_c = g_c = 0.0
    total = g_a + g_b + g_c
    excess = (i_a + i_b + i_c) / total if total > 0.0 else 0.0
    return i_a - g_a * excess, i_b - g_b * excess, i_c - g_c * excess


@kernel()
def _star_voltage(g_a, g_b, g_c, v_a, v_b, v_c):
    """Return the star-point voltage [V]: the mean of the phases, weighted with ``g`` (M24)."""
    total = g_a + g_b + g_c
    return (g_a * v_a + g_b * v_b + g_c * v_c) / total if total > 0.0 else 0.0


effects_at: Final = _by_effects(_still_none, effects_of_sample)
resistances_at: Final = _by_effects(_same_resistances, opened_resistances)
plant_at: Final = _by_effects(_same_plant, changed_plant)
pauses_at: Final = _by_effects(_no_pauses, pauses_after)
half_voltage: Final = _by_effects(_same_voltage, rippled_voltage)
phase_currents: Final = _by_effects(undisturbed_currents, disturbed_currents)
motor_speed: Final = _by_effects(_plain_speed, disturbed_speed)
