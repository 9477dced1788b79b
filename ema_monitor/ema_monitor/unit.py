"""State of a unit: from estimates and counts of service to health and remaining life."""

import math
import threading
from bisect import bisect
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from heapq import nlargest
from itertools import islice
from typing import Final, NamedTuple

from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN
from ema_core.parameters import ActuatorParameters
from ema_core.wording import counted
from ema_monitor.health import warned
from ema_monitor.identification.estimate import DEPARTED, FAILED, REFUSED, SKIPPED, Estimate
from ema_monitor.joint.comparison import FRICTION
from ema_monitor.prognosis.assessing import assessment_of
from ema_monitor.prognosis.confirmation import confirmed
from ema_monitor.prognosis.duty.damage import NOTHING_FLOWN, FlownDuty
from ema_monitor.prognosis.duty.scenario import NotComparableError, Scenario
from ema_monitor.prognosis.forecaster import Forecaster, outlook_of
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import (
    CALIBRATION,
    DEPARTURE,
    FAULT,
    GAP,
    HISTORY,
    NOTE,
    OTHER,
    RESTART,
    SERVICE_HOURS,
    Assessment,
    Count,
    Entry,
    Finding,
    UnitEvent,
    UnusedCycle,
)
from ema_monitor.prognosis.intermittent import LATEST_TESTS, Intermittent
from ema_monitor.prognosis.notes import Notes
from ema_monitor.prognosis.order import Place, is_after_step, moved, place_of
from ema_monitor.prognosis.outlook import Claim, Outlook, unknown_outlook
from ema_monitor.prognosis.requirements.requirements import (
    WITHOUT_MODEL,
    RequirementLimits,
    requirements_of,
)
from ema_monitor.prognosis.sentences import (
    cause_of_level,
    failures_in_words,
    label_of,
    recurrence_in_words,
)
from ema_monitor.prognosis.service import CountLog
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.prognosis.shown import LastShown, recent_faults, recent_from_ns

SHOWN_SHARE: Final = 0.05
"""Share of its limit above which a fault is named in a baseline change [-]."""

KEPT_EVERY: Final = 50
"""Number of tests between two stored tracker states (0.8 MB each)."""


class KnownTest(NamedTuple):
    """A valid test with its results."""

    entry: Entry
    hours: float
    """Service hours at the test [h]; NaN if unknown."""
    assessment: Assessment | None
    """Assessment after the test, or None."""


class Unit:
    """Follows a unit from test to test; thread-safe.

    The outlook depends only on the tests in the history and on the settings: a replay of the same
    tests, or of the history after a restart, gives the same outlook. The newest test gives the
    level, whether it is valid or refused. Tests are ordered by stamp, or by reception where stamps
    go back (``place_of``). In a recording, a late test is inserted into the growth at its stamp,
    which may move the value of a fault within its sigma.

    Parameters
    ----------
    history
        Tests so far.
    settings
        Initial settings.
    opened_ns
        Time at which a history with tests was opened, which becomes an event [ns]; None for no
        such event.
    author
        Node that publishes the outlooks; empty for a command.

    Attributes
    ----------
    history
        Tests so far, with their assessments.
    growth
        Growth of the faults by the tests so far.
    """

    def __init__(
        self,
        history: History,
        settings: PrognosisSettings | None = None,
        opened_ns: int | None = None,
        author: str = "",
    ) -> None:
        self.history = history
        self._author = author
        # Stamp of the newest test received since the start, its reception [ns], and whether live.
        self._received = 0, 0, False
        # Latest time of the tests from before a step of the clock [ns].
        self._step_ns = 0
        # Outlook by the valid tests; None once settings or tests have changed.
        self._by_valid: Outlook | None = None
        self._lock = threading.RLock()
        self._settings = settings = settings or PrognosisSettings()
        self.growth = self._growth_of_all(history.growth)
        self._shown = self._shown_by_all()
        self._intermittent = self._intermittent_by_all()
        history.growth = b""
        # Number of tests in the stored state of the tracker.
        self._kept_tests = self.growth.kept_tests
        self._notes = Notes()
        self._findings = [Finding(HISTORY, history.problem)] if history.problem else []
        self._ignores_usage = False
        # Time at which the history was opened, and its number of tests.
        self._restarted = None
        if opened_ns is not None and history.entries:
            self._restarted = opened_ns, len(history.entries)

    def update(
        self,
        estimate: Estimate,
        parameters: ActuatorParameters | None,
        settings: PrognosisSettings,
        count: Count | None = None,
        flown: FlownDuty = NOTHING_FLOWN,
        received_ns: int = 0,
        is_live: bool = False,
    ) -> Outlook | None:
        """Record the estimate of a test and return the resulting outlook.

        The result is None if the window was skipped, or is refused and older than the newest test.
        If the order of tests is unknown, the test is refused.

        Parameters
        ----------
        estimate
            Estimate of its window.
        parameters
            Parameters of the unit; None if unknown.
        settings
            Settings to use from this test on.
        count
            Latest count of service hours read before the test, or None.
        flown
            Known duty since the previous test, valid or not.
        received_ns
            Reception time on the receiver's clock [ns]; 0 for a recording.
        is_live
            Whether the test was received live; it is then the newest test.

        Notes
        -----
        A repeated test is ignored, unless it was refused before and now has a valid estimate. It
        then does not count as another cycle. A test whose service hours are unknown or not yet
        confirmed is stored but does not enter the prognosis.
        """
        with self._lock:
            self._apply(settings)
            place = self._place_of(estimate, received_ns, is_live)
            estimate = moved(estimate, place.shift_ns)
            if not place.is_known:
                received = estimate.end_ns, received_ns, is_live
                self._received = max(self._received, received)
            is_new = not self.history.holds(estimate.end_ns)
            if place.problem or not estimate.valid:
                test = UnusedCycle.of(estimate, flown, place.shift_ns)
                test = replace(test, is_ordered=place.is_ordered)
                if place.problem:
                    test = UnusedCycle(
                        estimate.end_ns,
                        REFUSED,
                        (place.problem,),
                        flown,
                        shift_ns=place.shift_ns,
                        is_ordered=False,
                    )
                return self._refuse(test, parameters) if is_new and not place.is_known else None
            latest = self.growth.service.latest
            if place.is_known:
                text = "a test that is in the history already came again and changes nothing"
                self._findings.append(Finding(OTHER, text))
            elif latest is not None and estimate.end_ns < latest.stamp_ns:
                self._add_late(estimate, latest, count, flown)
            else:
                cycles = len(self.history.unused) + is_new
                flown = self.history.unused_duty + flown
                entry, findings = self._entry(estimate, cycles, count, flown)
                entry = replace(entry, shift_ns=place.shift_ns)
                before = self.history.newest
                if estimate.verdict == DEPARTED and not (before and before.verdict == DEPARTED):
                    findings.append(Finding(DEPARTURE, estimate.departure))
                try:
                    findings += self.growth.add(entry)
                except Exception:
                    # The test enters neither growth nor history.
                    self._recompute_growth()
                    raise
                self.history.append(entry)
                self._shown.add(estimate)
                self._findings += [
                    Finding(FAULT, recurrence_in_words(name, self._intermittent.faults[name]))
                    for name in self._intermittent.add(estimate)
                ]
                self._findings += findings
            return self._outlook_with_events(parameters)

    def _place_of(self, estimate: Estimate, received_ns: int, is_live: bool) -> Place:
        """Return the position of a test among the recorded tests."""
        newest, newest_ns = self.history.newest, 0
        if newest is not None and self._received[0] == newest.stamp_ns:
            newest_ns = self._received[1]
        by_clock = self._settings.has_clock
        return place_of(estimate, self.history, received_ns, newest_ns, by_clock, is_live)

    def _refuse(self, test: UnusedCycle, parameters: ActuatorParameters | None) -> Outlook | None:
        """Record a test without a valid estimate. Return the outlook if the test is the newest."""
        before = self.history.newest
        self.history.append(test)
        is_newest = self.history.newest is test
        if test.verdict == FAILED:
            self._by_valid = None
            if is_newest:
                self._intermittent.add_failure(test.stamp_ns)
            else:
                self._intermittent = self._intermittent_by_all()
        if not is_newest:
            return None
        if self._by_valid is None:
            self._by_valid = self._outlook(parameters)
        outlook = self._claimed(self._by_valid)
        is_repeated = before is not None and before.verdict == test.verdict
        if test.verdict not in (FAILED, DEPARTED) or is_repeated:
            return outlook
        kind = DEPARTURE if test.verdict == DEPARTED else FAULT
        event = UnitEvent(test.end_ns, outlook.hours, kind, test.reason)
        return replace(outlook, events=(event,))

    def _add_late(
        self, estimate: Estimate, latest: Entry, count: Count | None, flown: FlownDuty
    ) -> None:
        """Record a valid test that is older than the latest one, between its neighbours."""
        entries = self.history.entries
        place = bisect(entries, estimate.end_ns, key=lambda entry: entry.stamp_ns)
        before, after = entries[place - 1] if place else None, entries[place]
        cycles = min(before.cycles + 1, after.cycles) if before else max(after.cycles - 1, 1)
        hours, each = math.nan, self._settings.service.hours_per_cycle
        if each > 0.0:
            begin = before.hours + each if before else max(after.hours - each, 0.0)
            hours, count = min(begin, after.hours), None
        else:
            count = _later(count, before.count if before else None, estimate.end_ns)
        entries_before = len(entries)
        self.history.append(Entry(estimate, hours, cycles, count, flown))
        self._shown.add(estimate)
        self._intermittent = self._intermittent_by_all()
        if len(entries) > entries_before:
            self._recompute_growth()
        late_s = (latest.stamp_ns - estimate.end_ns) * 1e-9
        text = (
            f"a test came late, {late_s:g} s older than the latest one: it counts for growth; "
            "the latest one gives the level"
        )
        self._findings.append(Finding(OTHER, text))
        if estimate.verdict == DEPARTED:
            self._findings.append(Finding(DEPARTURE, estimate.departure))

    def follow(
        self,
        estimates: Iterable[Estimate],
        parameters: ActuatorParameters | None,
        settings: PrognosisSettings,
        counts: Sequence[Count] = (),
        flown: Sequence[tuple[int, FlownDuty]] = (),
    ) -> Iterator[tuple[Estimate, Outlook | None]]:
        """Call ``update`` for each estimate; yield the estimate with its outlook.

        Parameters
        ----------
        estimates, counts
            Tests, and counts of service life, each in order of time.
        parameters
            Parameters of the unit; None if unknown.
        settings
            Settings to use.
        flown
            Duty up to the end of each window, by stamp [ns], in order of time.
        """
        # The log is limited: at each test it has only the counts that precede the test.
        waiting, log, pieces = deque(counts), CountLog(), deque(flown)
        for estimate in estimates:
            while waiting and waiting[0].stamp_ns <= estimate.end_ns:
                log.add(self.history.unit, waiting.popleft())
            count, duty = log.latest(self.history.unit, estimate.end_ns), NOTHING_FLOWN
            while pieces and pieces[0][0] <= estimate.end_ns:
                duty += pieces.popleft()[1]
            yield estimate, self.update(estimate, parameters, settings, count, duty)

    def write(self) -> None:
        """Store the growth state after every ``KEPT_EVERY`` tests."""
        with self._lock:
            # Under the lock: the state must include all tests of the history.
            if not 0 <= self.growth.tests - self._kept_tests < KEPT_EVERY:
                self.history.keep_growth(self.growth.state())
                self._kept_tests = self.growth.tests

    def resume(
        self, parameters: ActuatorParameters | None, settings: PrognosisSettings
    ) -> Outlook | None:
        """Return the outlook after the latest recorded test; None if there is none."""
        with self._lock:
            self._apply(settings)
            return self._outlook_with_events(parameters) if self.history.newest else None

    def rewind(self, time_ns: int) -> None:
        """Discard tests and assessments later than ``time_ns`` after simulated time jumped back."""
        with self._lock:
            tests, assessments = self.history.tests, self.history.assessments
            self.history.close()
            self.history = History(*self.history.unit)
            for test in tests:
                if test.stamp_ns <= time_ns:
                    self.history.append(test)
            for stamp_ns, assessment in assessments.items():
                if stamp_ns <= time_ns:
                    self.history.assess(assessment)
            self._received, self._by_valid = (0, 0, False), None
            self._shown = self._shown_by_all()
            self._intermittent = self._intermittent_by_all()
            self._recompute_growth()

    def note(self, person: str, text: str, stamp_ns: int = 0) -> None:
        """Add a person's note on the event of a test.

        The next outlook has the note as an event; ``resume`` returns an outlook at once.

        Parameters
        ----------
        person, text
            Author and text of the note.
        stamp_ns
            Stamp of the test [ns]; 0 for the newest valid test.

        Raises
        ------
        ValueError
            If there is no valid test yet, or the newest valid test has too many notes.
        """
        with self._lock:
            if not self.history.entries:
                raise ValueError("there is no history yet: no valid test so far")
            newest_ns, assessments = self.history.entries[-1].stamp_ns, self.history.assessments
            newest, noted = assessments.get(newest_ns), assessments.get(stamp_ns or newest_ns)
            hours, published = noted.hours if noted else math.nan, newest.events if newest else ()
            self._notes.add_note(person, text, stamp_ns or newest_ns, hours, published)
            self._intermittent.acknowledge(self._time_of(stamp_ns) if stamp_ns else newest_ns)

    def alarm(self, parameters: ActuatorParameters | None, settings: PrognosisSettings) -> str:
        """Return the cause of a WARN or ERROR, even if the level has expired; "" if none."""
        with self._lock:
            self._apply(settings)
            if self.history.newest is None:
                return ""
            outlook = self._claimed(self._by_valid or self._outlook(parameters))
            if outlook.known_level not in (WARN, ERROR):
                return ""
            return cause_of_level(outlook) or f"its level is {LEVEL_NAMES[outlook.known_level]}"

    def change_baseline(self, person: str, calibration_id: str) -> bool:
        """Record that a person changed the unit's calibration. Return whether it was recorded.

        The change becomes an event of the newest valid test; without a valid test it is not
        recorded. The next outlook has the event; ``resume`` returns an outlook at once.
        """
        with self._lock:
            if not self.history.entries:
                return False
            newest = self.history.entries[-1]
            items = self._by_valid.health.faults if self._by_valid else ()
            seen = [f"{label_of(i.name)} {i.value:.3f}" for i in items if i.share > SHOWN_SHARE]
            before = ", ".join(seen) or "no fault above 5 % of its limit"
            text = (
                f"baseline changed by {person}: {calibration_id} instead of "
                f"{newest.estimate.calibration_id}, which showed {before}"
            )
            worn = calibration_id if seen else ""
            assessment = self.history.assessments.get(newest.stamp_ns)
            hours = assessment.hours if assessment else math.nan
            self._notes.add(UnitEvent(newest.stamp_ns, hours, CALIBRATION, text, person, worn))
            return True

    def outlook(
        self, parameters: ActuatorParameters | None, settings: PrognosisSettings
    ) -> Outlook:
        """Return the outlook under different settings, such as another duty, without recording it.

        Raises
        ------
        ValueError
            If there is no history.
        """
        with self._lock:
            self._apply(settings)
            if not self.history.entries:
                raise ValueError("there is no history yet: no valid test so far")
            return self._claimed(self._outlook(parameters))

    def under(
        self, scenario: Scenario, parameters: ActuatorParameters | None, settings: PrognosisSettings
    ) -> Outlook:
        """Return the outlook under a scenario without recording it.

        The outlook is unknown, with the reason, if the scenario cannot be compared with the duty
        flown.

        Raises
        ------
        ValueError
            If there is no history.
        """
        with self._lock:
            try:
                return self.outlook(parameters, replace(settings, scenario=scenario))
            except NotComparableError as error:
                return unknown_outlook(str(error))
            finally:
                self._settings = settings

    def latest_tests(self, most: int) -> tuple[list[KnownTest], int]:
        """Return the latest valid tests, oldest first, and the number of omitted earlier tests.

        Parameters
        ----------
        most
            Largest number of tests to return.
        """
        with self._lock:
            both = [*self.history.entries, *self.history.late]
            entries = sorted(both, key=lambda entry: entry.stamp_ns)
            hours, assessments = self.growth.service.by_stamp(), self.history.assessments
            left_out = max(0, len(entries) - most)
            tests = [
                KnownTest(
                    entry, hours.get(entry.stamp_ns, math.nan), assessments.get(entry.stamp_ns)
                )
                for entry in entries[left_out:]
            ]
            return tests, left_out

    def forecaster(self, outlook: Outlook) -> Forecaster | None:
        """Return a fault forecaster that continues an outlook, independent of later tests.

        The result is None if a later test has been added since the outlook.
        """
        with self._lock:
            latest, tracker = self.growth.service.latest, self.growth.tracker
            if latest is None or latest.end_ns != outlook.stamp_ns:
                return None
            is_known = bool(tracker.updates) and not self.growth.service.unknown
            frozen = tracker.frozen() if is_known else None
            return Forecaster(outlook, frozen, self._settings.limits)

    def _apply(self, settings: PrognosisSettings) -> None:
        """Apply settings. If the tracker's assumptions change, recompute the growth."""
        old, self._settings = self._settings, settings
        if old != settings:
            self._by_valid = None
        if old.limits != settings.limits:
            self._shown = self._shown_by_all()
            self._intermittent = self._intermittent_by_all()
        is_other_fleet = old.fleet is not settings.fleet
        assumed = (settings.limits, settings.tracker, settings.damage)
        if is_other_fleet or (old.limits, old.tracker, old.damage) != assumed:
            self._recompute_growth()

    def _growth_of_all(self, kept: bytes = b"") -> GrowthRecord:
        """Return the growth from all tests, resumed from a matching stored state if possible."""
        settings = self._settings
        tracker, self._fleet_in_words = settings.tracker, ""
        if settings.fleet is not None:
            try:
                fleet = settings.fleet.prior(settings.limits, without=self.history.unit)
                tracker, self._fleet_in_words = replace(tracker, fleet=fleet), fleet.in_words()
            except ValueError as error:
                self._fleet_in_words = f"the fleet is not used: {error}"
        entries = self.history.entries
        return GrowthRecord(settings.limits, tracker, entries, kept, settings.damage)

    def _shown_by_all(self) -> LastShown:
        return LastShown(self._settings.limits, (*self.history.entries, *self.history.late))

    def _intermittent_by_all(self) -> Intermittent:
        """Return the intermittent faults from all tests and their notes."""
        result = Intermittent(self._settings.limits)
        # A note holds from the test on that it is about, or with which it is kept.
        notes = deque(
            sorted(
                (max(stamp_ns, self._time_of(event.stamp_ns)), self._time_of(event.stamp_ns))
                for stamp_ns, assessment in self.history.assessments.items()
                for event in assessment.events
                if event.kind == NOTE
            )
        )
        for test in sorted(self.history.tests, key=lambda test: test.stamp_ns):
            if isinstance(test, Entry):
                result.add(test.estimate)
            elif test.verdict == FAILED:
                result.add_failure(test.stamp_ns)
            while notes and notes[0][0] <= test.stamp_ns:
                result.acknowledge(notes.popleft()[1])
        return result

    def _time_of(self, end_ns: int) -> int:
        """Return the time of the test that ends at ``end_ns``, or else ``end_ns``."""
        every = reversed(self.history.tests)
        return next((test.stamp_ns for test in every if test.end_ns == end_ns), end_ns)

    def _recompute_growth(self) -> None:
        self.growth = self._growth_of_all()
        self._kept_tests = 0

    def _outlook_with_events(self, parameters: ActuatorParameters | None) -> Outlook:
        outlook = self._by_valid = self._outlook(parameters)
        if not self.history.entries:
            return self._claimed(outlook)
        # The latest test's assessment if it is assessed again, else the previous test's.
        assessments = self.history.assessments
        stamps_ns = (entry.stamp_ns for entry in reversed(self.history.entries[-2:]))
        before = next((assessments[ns] for ns in stamps_ns if ns in assessments), None)
        assessment = assessment_of(outlook, before, self._findings, self._further_events(outlook))
        # Each finding is published once.
        self._findings = []
        self.history.assess(assessment)
        published = before.events if before else ()
        shift_ns = self.history.entries[-1].shift_ns
        new = tuple(
            replace(event, stamp_ns=event.stamp_ns - shift_ns)
            if event.stamp_ns == outlook.stamp_ns
            else event
            for event in assessment.events
            if event not in published
        )
        return replace(self._claimed(outlook), events=new)

    def _claimed(self, outlook: Outlook) -> Outlook:
        """Return the outlook from the valid tests, adapted to the newest test, with validity."""
        newest = self.history.newest
        if newest is None:
            return outlook
        received_ns, is_live = 0, False
        if self._received[0] == newest.stamp_ns:
            _, received_ns, is_live = self._received
        claim = Claim(
            newest.end_ns, received_ns, self._author, self._settings.good_for_s, is_live=is_live
        )
        if self.history.entries:
            measured_ns = outlook.stamp_ns - self.history.entries[-1].shift_ns
            outlook = replace(outlook, stamp_ns=measured_ns)
        is_ok = outlook.health.level == OK
        if is_ok and isinstance(newest, Entry) and not newest.estimate.is_of_record:
            claim = claim._replace(oldest_ns=self._shown.oldest_ns() - newest.shift_ns)
        if isinstance(newest, UnusedCycle):
            outlook = outlook.after_refusal(newest)
        return replace(outlook, claim=claim)

    def _outlook(self, parameters: ActuatorParameters | None) -> Outlook:
        """Return the outlook from the valid tests."""
        if not self.history.entries:
            return unknown_outlook("no valid test so far")
        wanted, requirements = self._settings.requirements, None
        if parameters is not None:
            requirements = requirements_of(parameters, wanted)
        elif wanted != RequirementLimits() or not self.history.entries[-1].estimate.is_of_record:
            requirements = WITHOUT_MODEL
        entries, shown = self.history.entries, self._shown.estimates
        from_ns = recent_from_ns(entries, self._settings.good_for_s)
        recent = recent_faults(shown, max(from_ns, self._since_step_ns(from_ns)))
        outlook = outlook_of(
            self.growth, self._settings, requirements, shown, recent, self._intermittent.faults
        )
        outlook = self._after_failures(self._confirmed(outlook))
        # Laplace's rule gives the probability that a test has no valid estimate.
        missing = max(entries[-1].cycles - entries[0].cycles + 1 - len(entries), 0)
        reason = "; ".join(filter(None, [outlook.health.reason, self._worn_baseline()]))
        return replace(
            outlook,
            health=replace(outlook.health, reason=reason),
            assumption="; ".join(filter(None, [outlook.assumption, self._fleet_in_words])),
            failed_since=self._failed_since(outlook),
            last_level=self._last_level(outlook),
            missing_share=(missing + 1) / (missing + len(entries) + 2),
        )

    def _worn_baseline(self) -> str:
        """Return who set the current baseline while the unit was worn, or ""."""
        newest = _baseline(self.history.entries[-1])
        earlier = (entry for entry in reversed(self.history.entries) if _baseline(entry) != newest)
        before = next(earlier, None)
        assessment = self.history.assessments.get(before.stamp_ns) if before else None
        events = assessment.events if assessment else ()
        texts = [event.text for event in events if event.worn_baseline == newest]
        return texts[-1] if texts else ""

    def mark_clock_step(self, until_ns: int | None = None) -> None:
        """Do not count the faults that tests up to a time have shown as shown recently.

        Their stamps are from before a clock stepped back, so that their age is not known.

        Parameters
        ----------
        until_ns
            Latest time of these tests [ns]; all tests so far by default.
        """
        with self._lock:
            stamps_ns = (test.stamp_ns for test in self.history.tests)
            before_ns = (ns for ns in stamps_ns if until_ns is None or ns <= until_ns)
            self._step_ns = max(self._step_ns, max(before_ns, default=0))
            self._by_valid = None

    def _since_step_ns(self, from_ns: int) -> int:
        """Return the time of the first test after the latest clock step, at least ``from_ns``."""
        from_ns = max(from_ns, self._step_ns + 1)
        by_clock, after = self._settings.has_clock, None
        for test in reversed(self.history.tests):
            if test.verdict == SKIPPED:
                continue
            if after is not None and is_after_step(after, test, by_clock):
                return after.stamp_ns
            if test.stamp_ns < from_ns:
                break
            after = test
        return from_ns

    def _confirmed(self, outlook: Outlook) -> Outlook:
        """Return the outlook with earlier levels and departures kept until tests confirm their end.

        ``level_confirmations`` consecutive tests confirm the end. Records without a judgement do
        not count.
        """
        newest = self.history.entries[-1].estimate
        earlier = (
            entry for entry in reversed(self.history.entries[:-1]) if _counts(entry.estimate)
        )
        assessments = (self.history.assessments.get(entry.stamp_ns) for entry in earlier)
        needed = islice(filter(None, assessments), self._settings.level_confirmations - 1)
        outlook = confirmed(outlook, needed)
        if newest.comparison is None or outlook.health.level != OK:
            return outlook
        judged = filter(_is_judged, (entry.estimate for entry in reversed(self.history.entries)))
        latest = islice(judged, self._settings.level_confirmations)
        departure = next((estimate.departure for estimate in latest if estimate.departure), "")
        if not departure:
            return outlook
        words = f"{departure}, in an earlier record: the next record must confirm that it has ended"
        return replace(outlook, health=warned(outlook.health), departure=words)

    def _after_failures(self, outlook: Outlook) -> Outlook:
        """Return the outlook with an earlier failure kept until tests confirm its end.

        The end is confirmed by ``level_confirmations`` tests in a row. An intermittent failure must
        be acknowledged by a person.
        """
        judged = (
            test for test in self.history.tests if isinstance(test, Entry) or test.verdict == FAILED
        )
        needed = self._settings.level_confirmations
        latest = nlargest(max(needed, LATEST_TESTS), judged, key=lambda test: test.stamp_ns)
        tests_since, reason = next(
            (
                (since, test.reason)
                for since, test in enumerate(latest)
                if isinstance(test, UnusedCycle)
            ),
            (len(latest), ""),
        )
        recurrence = self._intermittent.failure
        if recurrence is not None:
            words = failures_in_words(reason, recurrence)
        elif reason and tests_since < needed:
            words = f"{reason}, in an earlier test: the next test must confirm that it has ended"
        else:
            return outlook
        departure = "; ".join(filter(None, [outlook.departure, words]))
        return replace(outlook, health=warned(outlook.health), departure=departure)

    def _last_level(self, outlook: Outlook) -> int:
        """Return the last known level before a STALE outlook; STALE for any other outlook."""
        if outlook.health.level == STALE:
            for entry in reversed(self.history.entries):
                assessment = self.history.assessments.get(entry.stamp_ns)
                is_earlier = entry.stamp_ns < outlook.stamp_ns
                if is_earlier and assessment is not None and assessment.level != STALE:
                    return assessment.level
        return STALE

    def _failed_since(self, outlook: Outlook) -> float:
        """Return the service hour at which the current run of ERROR tests started [h]."""
        if outlook.health.level != ERROR:
            return math.nan
        since = outlook.hours
        for entry in reversed(self.history.entries):
            if entry.stamp_ns != outlook.stamp_ns:
                assessment = self.history.assessments.get(entry.stamp_ns)
                if assessment is None or assessment.level != ERROR:
                    break
                since = assessment.hours
        return since

    def _further_events(self, outlook: Outlook) -> list[UnitEvent]:
        """Return events not derived from tests: notes, a restart, and a changed calibration."""
        events, entries = self._notes.take(), self.history.entries
        if self._restarted:
            opened_ns, tests = self._restarted
            self._restarted = None
            text = f"the monitor started and read {counted(tests, 'valid test')}"
            events.append(UnitEvent(opened_ns, outlook.hours, RESTART, text))
        if len(entries) > 1 and outlook.stamp_ns not in self.history.assessments:
            old, new = (entry.estimate.calibration_id for entry in entries[-2:])
            if old != new:
                text = f"{new} instead of {old}"
                events.append(UnitEvent(outlook.stamp_ns, outlook.hours, CALIBRATION, text))
        return events

    def _entry(
        self, estimate: Estimate, new_cycles: int, count: Count | None, flown: FlownDuty
    ) -> tuple[Entry, list[Finding]]:
        """Return the history entry of a test, with findings on ignored counts and missed tests."""
        latest = self.growth.service.latest
        each = self._settings.service.hours_per_cycle
        cycles = new_cycles + (latest.cycles if latest else 0)
        hours, newest, findings = math.nan, None, list[Finding]()
        if each > 0.0:
            hours = self.growth.service.after(cycles, each)
            if count is not None and not self._ignores_usage:
                self._ignores_usage = True
                text = f"usage is ignored, {count.hours:g} h: hours_per_cycle = {each:g} h is set"
                findings.append(Finding(SERVICE_HOURS, text))
        else:
            before = latest.count if latest else None
            # After a restart, the latest count may be found in the history only.
            newest = _later(count, before, estimate.end_ns)
            if newest is not None and newest != before:
                cycles = newest.cycles or cycles
        missed = cycles - latest.cycles - 1 if latest else 0
        if missed > 0:
            text = f"{counted(missed, 'test')} without a valid estimate before this one"
            findings.append(Finding(GAP, text))
        return Entry(estimate, hours, cycles, newest, flown), findings


def _baseline(entry: Entry) -> str:
    return entry.estimate.calibration_id


def _counts(estimate: Estimate) -> bool:
    """Return whether a test counts for the confirmation of a lower level."""
    return estimate.comparison is None or _is_judged(estimate)


def _is_judged(estimate: Estimate) -> bool:
    """Return whether a record shows a departure or determines the friction."""
    compared = estimate.comparison
    return compared is not None and (compared.has_departed or compared[FRICTION].is_judged)


def _later(first: Count | None, second: Count | None, end_ns: int) -> Count | None:
    """Return the later of two counts that was read before the end of a test [ns]."""
    read = [count for count in (first, second) if count and count.stamp_ns <= end_ns]
    return max(read, key=lambda count: count.stamp_ns, default=None)
