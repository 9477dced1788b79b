"""How far to trust an estimate: what it leaves unexplained, its verdict, and why (M19)."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.causes import CauseEstimate
from ema_core.faults import ECCENTRICITY_PHASE, N_FAULTS, SHORT_CIRCUITS
from ema_monitor.identification.alternatives import Alternative, Part
from ema_monitor.identification.settings import MOST_UNEXPLAINED, SearchSettings
from ema_monitor.reasons import (
    FitUnjudged,
    NotDetermined,
    NotSeparated,
    PoorFit,
    Reason,
    SensorBeyondRange,
    Unexplained,
)


class Misfit(NamedTuple):
    """What an estimate misses of a window, or of several.

    Attributes
    ----------
    powers
        Power of the band-limited residual over that of a healthy window, ``(2, 2)``: of current and
        speed (rows) at the estimate and at the healthy point (columns); NaN where the calibration
        does not know the latter.
    """

    powers: Array

    @property
    def goodness(self) -> float:
        """Rms of the residual over that of a healthy window, the larger of current and speed [-].

        Where one scatter is unknown, the other judges.
        """
        return math.sqrt(float(np.fmax(*self.powers[:, 0])))

    @property
    def share(self) -> float:
        """Share of the departure from healthy that the estimate leaves [-].

        The square root of the excess of the residual's power over that of a healthy window, at the
        estimate over at the healthy point; NaN where the goodness is.
        """
        if math.isnan(self.goodness):
            return math.nan
        left, departure = np.maximum(np.nansum(self.powers - 1.0, axis=0), 0.0).tolist()
        return math.sqrt(left / departure) if departure > 0.0 else float(left > 0.0)


def goodness_limit(faults: Array, limit: float) -> float:
    """Return the goodness of fit up to which faults, ``(8,)``, explain a window.

    The fewer turns a phase has left, the less inductance holds its ripple, which no model of the
    mean current can match. ``limit`` is that of a motor without short circuit.
    """
    most_shorted = float(np.max(faults[SHORT_CIRCUITS]))
    return limit / math.sqrt(1.0 - most_shorted)


def assumed_goodness(faults: Array, goodness: float) -> float:
    """Return the goodness of fit that standard deviations are to hold for.

    Where it is unknown, NaN, it may be as high as that of any estimate that is valid.
    """
    if math.isnan(goodness):
        return goodness_limit(faults, SearchSettings.goodness_limit)
    return goodness


def judged(
    subject: str,
    misfit: Misfit,
    limit: float,
    unobservable: Flags,
    alternatives: Sequence[Alternative],
    reservations: Sequence[Reason],
    calibration_windows: int,
    beyond: Sequence[CauseEstimate] = (),
) -> dict[str, Any]:
    """Return ``verdict``, ``valid`` and ``reasons`` of an estimate.

    Parameters
    ----------
    subject
        What it is an estimate of: a window, a stretch, or a motion of several.
    misfit, limit
        What it misses, and the goodness of fit up to which the faults explain the window.
    unobservable
        Components that are not determined, ``(8,)``.
    alternatives
        Pairs of what is part of the explanation and what it is not told from.
    reservations
        Reasons that have no consequence.
    calibration_windows
        Number of healthy windows of the calibration.
    beyond
        Errors of sensors that are at the end of the range of the search.
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
    verdict = "refused" if defects else "degraded" if doubts else "valid"
    reasons = (*reservations, *doubts, *defects)
    return {"verdict": verdict, "valid": not defects, "reasons": reasons}


def not_separated(subject: str, alternatives: Iterable[Alternative]) -> list[NotSeparated]:
    """Return a reason for each part of an explanation that cannot be separated from others."""
    stand_ins: dict[Part, list[Part]] = {}
    for part, stand_in in alternatives:
        stand_ins.setdefault(part, []).append(stand_in)
    return [NotSeparated(subject, part, tuple(parts)) for part, parts in stand_ins.items()]
