"""The tracker of a unit's growth, fed with the tests whose service hours are known."""

import math
from collections.abc import Iterable

from ema_core.faults import ECCENTRICITY_PHASE
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.outliers import OUTLIER
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.service import ServiceHours, TimedTest


class GrowthRecord:
    """Feeds a tracker with tests in the order of their service hours.

    When hours that were used are left out, a new tracker is fed with the others, so that what it
    knows depends on the tests alone.

    Parameters
    ----------
    limits, settings
        Those of the tracker.
    entries
        Tests so far.

    Attributes
    ----------
    tracker
        What is known of growth.
    service
        Service hours at the tests.
    doubtful
        Components that the latest test shows to be where growth does not explain them.
    phase
        Direction of eccentricity in the latest test, and its variance; NaN when unknown.
    """

    def __init__(
        self, limits: HealthLimits, settings: TrackerSettings, entries: Iterable[Entry] = ()
    ) -> None:
        self._limits, self._settings = limits, settings
        self.service = ServiceHours()
        for entry in entries:
            self.service.add(entry)
        self._restart()
        self._update()

    @property
    def latest_is_used(self) -> bool:
        """Whether the tracker was updated by the latest test."""
        return bool(self._fed) and self._fed[-1].entry is self.service.latest

    def add(self, entry: Entry) -> list[str]:
        """Add the next test; return its events, in words."""
        return [*self.service.add(entry), *self._update()]

    def _restart(self) -> None:
        self.tracker = Tracker(self._limits, self._settings)
        self.phase = (math.nan, math.nan)
        self.doubtful = frozenset[str]()
        self._fed: list[TimedTest] = []

    def _update(self) -> list[str]:
        """Feed the tracker with what is new; return the events of tests that are new to it."""
        used = self.service.used
        known = {test.entry.stamp_ns for test in self._fed}
        if used[: len(self._fed)] != self._fed:
            self._restart()
        events = [
            event
            for test in used[len(self._fed) :]
            for event in self._feed(test)
            if test.entry.stamp_ns not in known
        ]
        self._fed = list(used)
        if not self.latest_is_used:
            self.doubtful = frozenset()
        return events

    def _feed(self, test: TimedTest) -> list[str]:
        estimate = test.entry.estimate
        if not estimate.unobservable[ECCENTRICITY_PHASE]:
            self.phase = (
                float(estimate.faults[ECCENTRICITY_PHASE]),
                float(estimate.covariance[ECCENTRICITY_PHASE, ECCENTRICITY_PHASE]),
            )
        events = self.tracker.update(Measurement.of(estimate, test.hours))
        self.doubtful = frozenset(item.component for item in events if item.kind == OUTLIER)
        return [f"{item.kind}: {item.text}" for item in events]
