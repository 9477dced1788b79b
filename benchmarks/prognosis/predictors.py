# SPDX-License-Identifier: Apache-2.0
"""Predictors to score: the tracker with known and unknown laws, and an oracle."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import FAULT_NAMES, healthy_faults
from ema_core.growth_laws import hours_until
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import NOMINAL_LAWS, TrackerSettings
from ema_sim.growth import Growth
from ema_sim.lives import LifeSettings, SimulatedLife
from prognosis.lives import LIMITS

SETTINGS: Final[Mapping[str, TrackerSettings]] = {
    "law known": TrackerSettings(laws=NOMINAL_LAWS),
    "law unknown": TrackerSettings(),
}
"""Settings of the tracker: with known laws and typical rates, or with no assumption."""

_ORACLE_SAMPLES: Final = 1000


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predictions of the remaining useful life after each test [h]; NaN without a prediction."""

    hours: NDArray[np.float64]  # service hours of the tests, (n,)
    low: NDArray[np.float64]  # 5 % quantile, (n,)
    median: NDArray[np.float64]  # (n,)
    high: NDArray[np.float64]  # 95 % quantile, (n,)
    samples: NDArray[np.float64]  # samples of the distribution, (n, m)
    seconds: NDArray[np.float64]  # processor time from estimate to prediction [s], (n,)

    @classmethod
    def of(
        cls,
        measurements: Sequence[Measurement],
        samples: Sequence[NDArray[np.float64] | None],
        seconds: Sequence[float],
    ) -> "Predictions":
        """Return predictions from samples of the remaining life [h], ``(m,)`` per test or None."""
        size = next((len(drawn) for drawn in samples if drawn is not None), 1)
        rows = np.full((len(samples), size), np.nan)
        for number, drawn in enumerate(samples):
            if drawn is not None:
                rows[number] = drawn
        low, median, high = np.quantile(rows, [0.05, 0.5, 0.95], axis=1, method="inverted_cdf")
        hours = np.array([measurement.hours for measurement in measurements])
        return cls(hours, low, median, high, rows, np.array(seconds))

    def since(self, start_hours: float) -> "Predictions":
        """Return the predictions from a service hour [h] on, with hours counted from it."""
        later = self.hours >= start_hours
        made = {item.name: getattr(self, item.name)[later] for item in fields(self)}
        return Predictions(**{**made, "hours": made["hours"] - start_hours})


def predicted(
    measurements: Sequence[Measurement], after: Callable[[int], NDArray[np.float64] | None]
) -> Predictions:
    """Return the timed predictions after each test.

    ``after`` maps the number of a test to samples of the remaining life [h], ``(m,)``, or None.
    """
    samples, seconds = [], []
    for number in range(len(measurements)):
        start = time.process_time()
        samples.append(after(number))
        seconds.append(time.process_time() - start)
    return Predictions.of(measurements, samples, seconds)


Predictor = Callable[[SimulatedLife, Sequence[Measurement]], Predictions]


def tracked(measurements: Sequence[Measurement], settings: TrackerSettings) -> Predictions:
    """Return the predictions of a tracker after each test."""
    tracker = Tracker(HealthLimits(), settings)

    def after(number: int) -> NDArray[np.float64] | None:
        tracker.update(measurements[number])
        prognosis = tracker.predict()
        return prognosis.samples if prognosis.overall.known else None

    return predicted(measurements, after)


def law_known(_: SimulatedLife, measurements: Sequence[Measurement]) -> Predictions:
    """Return the predictions of a tracker that knows laws and typical rates."""
    return tracked(measurements, SETTINGS["law known"])


def law_unknown(_: SimulatedLife, measurements: Sequence[Measurement]) -> Predictions:
    """Return the predictions of a tracker with default settings."""
    return tracked(measurements, SETTINGS["law unknown"])


def oracle(life: SimulatedLife, measurements: Sequence[Measurement]) -> Predictions:
    """Return the best possible predictions, with only the future process noise unknown.

    The oracle knows the true faults, laws, rates and hours of onset. To first order in the noise of
    the increments, the hours until a limit are inverse Gaussian; for the law "drift" this is exact.
    """
    rng = np.random.default_rng(0)

    def after(number: int) -> NDArray[np.float64] | None:
        hours = measurements[number].hours
        at = int(np.searchsorted(life.hours, hours))
        lives = np.full(_ORACLE_SAMPLES, np.inf)
        for name, growth in life.growths.items():
            column = FAULT_NAMES.index(name)
            away = float(life.faults[at, column] - healthy_faults()[column])
            passage = _passage(growth, away, LIMITS[name], rng)
            lives = np.minimum(lives, max(growth.onset - hours, 0.0) + passage)
        return lives if life.growths else None

    return predicted(measurements, after)


def _passage(
    growth: Growth, away: float, limit: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return samples of the hours of growth until a limit [h]."""
    if growth.law == "drift":
        left = limit - np.sign(growth.rate) * away
        rate = abs(growth.rate)
        return rng.wald(left / rate, (left / growth.noise) ** 2, _ORACLE_SAMPLES)
    needed = float(hours_until(growth.law, abs(away), growth.rate, growth.shape, limit))
    mean = np.exp(0.5 * growth.noise**2)
    variance = mean**2 * np.expm1(growth.noise**2) * LifeSettings().interval_hours
    return rng.wald(needed / mean, needed**2 / variance, _ORACLE_SAMPLES)
