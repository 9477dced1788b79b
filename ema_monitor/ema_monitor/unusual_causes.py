"""Hidden causes beyond what is usual of healthy units: with them, an estimate is not OK."""

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_core.faults import SHORT_CIRCUITS
from ema_monitor.identification.estimate import DEGRADED, Estimate
from ema_monitor.model.deviations import USUAL_SIGMA
from ema_monitor.reason_texts import EQUAL_SHORTS

TORQUE_CONSTANT: Final = "torque_constant"

ONE_SIDED_95: Final = 1.645
"""Standard deviations from the mean to a one-sided 95 % bound [-]."""


def usual_range(name: str) -> float:
    """Return the largest usual change by a cause, either way, with probability 90 % [-]."""
    return ONE_SIDED_95 * USUAL_SIGMA[name]


def torque_change(estimate: Estimate) -> CauseEstimate | None:
    """Return the change of the torque constant that was found, else measured; None without one.

    Equal short circuits that the window does not separate from a weaker motor are such a change.
    """
    every = (*estimate.causes, *estimate.measured)
    cause = next((one for one in every if one.name == TORQUE_CONSTANT), None)
    if cause is None and any(EQUAL_SHORTS in pair for pair in estimate.alternatives):
        turns, sigmas = (
            np.asarray(row)[SHORT_CIRCUITS] for row in (estimate.faults, estimate.sigma)
        )
        return CauseEstimate(TORQUE_CONSTANT, -float(np.mean(turns)), float(np.max(sigmas)))
    return cause


def unusual_causes(estimate: Estimate) -> dict[str, str]:
    """Return why the causes of an estimate keep it from being OK, in words, by cause.

    A cause that was found or measured is unusual if its bound is beyond the usual range. Of a
    degraded estimate its value decides, as sigma includes what the window cannot separate; if the
    fit is poor, any such cause counts, as it stands for what the model does not explain.
    """
    is_poor = estimate.goodness_of_fit > estimate.goodness_limit
    sigmas = 0.0 if estimate.verdict == DEGRADED else ONE_SIDED_95
    reasons: dict[str, str] = {}
    for one in _watched(estimate.measured):
        if _exceeds(one, ONE_SIDED_95):
            reasons[one.name] = f"measured {_words(one)}"
    torque = torque_change(estimate)
    found = {one.name: one for one in estimate.causes}
    if torque is not None and torque not in estimate.measured:
        found[TORQUE_CONSTANT] = torque
    for one in _watched(found.values()):
        if _exceeds(one, sigmas):
            reasons[one.name] = _words(one)
        elif is_poor:
            reasons[one.name] = f"{CAUSE_BY_NAME[one.name].label} explains a window that fits badly"
    return reasons


def _exceeds(one: CauseEstimate, sigmas: float) -> bool:
    return abs(one.value) - sigmas * one.sigma > usual_range(one.name)


def _watched(causes: Iterable[CauseEstimate]) -> Iterator[CauseEstimate]:
    return (one for one in causes if one.name in USUAL_SIGMA)


def _words(one: CauseEstimate) -> str:
    return f"{one} is beyond its usual ±{100.0 * usual_range(one.name):.2g} %"
