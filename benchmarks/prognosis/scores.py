# SPDX-License-Identifier: Apache-2.0
"""Scores of the predictions of one life, and of many lives."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ema_core.faults import TYPICAL
from prognosis import metrics
from prognosis.predictors import Predictions

LAMBDAS: Final = (0.25, 0.5, 0.75, 0.9)
"""Shares of the time from first prediction to end at which the alpha-lambda test is made [-]."""

WITHOUT_DIFFUSION: Final = "without gain"
"""Name of the lives whose dominant fault is not a random walk."""


@dataclass(frozen=True)
class LifeScore:
    """Scores of one life; shares are in [-], hours in h.

    ``first_hours`` is NaN without a prediction, ``convergence_share`` with fewer than two.
    """

    kind: str  # dominant fault
    end_hours: float
    first_hours: float  # service hour of the first prediction
    cra: float  # cumulative relative accuracy over the second half of life
    cra_event_time: float  # accuracy of the hour of failure, for comparison
    unknown_share: float  # share of tests in the second half of life without a prediction
    cone: tuple[float, ...]  # probability within the cone of alpha at each lambda
    horizon_share: float  # prognostic horizon over the life
    convergence_share: float  # convergence over the time from first prediction to end
    inside: int  # number of 90 % intervals that contain the truth
    intervals: int  # number of 90 % intervals
    beyond_late: int  # number of intervals above the truth in the second half of life
    intervals_late: int  # number of intervals in the second half of life
    seconds: float  # median processor time from estimate to prediction [s]

    @classmethod
    def of(cls, kind: str, end_hours: float, made: Predictions) -> "LifeScore":
        """Return the scores of the predictions of a life that ends at a service hour [h]."""
        hours, rul = made.hours, made.median
        is_predicted = np.isfinite(rul)
        late, truth = hours >= 0.5 * end_hours, end_hours - hours
        first = float(hours[is_predicted][0]) if is_predicted.any() else math.nan
        in_cone = metrics.cone_probability(hours, made.samples, end_hours)
        in_band = metrics.horizon_probability(hours, made.samples, end_hours)
        begin = float(np.nan_to_num(first))
        cone = [metrics.at_lambda(hours, in_cone, end_hours, share, begin) for share in LAMBDAS]
        gone = metrics.convergence(hours[is_predicted], np.abs(rul - truth)[is_predicted], first)
        there = np.isfinite(made.low)
        return cls(
            kind=kind,
            end_hours=end_hours,
            first_hours=first,
            cra=metrics.cumulative_relative_accuracy(hours, rul, end_hours),
            cra_event_time=metrics.accuracy_on_event_time(hours[late], rul[late], end_hours),
            unknown_share=float(np.mean(~is_predicted[late])),
            cone=tuple(cone),
            horizon_share=metrics.prognostic_horizon(hours, in_band, end_hours) / end_hours,
            convergence_share=gone / (end_hours - first),
            inside=int(np.sum((made.low <= truth) & (truth <= made.high))),
            intervals=int(np.sum(there)),
            beyond_late=int(np.sum((made.low > truth) & late)),
            intervals_late=int(np.sum(there & late)),
            seconds=float(np.nanmedian(made.seconds)),
        )


def summary(scores: Sequence[LifeScore]) -> dict[str, Any]:
    """Return the scores of many lives: means or medians over lives, and pooled coverage."""

    def column(name: str) -> list[float]:
        return [getattr(score, name) for score in scores]

    def share(part: str, whole: str) -> float:
        count = sum(column(whole))
        return sum(column(part)) / count if count else math.nan

    passed = np.mean([np.array(score.cone) >= metrics.BETA for score in scores], axis=0).tolist()
    first = [score.first_hours / score.end_hours for score in scores]
    return {
        "lives": len(scores),
        **{
            name: float(np.mean(column(name)))
            for name in ("cra", "cra_event_time", "unknown_share")
        },
        **{f"alpha_lambda_{at:g}": rate for at, rate in zip(LAMBDAS, passed, strict=True)},
        "coverage": share("inside", "intervals"),
        "beyond_late": share("beyond_late", "intervals_late"),
        **{
            name: float(np.nanmedian(column(name)))
            for name in ("horizon_share", "convergence_share", "seconds")
        },
        "first_share": float(np.nanmedian(first)),
    }


def by_kind(scores: Sequence[LifeScore]) -> dict[str, dict[str, Any]]:
    """Return the summaries by kind of fault, for kinds without diffusion, and for all lives.

    Their keys are the kinds, ``WITHOUT_DIFFUSION`` and "all".
    """
    kinds = dict.fromkeys(score.kind for score in scores)
    parts = {kind: summary([s for s in scores if s.kind == kind]) for kind in kinds}
    smooth = [s for s in scores if not TYPICAL[s.kind].diffusion]
    return {**parts, WITHOUT_DIFFUSION: summary(smooth), "all": summary(scores)}
