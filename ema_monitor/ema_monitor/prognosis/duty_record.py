# SPDX-License-Identifier: Apache-2.0
"""Record of cumulative damage at each test of a unit."""

from collections.abc import Sequence

import numpy as np

from ema_core.arrays import Array
from ema_monitor.prognosis.duty.course import REFERENCE_TESTS, DutyCourse
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.service import TimedTest


class DutyRecord:
    """Cumulative damage at each test of a unit, from which the duty between tests is derived."""

    def __init__(self, settings: DamageSettings) -> None:
        self._settings = settings
        self._total = np.zeros(5)
        # Cumulative damage by the stamp of the test [ns].
        self._until: dict[int, Array] = {}

    def add(self, entry: Entry) -> None:
        """Add the next test."""
        self._total = self._total + self._settings.damage(entry.flown)
        self._until[entry.stamp_ns] = self._total

    def course(self, used: Sequence[TimedTest]) -> DutyCourse | None:
        """Return the duty between tests; None if it is known for too few intervals.

        The tests ``used`` must be in the order of their service hours.
        """
        if len(used) <= REFERENCE_TESTS or not self._total[0]:
            return None
        hours = np.array([test.hours for test in used])
        until = np.array([self._until[test.stamp_ns] for test in used])
        telemetry, travel, wear, warm, ageing = np.diff(until, axis=0).T
        elapsed = np.diff(hours)
        least = np.maximum(self._settings.least_coverage * elapsed, 1e-12)
        least = np.where(elapsed > 0.0, least, np.inf)
        # Telemetry beyond the service hours is ground operation; gaps are assumed to be similar.
        within = np.minimum(np.where(telemetry >= least, telemetry, np.nan), elapsed)
        ageing /= np.where(warm >= least, warm, np.nan)
        course = DutyCourse(
            self._settings, hours, np.stack([wear / within, ageing, travel / within])
        )
        return course if np.isfinite(course.reference).any() else None
