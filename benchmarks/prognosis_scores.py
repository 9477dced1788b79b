"""Scores of the predictions of a life, and of many lives together."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import prognosis_metrics as metrics
from numpy.typing import NDArray
from prognosis_predictors import Predictions

from ema_core.faults import TYPICAL

LAMBDAS: Final = (0.25, 0.5, 0.75, 0.9)
"""Shares of the time from first prediction to end at which the cone is tested [-]."""

WITHOUT_DIFFUSION: Final = "without gain"
"""Lives whose dominant fault is not a random walk."""

JUDGED_LAMBDA: Final = 0.75

SHARES: Final = tuple(np.linspace(0.1, 0.95, 18).round(2).tolist())
"""Shares of the whole life at which relative accuracies are drawn [-]."""


@dataclass(frozen=True)
class LifeScore:
    """Scores of one life; NaN where nothing was predicted.

    Attributes
    ----------
    kind
        Dominant fault.
    number
        Number of the life.
    end_hours, first_hours
        End of life and first prediction [h].
    cra
        Cumulative relative accuracy over the second half of life [-].
    cra_to_95
        The same without the last 5 % of life, where what remains goes to zero [-].
    cra_event_time
        That of the hour of failure over the second half of life, for comparison [-].
    cra_by_progpy
        The same by progpy's own function, of the mean and without tests that predict nothing; NaN
        where it was not computed [-].
    accuracy
        Relative accuracy at each lambda [-].
    accuracy_by_share
        The same at each of ``SHARES`` of the whole life [-].
    unknown_share
        Share of the tests in the second half of life after which nothing is predicted [-].
    cone
        Probability within the cone of alpha at each lambda [-].
    passed
        Whether it is at least beta.
    horizon_share
        Prognostic horizon over the life [-].
    convergence_share
        Convergence over the time from first prediction to end [-].
    inside, intervals
        How many 90 % intervals hold the truth, of how many.
    inside_late, beyond_late, intervals_late
        How many hold the truth, and lie wholly beyond it, in the second half of life, of how many.
    seconds
        Median processor time from estimate to prediction [s].
    """

    kind: str
    number: int
    end_hours: float
    first_hours: float
    cra: float
    cra_to_95: float
    cra_event_time: float
    cra_by_progpy: float
    accuracy: tuple[float, ...]
    accuracy_by_share: tuple[float, ...]
    unknown_share: float
    cone: tuple[float, ...]
    passed: tuple[bool, ...]
    horizon_share: float
    convergence_share: float
    inside: int
    intervals: int
    inside_late: int
    beyond_late: int
    intervals_late: int
    seconds: float

    @classmethod
    def of(
        cls,
        kind: str,
        number: int,
        end_hours: float,
        made: Predictions,
        by_progpy: float = math.nan,
    ) -> "LifeScore":
        """Score the predictions made in a life that ends at a service hour [h]."""
        hours, rul = made.hours, made.median
        known = np.isfinite(rul)
        late = hours >= 0.5 * end_hours
        truth = end_hours - hours
        first = float(hours[known][0]) if known.any() else math.nan
        in_cone = metrics.cone_probability(hours, made.samples, end_hours)
        in_band = metrics.horizon_probability(hours, made.samples, end_hours)
        tests = [
            metrics.alpha_lambda(hours, in_cone, end_hours, share, np.nan_to_num(first))
            for share in LAMBDAS
        ]
        error = np.abs(rul - truth)[known]
        gone = metrics.convergence(hours[known], error, first) / (end_hours - first)
        covered = (made.low <= truth) & (truth <= made.high)
        there = np.isfinite(made.low)
        return cls(
            kind=kind,
            number=number,
            end_hours=end_hours,
            first_hours=first,
            cra=metrics.cumulative_relative_accuracy(hours, rul, end_hours),
            cra_to_95=metrics.cumulative_relative_accuracy(hours, rul, end_hours, 0.5, 0.95),
            cra_event_time=metrics.accuracy_on_event_time(hours[late], rul[late], end_hours),
            cra_by_progpy=by_progpy,
            accuracy=tuple(
                metrics.relative_accuracy_at(hours, rul, end_hours, share, np.nan_to_num(first))
                for share in LAMBDAS
            ),
            accuracy_by_share=tuple(
                round(metrics.relative_accuracy_at(hours, rul, end_hours, share), 4)
                for share in SHARES
            ),
            unknown_share=float(np.mean(~known[late])),
            cone=tuple(test.probability for test in tests),
            passed=tuple(test.passed for test in tests),
            horizon_share=metrics.prognostic_horizon(hours, in_band, end_hours) / end_hours,
            convergence_share=gone,
            inside=int(np.sum(covered)),
            intervals=int(np.sum(there)),
            inside_late=int(np.sum(covered & late)),
            beyond_late=int(np.sum((made.low > truth) & late)),
            intervals_late=int(np.sum(there & late)),
            seconds=float(np.nanmedian(made.seconds)),
        )


def summary(scores: Sequence[LifeScore]) -> dict[str, Any]:
    """Return the figures of many lives: means over them, intervals pooled."""

    def mean(name: str) -> float:
        return float(np.mean([getattr(score, name) for score in scores]))

    def median(name: str) -> float:
        return float(np.nanmedian([getattr(score, name) for score in scores]))

    def share(part: str, whole: str) -> float:
        count = sum(getattr(score, whole) for score in scores)
        return sum(getattr(score, part) for score in scores) / count if count else math.nan

    return {
        "lives": len(scores),
        "cra": mean("cra"),
        "cra_median": median("cra"),
        "cra_to_95": mean("cra_to_95"),
        "cra_event_time": mean("cra_event_time"),
        "cra_by_progpy": mean("cra_by_progpy"),
        "accuracy": _at_lambdas(np.mean([score.accuracy for score in scores], axis=0)),
        "unknown_share": mean("unknown_share"),
        "alpha_lambda": _at_lambdas(np.mean([score.passed for score in scores], axis=0)),
        "coverage": share("inside", "intervals"),
        "coverage_late": share("inside_late", "intervals_late"),
        "beyond_late": share("beyond_late", "intervals_late"),
        "horizon_share": median("horizon_share"),
        "convergence_share": median("convergence_share"),
        "first_share": float(np.nanmedian([s.first_hours / s.end_hours for s in scores])),
        "seconds": median("seconds"),
    }


def _at_lambdas(values: NDArray[np.float64]) -> dict[str, float]:
    return {f"{share:g}": float(value) for share, value in zip(LAMBDAS, values, strict=True)}


def by_kind(scores: Sequence[LifeScore]) -> dict[str, dict[str, Any]]:
    """Return the figures of each kind of fault, then of all, without the one that diffuses too."""
    kinds = dict.fromkeys(score.kind for score in scores)
    parts = {kind: summary([s for s in scores if s.kind == kind]) for kind in kinds}
    smooth = [s for s in scores if not TYPICAL[s.kind].diffusion]
    return {**parts, WITHOUT_DIFFUSION: summary(smooth), "all": summary(scores)}
