"""The tests that tell how the faults of a unit grow, and the tracker that they feed."""

import math
from collections.abc import Iterable

from ema_core.faults import ECCENTRICITY_PHASE
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.events import OUTLIER
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.observation import Observation
from ema_monitor.prognosis.service_order import ServiceOrder
from ema_monitor.prognosis.settings import TrackerSettings
from ema_monitor.prognosis.tracker import Tracker
from ema_monitor.prognosis.usage import UNKNOWN_HOURS


class GrowthRecord:
    """Feeds a tracker with the tests whose service hours can be believed.

    A test without service hours tells nothing of growth. Of those whose hours contradict each
    other, ``ServiceOrder`` says which are used; when that changes for earlier tests, all is told
    to a new tracker. What it knows depends on the tests alone, not on when they were told.

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
    first, used
        First and latest test in use; None when there is none.
    latest
        Latest test, in use or not; None before any.
    left_out
        Why the latest test is not in use; empty when it is.
    doubtful
        Components that the latest test shows to be where growth does not explain them.
    phase
        Direction of eccentricity, as the latest test tells it, and its variance; NaN when unknown.
    """

    def __init__(
        self, limits: HealthLimits, settings: TrackerSettings, entries: Iterable[Entry] = ()
    ) -> None:
        self._limits, self._settings = limits, settings
        self._tests: list[Entry] = []
        self._order = ServiceOrder()
        self.latest: Entry | None = None
        self.left_out = ""
        for entry in entries:
            self._place(entry)
        self._begin_anew()

    @property
    def in_use(self) -> list[Entry]:
        """Tests that the tracker has been told."""
        return [self._tests[number] for number in self._order.used]

    def take(self, entry: Entry) -> list[str]:
        """Take the next test.

        Parameters
        ----------
        entry
            The test.

        Returns
        -------
        list of str
            What is odd about it, in words.
        """
        in_use = set(self._order.used)
        revoked = self._place(entry)
        self.doubtful = frozenset[str]()
        if math.isnan(entry.hours):
            return []
        if self.left_out:
            return [self.left_out]
        if not revoked:
            return self._feed(entry)
        told = [self._revocation(revoked)]
        for number, events in self._begin_anew().items():
            if number not in in_use:
                told += events
        return told

    def _place(self, entry: Entry) -> list[int]:
        """Note a test, and find out whether it is used; return which ones no longer are."""
        self.latest = entry
        if math.isnan(entry.hours):
            self.left_out = UNKNOWN_HOURS
            return []
        self._tests.append(entry)
        revoked = self._order.add(entry.hours)
        self.left_out = ""
        latest_used = self._order.used[-1]
        if in_a_row := len(self._tests) - 1 - latest_used:
            highest = self._tests[latest_used].hours
            self.left_out = (
                f"service hours went back from {highest:g} h to {entry.hours:g} h: the test is "
                "left out of the prognosis"
            )
            if in_a_row > 1:
                self.left_out += (
                    f", as {in_a_row - 1} before it; a count that began anew must go on from "
                    f"{highest:g} h, and a new unit needs a serial number of its own"
                )
        return revoked

    def _begin_anew(self) -> dict[int, list[str]]:
        """Tell all tests in use to a new tracker; return the events of each by its number."""
        self.tracker = Tracker(self._limits, self._settings)
        self.first: Entry | None = None
        self.used: Entry | None = None
        self.phase = (math.nan, math.nan)
        self.doubtful = frozenset[str]()
        told = {number: self._feed(self._tests[number]) for number in self._order.used}
        if self.left_out:
            self.doubtful = frozenset()
        return told

    def _feed(self, entry: Entry) -> list[str]:
        self.first = self.first or entry
        self.used = entry
        estimate = entry.estimate
        if not estimate.unobservable[ECCENTRICITY_PHASE]:
            self.phase = (
                float(estimate.faults[ECCENTRICITY_PHASE]),
                float(estimate.covariance[ECCENTRICITY_PHASE, ECCENTRICITY_PHASE]),
            )
        events = self.tracker.update(Observation.of(estimate, entry.hours))
        self.doubtful = frozenset(item.component for item in events if item.kind == OUTLIER)
        return [f"{item.kind}: {item.text}" for item in events]

    def _revocation(self, revoked: list[int]) -> str:
        first, last = self._tests[revoked[0]], self._tests[revoked[-1]]
        which = f"{first.hours:g} h at test {first.cycles}"
        if len(revoked) > 1:
            which = (
                f"{first.hours:g} h to {last.hours:g} h at {len(revoked)} tests, "
                f"{first.cycles} to {last.cycles},"
            )
        since = [self._tests[number] for number in self._order.used if number > revoked[-1]]
        return (
            f"service hours {which} revoked: {len(since)} tests since then, from "
            f"{since[0].hours:g} h on, contradict them"
        )
