"""Share of units that live up to an age, also of those that have not failed (Kaplan-Meier)."""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np

_CONFIDENCE: Final = 0.9
_Z: Final = NormalDist().inv_cdf(0.5 + _CONFIDENCE / 2.0)


class SurvivalStep(NamedTuple):
    """Share [-] that lives beyond an age [h] at which some failed, with its 90 % interval.

    It holds until the next step; of those at risk, who were watched just before, some failed.
    """

    age: float
    at_risk: int
    failed: int
    share: float
    lower: float
    upper: float


def survival(
    from_age: Sequence[float], to_age: Sequence[float], has_failed: Sequence[bool]
) -> list[SurvivalStep]:
    """Return the product-limit estimate of the share that lives beyond an age.

    Units count from the age at which they were first watched: those that failed before could not
    be seen, and would be missing among the failures only. The share is that of those who reach the
    first failure at which the root of their number is watched: before, one failure of the few that
    are would take it from all (Lai and Ying 1991). The interval is that of Greenwood's
    variance of log(-log share), which stays within 0 and 1. Where nobody is left the share is 0,
    and its interval is not known.

    One that was not watched for any time, between its two ages [h], does not count.
    """
    begin, end = np.asarray(from_age, dtype=float), np.asarray(to_age, dtype=float)
    is_failure = np.asarray(has_failed, dtype=bool) & (end > begin)
    ages, failures = np.unique(end[is_failure], return_counts=True)
    # Those watched from before on, without those that went before.
    watched = np.searchsorted(np.sort(begin), ages) - np.searchsorted(np.sort(end), ages)
    enough = watched >= math.sqrt(np.sum(end > begin))
    first = int(np.argmax(enough)) if enough.any() else ages.size
    ages, watched, failures = ages[first:], watched[first:], failures[first:]
    steps, share, variance = [], 1.0, 0.0
    for age, at_risk, failed in zip(
        ages.tolist(), watched.tolist(), failures.tolist(), strict=True
    ):
        share *= 1.0 - failed / at_risk
        lower = upper = math.nan
        if share > 0.0:
            variance += failed / (at_risk * (at_risk - failed))
            spread = _Z * math.sqrt(variance) / abs(math.log(share))
            lower, upper = share ** math.exp(spread), share ** math.exp(-spread)
        steps.append(SurvivalStep(age, at_risk, failed, share, lower, upper))
    return steps
