# SPDX-License-Identifier: Apache-2.0
"""Standard metrics of prognosis for the remaining useful life.

Definitions of A. Saxena, J. Celaya, B. Saha, S. Saha and K. Goebel, Metrics for Offline Evaluation
of Prognostic Performance, International Journal of Prognostics and Health Management 1 (2010). r is
the predicted remaining useful life, r* the true one, EoL the service hour at which life ends and
t_P the service hour of the first prediction, all in h. Hours of predictions ascend. A test without
a prediction has r = NaN; its probability of any range is 0 and its relative accuracy is 0.

The relative accuracy of the *time of the event*, which some packages use, divides the same error by
the whole life instead of the remaining life. Late in life almost any prediction scores near 1.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

ALPHA: Final = 0.2
"""Required relative accuracy [-]."""

BETA: Final = 0.5
"""Probability with which ``ALPHA`` is required [-]."""


def probability_within(
    samples: ArrayLike, lowest: ArrayLike, highest: ArrayLike
) -> NDArray[np.float64]:
    """Return the probability pi[r] that a predicted life lies in a range, ``(n,)``.

    Both bounds are inclusive. Samples, ``(n, m)``, that are infinite or NaN lie in no range.
    """
    hours = np.asarray(samples, dtype=np.float64)
    low, high = (np.asarray(bound, dtype=np.float64)[..., None] for bound in (lowest, highest))
    return np.mean((hours >= low) & (hours <= high) & np.isfinite(hours), axis=-1)


def horizon_probability(
    hours: ArrayLike, samples: ArrayLike, end_hours: float, alpha: float = ALPHA
) -> NDArray[np.float64]:
    """Return P(|r - r*| <= alpha EoL) of each prediction [-], ``(n,)``."""
    truth = end_hours - np.asarray(hours, dtype=np.float64)
    width = alpha * end_hours
    return probability_within(samples, truth - width, truth + width)


def cone_probability(
    hours: ArrayLike, samples: ArrayLike, end_hours: float, alpha: float = ALPHA
) -> NDArray[np.float64]:
    """Return P((1 - alpha) r* <= r <= (1 + alpha) r*) of each prediction [-], ``(n,)``."""
    truth = end_hours - np.asarray(hours, dtype=np.float64)
    return probability_within(samples, (1.0 - alpha) * truth, (1.0 + alpha) * truth)


def prognostic_horizon(hours: ArrayLike, probability: ArrayLike, end_hours: float) -> float:
    """Return the prognostic horizon [h]: the time before the end from which predictions stay good.

    It is EoL less the first hour from which on ``probability`` (``horizon_probability``) never
    falls below ``BETA``. 0 if the last prediction is below ``BETA``.
    """
    times = np.asarray(hours, dtype=np.float64)
    failing = np.flatnonzero(np.asarray(probability) < BETA)
    first = 0 if failing.size == 0 else int(failing[-1]) + 1
    return float(end_hours - times[first]) if first < times.size else 0.0


def at_lambda(
    hours: ArrayLike,
    probability: ArrayLike,
    end_hours: float,
    share: float,
    first_hours: float = 0.0,
) -> float:
    """Return the probability within the cone at a share lambda of the life [-].

    This is the ``probability`` (``cone_probability``) of the latest prediction up to
    t_P + lambda (EoL - t_P); 0 without a prediction. The alpha-lambda test requires ``BETA``.
    """
    until = first_hours + share * (end_hours - first_hours)
    at = int(np.searchsorted(np.asarray(hours, dtype=np.float64), until, "right")) - 1
    return float(np.asarray(probability)[at]) if at >= 0 else 0.0


def relative_accuracy(rul: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Return 1 - |r* - r| / r* of each prediction [-], ``(n,)``; 0 for a missing prediction.

    1 is perfect; there is no lower bound.
    """
    r, true = np.asarray(rul, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    return np.where(np.isfinite(r), 1.0 - np.abs(true - r) / true, 0.0)


def cumulative_relative_accuracy(
    hours: ArrayLike, rul: ArrayLike, end_hours: float, first_share: float = 0.5
) -> float:
    """Return the mean relative accuracy [-] from a share of life on; NaN without a test there."""
    times, r = np.asarray(hours, dtype=np.float64), np.asarray(rul, dtype=np.float64)
    part = (times >= first_share * end_hours) & (times < end_hours)
    if not np.any(part):
        return math.nan
    return float(np.mean(relative_accuracy(r[part], end_hours - times[part])))


def convergence(hours: ArrayLike, error: ArrayLike, first_hours: float) -> float:
    """Return the convergence, in the common unit of hours and error.

    This is the distance from (t_P, 0) to the centroid of the area under the error; each error lasts
    until the next prediction. A smaller value means that the error decreases sooner. NaN if the
    area is 0.
    """
    t, m = np.asarray(hours, dtype=np.float64), np.asarray(error, dtype=np.float64)[:-1]
    steps = np.diff(t)
    area = float(np.sum(steps * m))
    if not area > 0.0:
        return math.nan
    x = 0.5 * float(np.sum((t[1:] ** 2 - t[:-1] ** 2) * m)) / area
    y = 0.5 * float(np.sum(steps * m**2)) / area
    return math.hypot(x - first_hours, y)


def accuracy_on_event_time(hours: ArrayLike, rul: ArrayLike, end_hours: float) -> float:
    """Return the mean relative accuracy of the *hour of failure* [-], for comparison only.

    This is 1 - |r* - r| / EoL. A prediction without any knowledge, r = 0, still scores
    1 - r* / EoL.
    """
    times, r = np.asarray(hours, dtype=np.float64), np.asarray(rul, dtype=np.float64)
    return float(np.mean(relative_accuracy(times + r, np.full(times.shape, end_hours))))
