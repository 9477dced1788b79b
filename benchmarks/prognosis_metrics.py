"""Standard metrics of prognosis, on the remaining useful life.

Definitions of A. Saxena, J. Celaya, B. Saha, S. Saha and K. Goebel, Metrics for Offline Evaluation
of Prognostic Performance, International Journal of Prognostics and Health Management 1 (2010). r is
the predicted remaining useful life, r* the true one, EoL the service hour at which life ends and
t_P that of the first prediction. A test without prediction has r = NaN; its probability of anything
is 0 and its relative accuracy is 0.

A relative accuracy on the *time of the event*, as some packages have it, divides the same error by
the whole life instead of by what is left of it: late in life almost any prediction scores near 1.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

ALPHA: Final = 0.2
"""Accuracy that is asked for [-]."""

BETA: Final = 0.5
"""Probability with which it is asked for [-]."""


def probability_within(
    samples: ArrayLike, lowest: ArrayLike, highest: ArrayLike
) -> NDArray[np.float64]:
    """Return the probability that a predicted life lies in a range.

    Parameters
    ----------
    samples
        Samples of each prediction [h], ``(n, m)``; infinite or NaN ones are in no range.
    lowest, highest
        Bounds of each range, both within it [h], ``(n,)``.

    Returns
    -------
    numpy.ndarray
        Probabilities [-], ``(n,)``, pi[r] of the source.
    """
    hours = np.asarray(samples, dtype=np.float64)
    low, high = (np.asarray(bound, dtype=np.float64)[..., None] for bound in (lowest, highest))
    return np.mean((hours >= low) & (hours <= high) & np.isfinite(hours), axis=-1)


def horizon_probability(
    hours: ArrayLike, samples: ArrayLike, end_hours: float, alpha: float = ALPHA
) -> NDArray[np.float64]:
    """Return P(|r - r*| <= alpha EoL) of each prediction [-], ``(n,)``.

    Parameters
    ----------
    hours
        Service hours of the predictions [h], ``(n,)``.
    samples
        Samples of each [h], ``(n, m)``.
    end_hours
        EoL [h].
    alpha
        Share of the whole life.
    """
    truth = end_hours - np.asarray(hours, dtype=np.float64)
    width = alpha * end_hours
    return probability_within(samples, truth - width, truth + width)


def cone_probability(
    hours: ArrayLike, samples: ArrayLike, end_hours: float, alpha: float = ALPHA
) -> NDArray[np.float64]:
    """Return P((1 - alpha) r* <= r <= (1 + alpha) r*) of each prediction [-], ``(n,)``.

    Parameters
    ----------
    hours, samples, end_hours
        As of ``horizon_probability``.
    alpha
        Share of the remaining life.
    """
    truth = end_hours - np.asarray(hours, dtype=np.float64)
    return probability_within(samples, (1.0 - alpha) * truth, (1.0 + alpha) * truth)


def prognostic_horizon(
    hours: ArrayLike, probability: ArrayLike, end_hours: float, beta: float = BETA
) -> float:
    """Return the prognostic horizon [h]: how long before the end predictions are good for good.

    Parameters
    ----------
    hours
        Service hours of the predictions, ascending [h], ``(n,)``.
    probability
        What ``horizon_probability`` returns, ``(n,)``.
    end_hours
        EoL [h].
    beta
        Probability that is asked for.

    Notes
    -----
    EoL less the first time from which on the probability never is below beta: a prediction that was
    good once and is bad later does not count. 0 when the last one is bad.
    """
    times = np.asarray(hours, dtype=np.float64)
    failing = np.flatnonzero(np.asarray(probability) < beta)
    first = 0 if failing.size == 0 else int(failing[-1]) + 1
    return float(end_hours - times[first]) if first < times.size else 0.0


@dataclass(frozen=True)
class AlphaLambda:
    """Result of the alpha-lambda test.

    Attributes
    ----------
    passed
        Whether the probability is at least beta.
    probability
        Probability within the cone [-]; 0 without a prediction.
    hours
        Service hour of the prediction that was judged [h]; NaN without one.
    """

    passed: bool
    probability: float
    hours: float


def alpha_lambda(
    hours: ArrayLike,
    probability: ArrayLike,
    end_hours: float,
    share: float,
    first_hours: float = 0.0,
    beta: float = BETA,
) -> AlphaLambda:
    """Return whether a prediction is accurate at a given share of the life.

    Parameters
    ----------
    hours
        Service hours of the predictions, ascending [h], ``(n,)``.
    probability
        What ``cone_probability`` returns, ``(n,)``.
    end_hours
        EoL [h].
    share
        Lambda, share of the time from the first prediction to the end [-].
    first_hours
        t_P, service hour of the first prediction [h].
    beta
        Probability that is asked for.

    Notes
    -----
    The latest prediction up to t_P + lambda (EoL - t_P) is judged, by the life that remained when
    it was made.
    """
    times = np.asarray(hours, dtype=np.float64)
    at = _latest(times, end_hours, share, first_hours)
    if at < 0:
        return AlphaLambda(False, 0.0, math.nan)
    value = float(np.asarray(probability)[at])
    return AlphaLambda(value >= beta, value, float(times[at]))


def _latest(times: NDArray[np.float64], end_hours: float, share: float, first_hours: float) -> int:
    """Return the latest prediction up to a share of the time to the end; -1 when there is none."""
    until = first_hours + share * (end_hours - first_hours)
    return int(np.searchsorted(times, until, "right")) - 1


def relative_accuracy(rul: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Return 1 - |r* - r| / r* of each prediction [-], ``(n,)``.

    Parameters
    ----------
    rul
        Predicted remaining useful life [h], ``(n,)``; NaN where there is none.
    truth
        True one, above 0 [h], ``(n,)``.

    Notes
    -----
    1 is perfect; there is no lower bound. A missing prediction counts 0.
    """
    r, true = np.asarray(rul, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    return np.where(np.isfinite(r), 1.0 - np.abs(true - r) / true, 0.0)


def relative_accuracy_at(
    hours: ArrayLike,
    rul: ArrayLike,
    end_hours: float,
    share: float,
    first_hours: float = 0.0,
) -> float:
    """Return the relative accuracy at a given share of the life [-]; 0 without a prediction.

    Parameters
    ----------
    hours, end_hours, share, first_hours
        As of ``alpha_lambda``, which judges the same prediction.
    rul
        Predicted remaining useful life [h], ``(n,)``; NaN where there is none.
    """
    times = np.asarray(hours, dtype=np.float64)
    at = _latest(times, end_hours, share, first_hours)
    if at < 0:
        return 0.0
    return float(relative_accuracy(np.asarray(rul)[at], end_hours - times[at]))


def cumulative_relative_accuracy(
    hours: ArrayLike,
    rul: ArrayLike,
    end_hours: float,
    first_share: float = 0.5,
    last_share: float = 1.0,
) -> float:
    """Return the mean relative accuracy over a part of life, with equal weights [-].

    Parameters
    ----------
    hours
        Service hours of the predictions [h], ``(n,)``.
    rul
        Predicted remaining useful life [h], ``(n,)``; NaN where there is none.
    end_hours
        EoL [h].
    first_share, last_share
        The part, from ``first_share`` EoL up to before ``last_share`` EoL [-].

    Returns
    -------
    float
        The mean; NaN when no test lies in that part.
    """
    times, r = np.asarray(hours, dtype=np.float64), np.asarray(rul, dtype=np.float64)
    part = (times >= first_share * end_hours) & (times < last_share * end_hours)
    if not np.any(part):
        return math.nan
    return float(np.mean(relative_accuracy(r[part], end_hours - times[part])))


def convergence(hours: ArrayLike, error: ArrayLike, first_hours: float) -> float:
    """Return the convergence: how far the area under an error is from its beginning.

    Parameters
    ----------
    hours
        Service hours of the predictions, ascending [h], ``(n,)``.
    error
        Error of each, at least 0, held until the next prediction, ``(n,)``.
    first_hours
        t_P, service hour of the first prediction [h].

    Returns
    -------
    float
        Distance from (t_P, 0) to the centroid of the area, in the common unit of hours and error;
        the smaller, the sooner the error has gone. NaN when there is no area.
    """
    t, m = np.asarray(hours, dtype=np.float64), np.asarray(error, dtype=np.float64)[:-1]
    steps = np.diff(t)
    area = float(np.sum(steps * m))
    if not area > 0.0:
        return math.nan
    x = 0.5 * float(np.sum((t[1:] ** 2 - t[:-1] ** 2) * m)) / area
    y = 0.5 * float(np.sum(steps * m**2)) / area
    return math.hypot(x - first_hours, y)


def coverage(low: ArrayLike, high: ArrayLike, truth: ArrayLike) -> float:
    """Return the share of intervals that hold the truth [-].

    Parameters
    ----------
    low, high
        Bounds of the intervals, both within them [h], ``(n,)``; NaN where there is none: these
        are left out.
    truth
        True remaining useful life [h], ``(n,)``.

    Returns
    -------
    float
        The share; NaN when there is no interval.
    """
    bottom, top = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    there = ~(np.isnan(bottom) | np.isnan(top))
    if not np.any(there):
        return math.nan
    true = np.broadcast_to(np.asarray(truth, dtype=np.float64), there.shape)[there]
    return float(np.mean((bottom[there] <= true) & (true <= top[there])))


def accuracy_on_event_time(hours: ArrayLike, rul: ArrayLike, end_hours: float) -> float:
    """Return the mean relative accuracy of the *hour of failure* [-], for comparison only.

    Parameters
    ----------
    hours, rul, end_hours
        As of ``cumulative_relative_accuracy``.

    Notes
    -----
    1 - |r* - r| / EoL: with nothing known but the hour of the test itself, r = 0, it would still
    be 1 - r* / EoL.
    """
    times, r = np.asarray(hours, dtype=np.float64), np.asarray(rul, dtype=np.float64)
    return float(np.mean(relative_accuracy(times + r, np.full(times.shape, end_hours))))
