# SPDX-License-Identifier: Apache-2.0
"""Calibration check: comparison of a unit's predictions with its later tests (P13a).

The probability integral transform (PIT) of a test is the predicted probability of a value below the
measured value. It is uniformly distributed if predictions are calibrated (Dawid 1984; Diebold,
Gunther and Tay 1998). It is recorded for predictions one test and twenty tests ahead. Predictions
twenty tests ahead can widen intervals but never narrow them.
"""

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY
from ema_monitor.prognosis.growth.kept import Kept
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings

AHEAD: Final = 20
"""Number of tests between a prediction and the test that evaluates it."""

EVERY: Final = 5
"""Number of tests between stored predictions."""

WIDTHS: Final = np.array([0.4, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8])
"""Grid of interval width factors [-]."""

SAMPLES: Final = 256
"""Number of samples per stored prediction."""

_WIDTH_SIGMA: Final = 0.35
"""Prior standard deviation of the logarithm of the width factor [-]."""

_KEPT: Final = 0.98
"""Discount applied to earlier tests at each new test [-]."""

_LEAST: Final = 5.0
"""Smallest (discounted) number of tests for which scores are reported."""

_PENDING: Final = AHEAD // EVERY
_SLOTS: Final = _PENDING + 1  # one spare: a component may miss the test that is due
_QUANTILES: Final = (np.arange(16) + 0.5) / 16.0
_LADDER: Final = np.array([0.4, 0.7, 1.0, 1.5, 2.5, 4.0])
_EDGE: Final = 1e-6
_FARTHEST: Final = 10.0
_NORMAL: Final = NormalDist()

LOG_PRIOR: Final = -0.5 * (np.log(WIDTHS) / _WIDTH_SIGMA) ** 2


@dataclass(frozen=True)
class TrackRecord:
    """Scores of a fault's past predictions, from its later tests."""

    one_step: float = math.nan
    ahead: float = math.nan
    """RMS of the normal scores of the PIT, for predictions one test and twenty tests ahead [-].

    1 if intervals are right, above 1 if they are too narrow, NaN if there are too few tests.
    """
    widening: float = math.nan
    """Factor by which intervals are widened, at least 1 [-]; NaN if unknown."""


class PredictionCheck(Kept):
    """Scores of evaluated predictions, and predictions that await their tests."""

    kept = (
        *("_scores", "_log_widths", "_since", "_ahead", "_quantiles", "_made", "_open", "_grows"),
        *("_tests", "_first_hours"),
    )

    def __init__(self, settings: TrackerSettings) -> None:
        self._large = settings.occasional_error
        self._rare = settings.occasional_probability
        n = len(COMPONENTS)
        # Count and sum of squares of the scores, for predictions one test and AHEAD tests ahead.
        self._scores = np.zeros((2, n, 2))
        self._log_widths = np.tile(LOG_PRIOR, (n, 1))
        # Growth hours at which each prediction was made, and its horizons in hours.
        self._since = np.full((_SLOTS, n), np.nan)
        self._ahead = np.full((_SLOTS, _LADDER.size), np.nan)
        self._quantiles = np.zeros((_SLOTS, _LADDER.size, n, _QUANTILES.size))
        # Test number of each prediction, and components still to be evaluated.
        self._made = np.zeros(_SLOTS, dtype=np.intp)
        self._open = np.zeros((_SLOTS, n), dtype=bool)
        self._grows = np.zeros((_SLOTS, n), dtype=bool)
        self._tests = 0
        self._first_hours = math.nan

    def restart(self, number: int, *, is_new: bool) -> None:
        """Discard the predictions of a component whose level has changed abruptly.

        After a repair (``is_new``), its scores are discarded as well, because they belong to the
        old part.
        """
        self._open[:, number] = False
        if is_new:
            self._scores[:, number] = 0.0
            self._log_widths[number] = LOG_PRIOR

    def one_step(self, pit: Array, plain: Flags) -> None:
        """Record the PIT of one-step predictions, ``(7,)``, for the components in ``plain``."""
        for number in np.flatnonzero(plain):
            self._add(0, int(number), float(pit[number]))

    def _add(self, which: int, number: int, pit: float) -> None:
        score = _NORMAL.inv_cdf(min(max(pit, _EDGE), 1.0 - _EDGE))
        self._scores[which, number] = _KEPT * self._scores[which, number] + [1.0, score**2]

    def observe(self, measurement: Measurement, used: Flags) -> None:
        """Evaluate due predictions against a test, for the components in ``used``, ``(7,)``.

        If the test does not show a component, the next test that shows it is used.
        """
        if math.isnan(self._first_hours):
            self._first_hours = measurement.hours
        self._tests += 1
        due = self._open & used & (self._tests - self._made >= AHEAD)[:, None]
        self._open &= ~due
        for slot, number in np.argwhere(due):
            self._judge(int(slot), int(number), measurement)

    def _judge(self, slot: int, number: int, measurement: Measurement) -> None:
        hours, table = self._ahead[slot], self._quantiles[slot, :, number]
        passed = float(measurement.own_hours[number] - self._since[slot, number])
        if passed > hours[-1]:
            return  # beyond the predicted hours, as after a gap
        quantiles = np.array([np.interp(passed, hours, column) for column in table.T])
        value = float(measurement.value[number])
        usual = float(measurement.noise[number])
        sizes = np.sqrt([[usual], [usual + self._large**2]])
        shares = np.array([1.0 - self._rare, self._rare])
        below = [[_NORMAL.cdf(away) for away in row] for row in (value - quantiles) / sizes]
        self._add(1, number, float(shares @ np.mean(below, axis=1)))
        if not self._grows[slot, number]:
            return
        middle = np.median(quantiles)
        away = value - middle - WIDTHS[:, None] * (quantiles - middle)
        of_sizes = np.mean(np.exp(-0.5 * (away / sizes[..., None]) ** 2), axis=2) / sizes
        # Four overlapping predictions cover each hour of growth.
        gain = np.log(np.maximum(shares @ of_sizes, LEAST_PROBABILITY)) / _PENDING
        evidence = self._log_widths[number] - LOG_PRIOR
        log_widths = LOG_PRIOR + _KEPT * evidence + gain
        self._log_widths[number] = log_widths - log_widths.max()

    @property
    def is_due(self) -> bool:
        """Whether a prediction must be stored after the latest test."""
        return self._tests % EVERY == 0 and self._tests >= EVERY

    def hours_ahead(self, hours: float) -> Array:
        """Return the horizons at which to predict, ``(m,)`` [h], given the current service hour."""
        interval = (hours - self._first_hours) / max(self._tests - 1, 1)
        return max(interval, 1e-3) * AHEAD * _LADDER

    def keep(self, since: Array, ahead: Array, samples: Array, shown: Flags, grows: Flags) -> None:
        """Store a prediction for later evaluation.

        Parameters
        ----------
        since, ahead
            Current growth hours of each component, ``(7,)`` [h], and the horizons from
            ``hours_ahead``, ``(m,)`` [h].
        samples
            Predicted signed distances from healthy, ``(m, 7, n)``.
        shown, grows
            Components with a known level, and components considered growing, ``(7,)``.
        """
        slot = (self._tests // EVERY) % _SLOTS
        self._since[slot], self._ahead[slot] = since, ahead
        within = np.clip(samples, -_FARTHEST, _FARTHEST)
        self._quantiles[slot] = np.moveaxis(np.quantile(within, _QUANTILES, axis=2), 0, 2)
        self._made[slot], self._open[slot], self._grows[slot] = self._tests, shown, grows

    def widening(self) -> Array:
        """Return the width factor of each component's intervals, at least 1, ``(7,)`` [-]."""
        p = np.exp(self._log_widths - self._log_widths.max(axis=1, keepdims=True))
        return np.maximum(np.exp(p @ np.log(WIDTHS) / p.sum(axis=1)), 1.0)

    def of(self, number: int) -> TrackRecord:
        """Return the scores of the past predictions of a component."""
        counts, sums = self._scores[:, number, 0], self._scores[:, number, 1]
        one_step, ahead = (
            math.sqrt(total / count) if count >= _LEAST else math.nan
            for count, total in zip(counts.tolist(), sums.tolist(), strict=True)
        )
        widening = math.nan if math.isnan(ahead) else float(self.widening()[number])
        return TrackRecord(one_step, ahead, widening)


def widened_lives(hours: Array, factor: Array) -> Array:
    """Return remaining lives [h], widened around the median of each component.

    Lives of a component whose median is 0 or infinite are unchanged.

    Parameters
    ----------
    hours
        Samples of the remaining lives, ``(7, n)`` [h].
    factor
        Factor applied to the spread of the log-lives, at least 1, ``(7,)`` [-].
    """
    middle = np.quantile(hours, 0.5, axis=1, keepdims=True, method="inverted_cdf")
    result = hours.copy()
    for number in np.flatnonzero((factor > 1.0) & np.isfinite(middle[:, 0]) & (middle[:, 0] > 0.0)):
        result[number] = middle[number] * (hours[number] / middle[number]) ** factor[number]
    return result


def widened(values: Array, factor: Array) -> Array:
    """Return samples, ``(m, 7, n)``, spread about their median by ``factor``, ``(7,)``."""
    within = np.clip(values, -_FARTHEST, _FARTHEST)
    middle = np.median(within, axis=2, keepdims=True)
    return middle + factor[:, None] * (within - middle)
