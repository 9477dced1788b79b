# SPDX-License-Identifier: Apache-2.0
"""Consistency checks for coupled parameters of an actuator description.

If a user changes one parameter of the built-in example but not the parameters that depend on it,
the description fits no real actuator. Each coupling is a ratio with its usual range. A ratio
outside its range causes a remark with the parameters to check, not an error, because an actuator
may be unusual.

The checks need no telemetry, and include parameters that do not affect the motion.
`ema_monitor.calibration.description_misfit` needs healthy telemetry, and finds parameters that
agree with each other but not with the motion.
"""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from ema_core.parameters import ActuatorParameters

TORQUE_PER_EMF: Final = {"six_step": 1.0, "field_oriented": math.sqrt(3.0) / 2.0}
"""Ratio of torque constant to back-EMF constant by drive [-].

Both constants are defined between two terminals. Six-step commutation drives two phases in series.
The current of field-oriented control is the amplitude i_q of the phase currents: the torque
constant is 3/2 P lambda, the back-EMF constant sqrt(3) P lambda (M33)."""


class _Coupling(NamedTuple):
    """A ratio of parameters, its usual range, and the remark for values outside the range."""

    name: str
    ratio: Callable[[ActuatorParameters], float]
    lowest: float
    highest: float
    remark: str
    unit: str = ""


def _over(numerator: float, denominator: float) -> float:
    """Return a quotient, or NaN (no coupling) if the denominator is not positive."""
    return numerator / denominator if denominator > 0.0 else math.nan


_COUPLINGS: Final = (
    _Coupling(
        "T_max / (k_t I_max)",
        lambda p: p.T_max / (p.k_t * p.I_max),
        0.7,
        1.5,
        "the torque limit is about the torque of the largest current",
    ),
    _Coupling(
        "V_max / (k_e omega_max)",
        lambda p: p.V_max / (p.k_e * p.omega_max),
        0.6,
        3.0,
        "beyond V_max / k_e the supply drives no current",
    ),
    _Coupling(
        "R_s I_max / V_max",
        lambda p: p.R_s * p.I_max / p.V_max,
        0.005,
        1.1,
        "at rest the supply drives at most V_max / R_s",
    ),
    _Coupling(
        "(f_sm + f_su) / T_max",
        lambda p: (p.f_sm + p.f_su) / p.T_max,
        0.003,
        0.4,
        "the static friction, referred to the motor shaft, is part of the torque",
    ),
    _Coupling(
        "(C_m + C_u) omega_max / T_max",
        lambda p: (p.C_m + p.C_u) * p.omega_max / p.T_max,
        0.0,
        0.4,
        "the viscous friction at full speed is part of the torque",
    ),
    _Coupling(
        "(J_m + J_u) omega_max / T_max",
        lambda p: (p.J_m + p.J_u) * p.omega_max / p.T_max,
        1e-3,
        0.5,
        "the time to full speed; a load inertia on the user shaft counts tau^2 times at the motor",
        "s",
    ),
    _Coupling(
        "GAP / (J_m + J_u)",
        lambda p: _over(p.GAP, p.J_m + p.J_u),
        50.0,
        1e4,
        "the bandwidth of the speed loop: its gain follows the inertia",
        "rad/s",
    ),
    _Coupling(
        "G_prop tau (J_m + J_u) / GAP",
        lambda p: _over(p.G_prop * p.tau * (p.J_m + p.J_u), p.GAP),
        5e-3,
        0.6,
        "the ratio of the bandwidths of position loop and speed loop",
    ),
)

_SIX_STEP_COUPLINGS: Final = (
    _Coupling(
        "G_M / k_t",
        lambda p: p.G_M / p.k_t,
        0.7,
        1.3,
        "the torque gain of the source form is about the torque constant",
    ),
    _Coupling(
        "h_b / I_max",
        lambda p: p.h_b / p.I_max,
        2e-3,
        0.15,
        "the current ripples by its hysteresis, a few per cent of its limit",
    ),
    _Coupling(
        "k_e h_b / (f_sm + f_su)",
        lambda p: _over(p.k_e * p.h_b, p.f_sm + p.f_su),
        0.0,
        0.7,
        "the torque ripple of the hysteresis breaks the motor away below its static friction",
    ),
    _Coupling(
        "V_max / (8 L_s h_b)",
        lambda p: p.V_max / (8.0 * p.L_s * p.h_b),
        1e3,
        2e5,
        "the frequency at which the inverter switches",
        "Hz",
    ),
)


def _with_unit(value: float, unit: str = "") -> str:
    return f"{float(f'{value:.3g}'):.12g} {unit}".strip()


def torque_per_current(parameters: ActuatorParameters, drive: str) -> float:
    """Return the torque constant [N.m/A] of a healthy motor, computed from its back-EMF constant.

    ``drive`` is a key of `TORQUE_PER_EMF`.
    """
    return TORQUE_PER_EMF[drive] * parameters.k_e


def standstill(parameters: ActuatorParameters, drive: str) -> str:
    """Return why the described actuator can never move, or "" if it can move."""
    p = parameters
    if drive not in TORQUE_PER_EMF:
        return ""
    K, f_s = torque_per_current(p, drive), p.f_sm + p.f_su
    torque = min(p.T_max, K * p.I_max, K * p.V_max / p.R_s)
    if torque > f_s:
        return ""
    return (
        f"f_sm + f_su = {f_s:.3g} N.m: the motor, with k_e, I_max, T_max and V_max / R_s, produces "
        f"at most {torque:.3g} N.m and never moves"
    )


def remarks(parameters: ActuatorParameters, drive: str) -> tuple[str, ...]:
    """Return a sentence for each contradiction between coupled parameters of an actuator.

    Drives with an unknown controller are not checked because most parameters are unused.
    """
    p = parameters
    if drive not in TORQUE_PER_EMF:
        return ()
    usual = TORQUE_PER_EMF[drive]
    of_drive = _Coupling(
        "k_t / k_e",
        lambda p: p.k_t / p.k_e,
        0.9 * usual,
        1.1 * usual,
        f"of a {drive.replace('_', '-')} drive it is {usual:.3g}, k_t in N.m/A and k_e in V.s/rad "
        "between two terminals",
    )
    couplings = (of_drive, *_COUPLINGS, *(_SIX_STEP_COUPLINGS if drive == "six_step" else ()))
    unusual = []
    for coupling in couplings:
        ratio = coupling.ratio(p)
        if ratio < coupling.lowest or ratio > coupling.highest:
            usual_range = (
                f"{_with_unit(coupling.lowest)} to {_with_unit(coupling.highest, coupling.unit)}"
            )
            unusual.append(
                f"{coupling.name} = {_with_unit(ratio, coupling.unit)}, usually {usual_range}: "
                f"{coupling.remark}"
            )
    return tuple(unusual)
