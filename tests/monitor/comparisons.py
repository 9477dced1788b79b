# SPDX-License-Identifier: Apache-2.0
"""Synthetic comparisons of a record with its baseline, and estimates that contain them."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ema_core.causes import CauseEstimate
from ema_core.faults import FAULT_NAMES, N_FAULTS, FaultVector
from ema_monitor.identification.estimate import INVERSE_DYNAMICS, Estimate, Verdict
from ema_monitor.joint.comparison import Comparison, Judgement, QuantityChange
from ema_monitor.joint.comparison import not_judged as all_unjudged
from ema_monitor.quantities import FRICTION, INERTIA, LOAD, PLAY, QUANTITIES, TORQUE, TRACKING
from ema_monitor.reason_texts import text_of
from ema_monitor.reasons import MotorStill, QuantityInseparable, QuantityUnjudged, Unjudged

END_NS = 1_700_000_000_000_000_000

_CAUSES = {PLAY: Unjudged.NO_MOTOR_SIDE, TRACKING: Unjudged.NO_COMMAND}
_SMALLEST = {name: 0.06 if name == FRICTION else 0.1 for name in QUANTITIES}


def unchanged(name: str, smallest: float = math.nan) -> QuantityChange:
    """Return a quantity that does not differ from healthy."""
    smallest = _SMALLEST[name] if math.isnan(smallest) else smallest
    unit = "N.m" if name == LOAD else "-"
    judgement = Judgement.UNCHANGED
    return QuantityChange(name, judgement, 0.0, -smallest / 2, smallest / 2, smallest, unit)


def changed(
    name: str, change: float, half_width: float = 0.04, rivals: tuple[str, ...] = ()
) -> QuantityChange:
    """Return a quantity that differs from healthy."""
    unit = "N.m" if name == LOAD else "-"
    low, high = change - half_width, change + half_width
    return QuantityChange(
        name, Judgement.CHANGED, change, low, high, _SMALLEST[name], unit, rivals=rivals
    )


def not_judged(name: str, cause: Unjudged = Unjudged.HARDLY_VISIBLE) -> QuantityChange:
    """Return a quantity that the record does not show."""
    unit = "N.m" if name == LOAD else "-"
    return QuantityChange(name, Judgement.NOT_JUDGED, unit=unit, reasons=(QuantityUnjudged(cause),))


def rival(name: str, of: str, change: float) -> QuantityChange:
    """Return a quantity that would explain the record as well as the changed one."""
    reasons = (QuantityInseparable((of,)),)
    low, high = change - 0.04, change + 0.04
    return QuantityChange(
        name, Judgement.NOT_JUDGED, change, low, high, 0.1, reasons=reasons, rivals=(of,)
    )


def comparison(*special: QuantityChange, **more: Any) -> Comparison:
    """Return a comparison that judges everything but play and tracking lag, with ``special``."""
    by_name = {quantity.name: quantity for quantity in special}
    quantities = tuple(
        by_name.get(name)
        or (not_judged(name, _CAUSES[name]) if name in _CAUSES else unchanged(name))
        for name in QUANTITIES
    )
    return Comparison(quantities, **more)


HEALTHY = comparison(probability=0.6)
FRICTION_UP = comparison(changed(FRICTION, 0.152), probability=1e-6)
HIDDEN = text_of(QuantityUnjudged(Unjudged.HARDLY_VISIBLE))
STILL = text_of(MotorStill())
NOTHING = all_unjudged(MotorStill())
EFFORT_UP = comparison(changed(FRICTION, 0.22, rivals=(TORQUE,)), rival(TORQUE, FRICTION, -0.18))
LOADED = comparison(changed(LOAD, 0.5, 0.1))
PLAY_UP = comparison(changed(PLAY, 3.0, 0.4))
HEAVIER = comparison(changed(INERTIA, 0.3), not_judged(FRICTION))

CASES: Mapping[str, Comparison] = {
    "healthy": HEALTHY,
    "friction": FRICTION_UP,
    "nothing": NOTHING,
    "not separated": EFFORT_UP,
    "load": LOADED,
    "play": PLAY_UP,
    "inertia without friction": HEAVIER,
}


def compared(of: Comparison, end_ns: int = END_NS, **values: Any) -> Estimate:
    """Return the estimate of a record with this comparison."""
    faults, covariance = np.full(N_FAULTS, math.nan), np.full((N_FAULTS, N_FAULTS), math.nan)
    unobservable = np.ones(N_FAULTS, dtype=bool)
    for number, name in enumerate(FAULT_NAMES[:2]):
        quantity = of[{"friction": FRICTION, "backlash": PLAY}[name]]
        if quantity.is_judged:
            faults[number] = min(max(quantity.change / 2.0, 0.0), 1.0)
            covariance[number] = covariance[:, number] = 0.0
            covariance[number, number] = ((quantity.high - quantity.low) / (2.0 * 2.0 * 1.645)) ** 2
            unobservable[number] = False
    covariance[np.ix_(unobservable, ~unobservable)] = math.nan
    covariance[np.ix_(~unobservable, unobservable)] = math.nan
    causes = tuple(
        CauseEstimate(cause, of[name].change, 0.01)
        for name, cause in (
            (TORQUE, "torque_constant"),
            (INERTIA, "inertia"),
            (LOAD, "load_torque"),
        )
        if of[name].judgement is Judgement.CHANGED
    )
    verdict = Verdict.VALID if of.judged else Verdict.REFUSED
    figures: dict[str, Any] = {
        "start_ns": end_ns - 25_000_000_000,
        "end_ns": end_ns,
        "algorithm": INVERSE_DYNAMICS,
        "seed": 0,
        "calibration_id": "some-baseline",
        "faults": FaultVector.of(faults),
        "covariance": covariance,
        "unobservable": unobservable,
        "valid": bool(of.judged),
        "verdict": Verdict.DEPARTED if of.has_departed else verdict,
        "reasons": () if of.judged else of.quantities[0].reasons,
        "causes": causes,
        "comparison": of,
    }
    return Estimate(**(figures | values))
