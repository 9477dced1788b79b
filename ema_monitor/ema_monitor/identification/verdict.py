# SPDX-License-Identifier: Apache-2.0
"""Verdict on an estimate from its misfit, with the reasons.

The method is described in ``docs/identification.md``, M19.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.causes import CauseEstimate
from ema_core.faults import ECCENTRICITY_PHASE, N_FAULTS, SHORT_CIRCUITS
from ema_monitor.identification.alternatives import Alternative, Part
from ema_monitor.identification.estimate import Verdict
from ema_monitor.identification.search_settings import MOST_UNEXPLAINED, SearchSettings
from ema_monitor.reasons import (
    FitUnjudged,
    NotDetermined,
    NotSeparated,
    PoorFit,
    Reason,
    SensorBeyondRange,
    Subject,
    Unexplained,
)


class Misfit(NamedTuple):
    """Misfit of an estimate to a window, or to several windows."""

    powers: Array
    """Power of the band-limited residuals relative to a healthy window, ``(2, 2)`` [-].

    The rows are current and speed; the columns are the estimate and the healthy point. NaN if the
    calibration does not include the residuals of a healthy window.
    """

    @property
    def goodness(self) -> float:
        """Rms residual relative to a healthy window; the larger value of current and speed [-].

        If one value is unknown, the known value is returned. NaN if both are unknown.
        """
        return math.sqrt(float(np.fmax(*self.powers[:, 0])))

    @property
    def share(self) -> float:
        """Unexplained share of the departure from healthy [-].

        Square root of the ratio of the residual powers, in excess of a healthy window, at the
        estimate and at the healthy point. NaN if `goodness` is NaN. Without an excess at the
        healthy point, 1 if there is an excess at the estimate, else 0.
        """
        if math.isnan(self.goodness):
            return math.nan
        unexplained, departure = np.maximum(np.nansum(self.powers - 1.0, axis=0), 0.0).tolist()
        return math.sqrt(unexplained / departure) if departure > 0.0 else float(unexplained > 0.0)


def goodness_limit(faults: Array, limit: float) -> float:
    """Return the largest goodness of fit at which faults, ``(8,)``, explain a window.

    A phase with fewer turns has less inductance and more current ripple, which a model of the mean
    current cannot reproduce. ``limit`` applies to a motor without a short circuit.
    """
    most_shorted = float(np.max(faults[SHORT_CIRCUITS]))
    return limit / math.sqrt(1.0 - most_shorted)


def assumed_goodness(faults: Array, goodness: float) -> float:
    """Return the goodness of fit from which standard deviations are computed.

    If ``goodness`` is NaN (unknown), the limit of valid estimates is returned.
    """
    if math.isnan(goodness):
        return goodness_limit(faults, SearchSettings.goodness_limit)
    return goodness


def judged(
    subject: Subject,
    misfit: Misfit,
    limit: float,
    unobservable: Flags,
    alternatives: Sequence[Alternative],
    reservations: Sequence[Reason],
    calibration_windows: int,
    beyond: Sequence[CauseEstimate] = (),
) -> dict[str, Any]:
    """Return the fields ``verdict``, ``valid`` and ``reasons`` of an estimate.

    Parameters
    ----------
    subject
        Telemetry that the estimate describes.
    misfit, limit
        Misfit of the estimate, and largest goodness of fit at which the faults explain the window.
    unobservable
        Flags of the components that are not determined, ``(8,)``.
    alternatives
        Parts of the explanation and their replacements.
    reservations
        Reasons that do not affect the verdict.
    calibration_windows
        Number of healthy windows in the calibration.
    beyond
        Sensor errors at a bound of the search.
    """
    doubts: list[Reason] = list(not_separated(subject, alternatives))
    defects: list[Reason] = [SensorBeyondRange(*cause) for cause in beyond]
    goodness, share = misfit.goodness, misfit.share
    if math.isnan(goodness):
        doubts.append(FitUnjudged(calibration_windows))
    elif goodness > limit and share > MOST_UNEXPLAINED:
        defects.append(Unexplained(subject, goodness, limit, share))
    elif goodness > limit:
        doubts.append(PoorFit(goodness, limit, share))
    if np.all(unobservable | (np.arange(N_FAULTS) == ECCENTRICITY_PHASE)):
        defects.append(NotDetermined(subject))
    verdict = Verdict.VALID
    if defects:
        verdict = Verdict.REFUSED
    elif doubts:
        verdict = Verdict.DEGRADED
    reasons = (*reservations, *doubts, *defects)
    return {"verdict": verdict, "valid": not defects, "reasons": reasons}


def not_separated(subject: Subject, alternatives: Iterable[Alternative]) -> list[NotSeparated]:
    """Return a reason for each part of an explanation that has alternatives."""
    stand_ins: dict[Part, list[Part]] = {}
    for part, stand_in in alternatives:
        stand_ins.setdefault(part, []).append(stand_in)
    return [NotSeparated(subject, part, tuple(parts)) for part, parts in stand_ins.items()]
