"""The tests that tell how the faults of a unit grow, and the tracker that they feed."""

import math
from collections.abc import Iterable

from ema_core.faults import ECCENTRICITY_PHASE
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.events import OUTLIER
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.measurement import Measurement
from ema_monitor.prognosis.service_order import ServiceOrder
from ema_monitor.prognosis.settings import TrackerSettings
from ema_monitor.prognosis.tracker import Tracker
from ema_monitor.prognosis.usage import UNKNOWN_HOURS, stopped_count


class GrowthRecord:
    """Feeds a tracker with the tests whose service hours can be believed.

    A test without service hours tells nothing of growth. Once hours are counted, those that were
    guessed by ``hours_per_cycle`` are not used. Of those whose hours contradict each other,
    ``ServiceOrder`` says which are used, and whether the last one waits to be confirmed; when that
    changes for tests that the tracker was told, all is told to a new one. What it knows depends on
    the tests alone, not on when they were told.

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
        First and latest test that the tracker was told; None when there is none.
    latest
        Latest test, told or not; None before any.
    left_out
        Why the tracker was not told the latest test; empty when it was.
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
        self._counted = False
        # Test cycles at the first test with the count of the latest one.
        self._count_since = 0
        self.latest: Entry | None = None
        self.left_out = ""
        for entry in entries:
            self._place(entry)
        self._begin_anew()
        self._tell()

    @property
    def in_use(self) -> list[Entry]:
        """Tests that the tracker has been told."""
        return [self._tests[number] for number in self._told]

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
        told = self._place(entry)
        return [*told, *self._tell()]

    def _place(self, entry: Entry) -> list[str]:
        """Note a test, and find out whether it is used; return what is odd about its hours."""
        if self.latest is None or entry.count != self.latest.count:
            self._count_since = entry.cycles
        self.latest = entry
        self.left_out = ""
        if math.isnan(entry.hours):
            tests = entry.cycles - self._count_since + 1
            self.left_out = stopped_count(tests) if entry.count else UNKNOWN_HOURS
            return []
        if self._counted and entry.count is None:
            self.left_out = (
                "the service hours of the test are guessed by hours_per_cycle, and those of others "
                "are counted: the test is left out of the prognosis"
            )
            return [self.left_out]
        told = []
        if not self._counted and entry.count is not None:
            told = self._forget_guessed()
        self._tests.append(entry)
        if revoked := self._order.add(entry.hours):
            told.append(self._revocation(revoked))
        self.left_out = self._contradiction() or self._jump()
        return [*told, self.left_out] if self.left_out else told

    def _forget_guessed(self) -> list[str]:
        """Go by counted hours from now on."""
        guessed, self._tests = len(self._tests), []
        self._order = ServiceOrder()
        self._counted = True
        if not guessed:
            return []
        self._begin_anew()
        which = "the test before, whose hours were guessed by hours_per_cycle, is left out"
        if guessed > 1:
            which = (
                f"the {guessed} tests before, whose hours were guessed by hours_per_cycle, are "
                "left out"
            )
        return [f"service hours are counted from now on: {which}"]

    def _contradiction(self) -> str:
        """Return why the latest test is not used, if those that are contradict it."""
        latest_used = self._order.used[-1]
        in_a_row = len(self._tests) - 1 - latest_used
        if not in_a_row:
            return ""
        highest = self._tests[latest_used].hours
        reason = (
            f"service hours went back from {highest:g} h to {self._tests[-1].hours:g} h: the test "
            "is left out of the prognosis"
        )
        if in_a_row > 1:
            reason += (
                f", as {in_a_row - 1} before it; a count that began anew must go on from "
                f"{highest:g} h, and a new unit needs a serial number of its own"
            )
        return reason

    def _jump(self) -> str:
        """Return why the latest test waits, if it does."""
        if not self._order.is_waiting:
            return ""
        before, latest = (self._tests[number].hours for number in self._order.used[-2:])
        return (
            f"service hours jumped from {before:g} h to {latest:g} h, more than ten times the "
            "longest interval so far: the test waits for the next one to confirm it"
        )

    def _begin_anew(self) -> None:
        """Begin with a tracker that knows of no test."""
        self.tracker = Tracker(self._limits, self._settings)
        self.first: Entry | None = None
        self.used: Entry | None = None
        self.phase = (math.nan, math.nan)
        self.doubtful = frozenset[str]()
        self._told: list[int] = []

    def _tell(self) -> list[str]:
        """Tell the tracker what it is to know; return the events of tests that are new to it."""
        before, wanted = self._told, self._order.confirmed
        if wanted[: len(before)] != before:
            self._begin_anew()
        self.doubtful = frozenset[str]()
        events = []
        for number in wanted[len(self._told) :]:
            found = self._feed(self._tests[number])
            if number not in before:
                events += found
        self._told = wanted
        if self.left_out:
            self.doubtful = frozenset()
        return events

    def _feed(self, entry: Entry) -> list[str]:
        self.first = self.first or entry
        self.used = entry
        estimate = entry.estimate
        if not estimate.unobservable[ECCENTRICITY_PHASE]:
            self.phase = (
                float(estimate.faults[ECCENTRICITY_PHASE]),
                float(estimate.covariance[ECCENTRICITY_PHASE, ECCENTRICITY_PHASE]),
            )
        events = self.tracker.update(Measurement.of(estimate, entry.hours))
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
