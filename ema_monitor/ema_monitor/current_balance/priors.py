"""What is known of the terms and loads of a motion before it (M41, M45)."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.parameters import ActuatorParameters
from ema_monitor.current_balance.balance import Balance
from ema_monitor.current_balance.fitting import BalancePrior
from ema_monitor.current_balance.terms import BASIC, OF_CURRENT, columns_of, ripples
from ema_monitor.current_balance.unit import UnknownDriveUnit
from ema_monitor.windows.window import Window

_FREE: Final = 0.5
_LOAD: Final = 0.2
_LATER_S: Final = 3e-4

Known = tuple[tuple[float, float], tuple[float, float]]
"""Value and sigma of load [A] and stiffness [A/rad]."""


def taken_for_known_loads(window: Window, parameters: ActuatorParameters) -> Known:
    """Return load and stiffness that were measured beside a window; sigma is infinite otherwise.

    They are torques: the described torque constant makes amperes of them.
    """
    by_name = {one.name: one for one in window.measured}
    load, stiffness = (
        (by_name[name].value / parameters.k_t, by_name[name].sigma / parameters.k_t)
        if name in by_name
        else (0.0, math.inf)
        for name in ("load_torque", "load_stiffness")
    )
    return load, stiffness


def load_sigmas(parameters: ActuatorParameters, balances: Sequence[Balance]) -> NDArray[np.float64]:
    """Return what loads are usual, ``(balances, 2)`` [A, A/rad]: a fifth of the largest current."""
    strongest = max(float(np.max(np.abs(one.current), initial=0.0)) for one in balances)
    usual = max(_LOAD * parameters.I_max, strongest)
    return np.array([[usual, usual / max(one.travel, 1e-9)] for one in balances])


def prior_of(
    unit: UnknownDriveUnit,
    balances: Sequence[Balance],
    windows: Sequence[Window],
    *,
    inertia_sigma: float = _FREE,
) -> BalancePrior:
    """Return what a calibration says of motions to be monitored.

    Parameters
    ----------
    unit
        The calibration.
    balances, windows
        The motions.
    inertia_sigma
        Relative standard deviation of the inertia over the torque per ampere.
    """
    mean, sigma = unit.terms.copy(), np.empty(len(unit.terms))
    friction = unit.terms[1]
    measured = {one.name: one for one in windows[0].measured}
    sigma[0] = inertia_sigma * unit.terms[0]
    sigma[1] = 3.0 * friction
    sigma[2] = max(abs(unit.terms[2]), 0.15 * friction / unit.fastest)
    if "viscous_friction" in measured:
        sigma[2] = max(measured["viscous_friction"].sigma * abs(unit.terms[2]), 1e-9)
        mean[2] *= 1.0 + measured["viscous_friction"].value
    changed = 0.3 * abs(unit.terms[3]) + 0.01 * friction
    sigma[3] = math.hypot(changed, math.sqrt(unit.covariance[3, 3]))
    sigma[4] = _LATER_S
    groups = ripples(unit.parameters.P)
    where = columns_of(groups)
    mean[unit.ripple("turn")] = 0.0  # part of the friction: `of_unit`
    for group in groups:
        sigma[where[group.name]] = _FREE if group.scales_with == OF_CURRENT else _FREE * friction
    loads, spreads = [], []
    for window, usual in zip(windows, load_sigmas(unit.parameters, balances), strict=True):
        known = taken_for_known_loads(window, unit.parameters)
        loads.append([unit.load + known[0][0], unit.stiffness + known[1][0]])
        spreads.append([min(known[0][1], usual[0]), min(known[1][1], usual[1])])
    return BalancePrior(mean, sigma, np.array(loads), np.array(spreads))


def of_unit(balance: Balance, unit: UnknownDriveUnit) -> Balance:
    """Return a balance in which friction varies over a turn as that of the healthy unit does.

    Where it grows, it grows by the same factor everywhere.
    """
    design = balance.design.copy()
    design[:, 1] += design[:, unit.ripple("turn")] @ unit.terms[unit.ripple("turn")] / unit.terms[1]
    return replace(balance, design=design)


def basic_terms(size: int) -> NDArray[np.bool_]:
    """Return which of the terms are the basic ones."""
    return np.arange(size) < len(BASIC)
