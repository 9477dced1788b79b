# SPDX-License-Identifier: Apache-2.0
"""Detection of hidden causes outside their usual range, which exclude the level OK."""

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_core.faults import SHORT_CIRCUITS
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.model.deviations import USUAL_SIGMA
from ema_monitor.reason_texts import EQUAL_SHORTS

TORQUE_CONSTANT: Final = "torque_constant"

ONE_SIDED_95: Final = 1.645
"""Number of standard deviations from the mean to a one-sided 95 % bound [-]."""


def usual_range(name: str) -> float:
    """Return the half-width of the usual range (90 % probability) of a cause [-]."""
    return ONE_SIDED_95 * USUAL_SIGMA[name]


def torque_change(estimate: Estimate) -> CauseEstimate | None:
    """Return the estimated (or else the measured) change of the torque constant, or None.

    Equal short circuits count as such a change if the window does not separate them from a weaker
    motor.
    """
    causes = (*estimate.causes, *estimate.measured)
    torque = next((cause for cause in causes if cause.name == TORQUE_CONSTANT), None)
    if torque is None and any(EQUAL_SHORTS in pair for pair in estimate.alternatives):
        turns, sigmas = (
            np.asarray(row)[SHORT_CIRCUITS] for row in (estimate.faults, estimate.sigma)
        )
        return CauseEstimate(TORQUE_CONSTANT, -float(np.mean(turns)), float(np.max(sigmas)))
    return torque


def unusual_causes(estimate: Estimate) -> dict[str, str]:
    """Return a phrase for each hidden cause that excludes the level OK, keyed by cause name.

    Only the causes in ``USUAL_SIGMA`` count. An estimated or measured cause is unusual if its 95 %
    bound is outside the usual range. For an estimated cause of a degraded estimate, the value is
    used instead of the bound, because sigma includes the uncertainty of inseparable components. If
    the fit is poor, every estimated cause counts, because it may represent something that the model
    cannot explain.
    """
    is_poor = estimate.goodness_of_fit > estimate.goodness_limit
    sigmas = 0.0 if estimate.verdict == Verdict.DEGRADED else ONE_SIDED_95
    reasons: dict[str, str] = {}
    for cause in _watched(estimate.measured):
        if _exceeds(cause, ONE_SIDED_95):
            reasons[cause.name] = f"measured {_words(cause)}"
    torque = torque_change(estimate)
    estimated = {cause.name: cause for cause in estimate.causes}
    if torque is not None and torque not in estimate.measured:
        estimated[TORQUE_CONSTANT] = torque
    for cause in _watched(estimated.values()):
        if _exceeds(cause, sigmas):
            reasons[cause.name] = _words(cause)
        elif is_poor:
            label = CAUSE_BY_NAME[cause.name].label
            reasons[cause.name] = f"{label} explains a window that fits badly"
    return reasons


def _exceeds(cause: CauseEstimate, sigmas: float) -> bool:
    return abs(cause.value) - sigmas * cause.sigma > usual_range(cause.name)


def _watched(causes: Iterable[CauseEstimate]) -> Iterator[CauseEstimate]:
    return (cause for cause in causes if cause.name in USUAL_SIGMA)


def _words(cause: CauseEstimate) -> str:
    return f"{cause} is beyond its usual ±{100.0 * usual_range(cause.name):.2g} %"
