# SPDX-License-Identifier: Apache-2.0
"""Bayesian tracker of the growth of an actuator's faults (P5 to P9).

Each component has a bank of Gaussian filters on a grid of laws, shapes and rates (``bank``), and
Kalman filters for periodic disturbances (``waves``). A grid is preferred to a particle filter for
three reasons. For a given law, shape and rate, the state is a scalar that a Gaussian describes
well; static parameters would make particles degenerate; and the update is deterministic.
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ema_core.arrays import Array, Flags
from ema_core.expecting import require_type, value_or_default
from ema_core.faults import (
    COMPONENTS,
    ECCENTRICITY_PHASE,
    FAULTS,
    HIGHEST,
    INDICES,
    N_FAULTS,
    healthy_faults,
)
from ema_core.wording import counted
from ema_monitor.health import ONE_SIDED_95, HealthLimits
from ema_monitor.prognosis.duty.course import STEADY, FutureDuty
from ema_monitor.prognosis.growth.check import SAMPLES, PredictionCheck, widened, widened_lives
from ema_monitor.prognosis.growth.fleet_prior import GrownFault, grown_faults
from ema_monitor.prognosis.growth.forecast import draw, futures, lives
from ema_monitor.prognosis.growth.kept import Kept
from ema_monitor.prognosis.growth.measurement import HEALTHY, Measurement
from ema_monitor.prognosis.growth.mechanisms import MECHANISMS, Mechanisms
from ema_monitor.prognosis.growth.mixture import Mixture
from ema_monitor.prognosis.growth.outliers import GrowthEvent, OutlierDetector
from ema_monitor.prognosis.growth.prediction import (
    BEGINS_BELOW,
    ENDS_ABOVE,
    FAN_LEVELS,
    LEAST_TESTS,
    NOT_SHOWN,
    Fan,
    Prognosis,
    TrackedFault,
    beyond_horizon,
    growth_not_certain,
    prognosis_of,
    too_soon_after,
)
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings

KEPT_AFTER_STEP: Final = 0.5
"""Exponent of the evidence about laws and rates that is retained after a step [-]."""

MOST_RANDOM: Final = 0.5
"""Probability of growth by jumps or drift above which a step counts as growth [-]."""


class Tracker(Kept):
    """Tracks the faults of an actuator from test to test and predicts its remaining life.

    Parameters
    ----------
    limits
        End-of-life limits.
    settings
        Assumptions about growth; by default, no law is known.
    mechanisms
        Growth mechanisms considered for faults of unknown law.
    outliers
        Outlier detector; a new ``OutlierDetector`` by default.
    check
        Calibration check, which widens intervals; a new ``PredictionCheck`` by default.

    Attributes
    ----------
    hours
        Service hour of the latest test [h]; NaN before the first.
    updates
        Number of tests processed so far.

    Notes
    -----
    Predictions are seeded with the number of tests, so that replaying a history reproduces them
    exactly.
    """

    kept = (
        "_tests",
        "_first_hours",
        "_growing",
        "_own_hours",
        "_phase",
        "_fell_at",
        "_tests_since_fall",
        "hours",
        "updates",
    )
    parts = ("_mixture", "_outliers", "_check")

    def __init__(
        self,
        limits: HealthLimits | None = None,
        settings: TrackerSettings | None = None,
        mechanisms: Mechanisms = MECHANISMS,
        outliers: OutlierDetector | None = None,
        check: PredictionCheck | None = None,
    ) -> None:
        self._limits = value_or_default("limits", limits, HealthLimits, HealthLimits)
        self._settings = value_or_default("settings", settings, TrackerSettings, TrackerSettings)
        self._mixture = Mixture(self._limits, self._settings, mechanisms)
        self._outliers = outliers or OutlierDetector(self._settings)
        self._check = check or PredictionCheck(self._settings)
        self._tests = np.zeros(len(COMPONENTS), dtype=np.intp)
        self._first_hours = np.full(len(COMPONENTS), np.nan)
        self._growing = np.zeros(len(COMPONENTS), dtype=bool)
        self._own_hours = np.full(len(COMPONENTS), np.nan)
        self._phase = float(FAULTS[ECCENTRICITY_PHASE].healthy)
        # Service hour of the latest decrease of a fault (NaN if none), and tests since then.
        self._fell_at, self._tests_since_fall = math.nan, 0
        self.updates = 0
        self.hours = math.nan

    def __repr__(self) -> str:
        latest = "" if math.isnan(self.hours) else f", latest at {self.hours:g} h"
        return f"<Tracker: {counted(self.updates, 'test')}{latest}>"

    def update(self, measurement: Measurement) -> list[GrowthEvent]:
        """Update the tracker with a test.

        Parameters
        ----------
        measurement
            The test. Intervals between tests may be irregular.

        Returns
        -------
        list of GrowthEvent
            Outliers, repairs and steps detected with this test.

        Raises
        ------
        ValueError
            If the service hour is before the latest test, or ``measurement`` is no `Measurement`.
        """
        require_type(
            "measurement", measurement, Measurement, "Measurement.of(estimate, hours) returns one"
        )
        if measurement.hours < self.hours:
            raise ValueError(
                f"hours = {measurement.hours:g} h: expected at least the hours of the latest test, "
                f"{self.hours:g} h"
            )
        elapsed = measurement.own_hours - self._own_hours
        self.hours, self._own_hours = measurement.hours, measurement.own_hours
        self.updates += 1
        if not measurement.unobservable[ECCENTRICITY_PHASE]:
            self._phase = float(measurement.faults[ECCENTRICITY_PHASE])
        floor = self._settings.sigma_floor**2 * np.eye(N_FAULTS)
        measurement = replace(measurement, covariance=measurement.covariance + floor)
        events = list[GrowthEvent]()
        if not self._tests.any():
            first, events = self._outliers.begin(measurement)
            if first is None:
                return events
            self._use(first)
            elapsed = measurement.own_hours - first.own_hours
        self._mixture.advance(elapsed)
        mean, variance = self._mixture.moments()
        odd, changed, held = self._outliers.judge(measurement, mean, variance, self._tests)
        for number in np.flatnonzero(changed):
            rose = abs(measurement.value[number]) > abs(mean[number])
            if rose and self._mixture.is_random()[number] > MOST_RANDOM:
                changed[number] = False  # the step is one of the jumps by which the fault grows
            else:
                self._restart(int(number), measurement, keep=KEPT_AFTER_STEP if rose else 0.0)
                if not rose:
                    self._fell_at, self._tests_since_fall = self.hours, 0
        if not held.all():
            self._tests_since_fall += 1
            self._use(measurement, changed, held)
        return events + odd

    def _use(
        self, measurement: Measurement, changed: Flags | bool = False, held: Flags | bool = False
    ) -> None:
        """Update with a test, except the components in ``held`` and in ``changed``.

        The components in ``changed`` have been reset to the test. They count as measured.
        """
        used = measurement.seen & ~np.logical_or(changed, held)
        first = used & (self._tests == 0)
        for number in np.flatnonzero(first):
            self._restart(int(number), measurement, keep=0.0)
        used &= ~first
        plain = used & ~measurement.near_healthy
        pit = self._mixture.measure(measurement, used)
        self._check.one_step(pit, plain)
        self._tests += measurement.seen & np.logical_not(held)
        constant = self._mixture.constant()
        begins = (constant < BEGINS_BELOW) & (self._tests >= LEAST_TESTS)
        self._growing = np.where(self._growing, constant < ENDS_ABOVE, begins)
        self._check.observe(measurement, plain)
        if self._check.is_due:
            self._keep_prediction(measurement.own_hours)

    def _keep_prediction(self, own_hours: Array) -> None:
        """Store a prediction, which later tests evaluate."""
        rng = np.random.default_rng([1, self.updates])
        sample = draw(self._mixture, SAMPLES, self._observed(), rng)
        ahead = self._check.hours_ahead(self.hours)
        away = futures(sample, ahead[:, None, None], rng)
        self._check.keep(own_hours, ahead, away, self._tests > 0, self._growing)

    def _restart(self, number: int, measurement: Measurement, keep: float) -> None:
        value, noise = float(measurement.value[number]), float(measurement.noise[number])
        self._mixture.restart(number, value, noise, keep=keep)
        self._check.restart(number, is_new=keep == 0.0)
        self._tests[number] = 0
        if keep == 0.0:
            self._first_hours[number] = measurement.own_hours[number]
            self._growing[number] = False

    def grown_faults(self) -> dict[str, GrownFault]:
        """Return the evidence about growing components, for fitting a fleet prior."""
        return grown_faults(self._mixture.bank.cells, self._mixture.weight, self._growing)

    def components(self) -> tuple[TrackedFault, ...]:
        """Return the tracked estimate of each component.

        Its figures are NaN before its first test.
        """
        (mean, variance), trend = self._mixture.moments(), self._mixture.trend()
        value = np.clip(HEALTHY + mean, 0.0, HIGHEST[INDICES])
        figures = np.array([value, np.sqrt(variance), trend])
        figures[:, self._tests == 0] = np.nan
        return tuple(
            TrackedFault(name, int(self._tests[i]), *figures[:, i].tolist(), track_record=record)
            for i, name in enumerate(COMPONENTS)
            for record in [self._check.of(i)]
        )

    def predict(self, duty: FutureDuty = STEADY) -> Prognosis:
        """Return the remaining useful life, counted from the latest test.

        Parameters
        ----------
        duty
            Assumed future duty; a factor of 2 halves all lives.

        Raises
        ------
        ValueError
            If ``duty`` is not a `FutureDuty`.
        """
        require_type("duty", duty, FutureDuty)
        rng = np.random.default_rng([0, self.updates])
        sample = draw(self._mixture, self._settings.samples, self._observed(), rng)
        fault_lives = widened_lives(lives(sample, rng), self._check.widening())
        hours = duty.hours_of(fault_lives)
        mean, variance = self._mixture.moments()
        limits = [self._limits.of(name) for name in COMPONENTS]
        is_shown = self._tests > 0
        is_over = is_shown & (np.abs(mean) - ONE_SIDED_95 * np.sqrt(variance) > limits)
        hours[is_over] = 0.0
        reasons = [
            "" if is_over[number] else self.unsupported or self._reason_unknown(number, samples)
            for number, samples in enumerate(fault_lives)
        ]
        return prognosis_of(self.hours, hours, is_shown, reasons, self._limits, duty, sample.x)

    @property
    def unsupported(self) -> str:
        """Reason why no life is predicted soon after a repair; "" after enough tests.

        A repair may have affected more than the faults that decreased, so earlier tests are no
        evidence about the growth of any fault of the repaired unit.
        """
        missing = LEAST_TESTS - self._tests_since_fall
        if math.isnan(self._fell_at) or missing <= 0:
            return ""
        return too_soon_after(self._fell_at, missing)

    def _reason_unknown(self, number: int, own_hours: Array) -> str:
        """Return the reason why the life of a component is unknown; empty if known."""
        tests = int(self._tests[number])
        if not tests:
            return NOT_SHOWN
        if not self._growing[number]:
            constant = float(self._mixture.constant()[number])
            return growth_not_certain(constant, tests)
        observed = float(self._observed()[number])
        return beyond_horizon(float(np.median(own_hours)), observed, tests, self._settings)

    def _observed(self) -> Array:
        """Return the observed hours of each component, ``(7,)`` [h]; 0 if it does not grow."""
        return np.where(self._growing, self._own_hours - self._first_hours, 0.0)

    def futures(self, hours: ArrayLike, n: int = 500, duty: FutureDuty = STEADY) -> Array:
        """Return samples of the future fault vectors.

        Parameters
        ----------
        hours
            Ascending hours from the latest test, at least 0, ``(m,)`` [h].
        n
            Number of samples.
        duty
            Assumed future duty; a factor of 2 doubles the growth.

        Returns
        -------
        numpy.ndarray
            Fault vectors within their valid range, ``(m, n, 8)``. The direction of eccentricity is
            taken from the latest test.

        Raises
        ------
        ValueError
            If the hours decrease or are negative.
        """
        times = np.atleast_1d(np.asarray(hours, dtype=np.float64))
        if times.ndim != 1 or not np.all(np.diff(times, prepend=0.0) >= 0.0):
            raise ValueError(f"hours = {hours} h: expected ascending numbers of at least 0")
        rng = np.random.default_rng([0, self.updates])
        sample = draw(self._mixture, n, self._observed(), rng)
        growth_hours = duty.own_hours(times, n)
        away = widened(futures(sample, growth_hours, rng), self._check.widening())
        vectors = np.tile(healthy_faults(), (times.size, n, 1))
        vectors[..., INDICES] += np.moveaxis(away, 1, 2)
        vectors[..., ECCENTRICITY_PHASE] = self._phase
        return np.clip(vectors, 0.0, HIGHEST)

    def fan(self, hours: ArrayLike, duty: FutureDuty = STEADY) -> Fan:
        """Return quantiles of ``futures`` for each component, for fan charts."""
        values = np.quantile(self.futures(hours, duty=duty), FAN_LEVELS, axis=1)
        return Fan(
            np.atleast_1d(np.asarray(hours, dtype=np.float64)),
            {name: values[..., i] for name, i in zip(COMPONENTS, INDICES, strict=True)},
        )
