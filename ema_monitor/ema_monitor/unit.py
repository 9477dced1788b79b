# SPDX-License-Identifier: Apache-2.0
"""State of a unit: health and remaining life from estimates and service-life counts."""

import math
import threading
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from ema_core.expecting import require_type, value_or_default
from ema_core.levels import ERROR, LEVEL_NAMES, OK, WARN
from ema_core.parameters import ActuatorParameters
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.prognosis.assessing import assessment_of
from ema_monitor.prognosis.baseline_changes import baseline_change, other_calibration, worn_baseline
from ema_monitor.prognosis.duty.damage import NOTHING_FLOWN, FlownDuty
from ema_monitor.prognosis.duty.scenario import NotComparableError, Scenario
from ema_monitor.prognosis.earlier_levels import failed_since, last_level, with_unconfirmed_levels
from ema_monitor.prognosis.event_texts import text_of
from ema_monitor.prognosis.events import (
    FaultRecurred,
    HistoryDamaged,
    Note,
    Occurrence,
    UnitDeparted,
    UnitEvent,
    UnitFailed,
)
from ema_monitor.prognosis.failures import with_earlier_failure
from ema_monitor.prognosis.forecaster import Forecaster, outlook_of
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Assessment, Count, Entry, UnusedCycle
from ema_monitor.prognosis.intermittent import Intermittent, intermittent_of
from ema_monitor.prognosis.new_entries import late_entry, next_entry
from ema_monitor.prognosis.order import Place, moved, place_of, since_clock_step_ns
from ema_monitor.prognosis.outlook import Claim, Outlook, unknown_outlook
from ema_monitor.prognosis.pending_events import PendingEvents
from ema_monitor.prognosis.requirements.requirements import (
    WITHOUT_MODEL,
    RequirementLimits,
    Unmonitored,
    requirements_of,
)
from ema_monitor.prognosis.sentences import cause_of_level
from ema_monitor.prognosis.service import CountLog
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.prognosis.shown import LastShown, recent_faults, recent_from_ns

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
    """Health and remaining life of a unit, updated by its tests; thread-safe.

    The outlook depends only on the tests in the history and on the settings: a replay of the same
    tests, or of the history after a restart, gives the same outlook. The newest test gives the
    level, whether it is valid or refused. Tests are ordered by stamp, or by reception if stamps go
    back (``place_of``). In a recording, a late test is inserted into the growth at its stamp, which
    may change the value of a fault within its sigma.

    Parameters
    ----------
    history
        Tests so far.
    settings
        Initial settings.
    opened_ns
        Time at which a history with tests was opened [ns], for a restart event; None for no event.
    author
        Node that publishes the outlooks; empty for a command.

    Attributes
    ----------
    history
        Tests so far, with their assessments.
    growth
        Growth of the faults over the tests so far.
    """

    def __init__(
        self,
        history: History,
        settings: PrognosisSettings | None = None,
        opened_ns: int | None = None,
        author: str = "",
    ) -> None:
        require_type("history", history, History, "History(actuator_id, serial_number)")
        self.history = history
        self._author = author
        # Newest test received since the start: stamp, reception time [ns], and whether it was live.
        self._received = 0, 0, False
        # Time of the latest test before a step of the clock [ns].
        self._step_ns = 0
        # Outlook from the valid tests; None after settings or tests have changed.
        self._by_valid: Outlook | None = None
        self._lock = threading.RLock()
        settings = value_or_default("settings", settings, PrognosisSettings, PrognosisSettings)
        self._settings = settings
        self.growth = self._growth_of_all(history.growth)
        self._shown = self._shown_by_all()
        self._intermittent = self._intermittent_by_all()
        history.growth = b""
        # Number of tests in the stored state of the tracker.
        self._kept_tests = self.growth.kept_tests
        problems = [HistoryDamaged(history.problem)] if history.problem else []
        restarted = None
        if opened_ns is not None and history.entries:
            restarted = opened_ns, len(history.entries)
        self._pending = PendingEvents(problems, restarted)

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

        The result is None if the window was skipped, or if it is refused and either recorded
        already or older than the newest test. If the order of tests is unknown, the test is
        refused.

        Parameters
        ----------
        estimate
            Estimate of its window.
        parameters
            Parameters of the unit; None if unknown.
        settings
            Settings to use from this test on.
        count
            Latest count of service hours that was read before the test, or None.
        flown
            Known duty since the previous test, valid or not.
        received_ns
            Reception time on the receiver's clock [ns]; 0 for a recording.
        is_live
            Whether the test was received live; it is then the newest test.

        Notes
        -----
        A duplicate test is ignored, unless it was refused before and now has a valid estimate. It
        then does not count as another cycle. A test whose service hours are unknown or not yet
        confirmed is stored, but not used in the prognosis.
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
                        Verdict.REFUSED,
                        (place.problem,),
                        flown,
                        shift_ns=place.shift_ns,
                        is_ordered=False,
                    )
                return self._refuse(test, parameters) if is_new and not place.is_known else None
            latest = self.growth.service.latest
            if place.is_known:
                self._pending.report_repeated()
            elif latest is not None and estimate.end_ns < latest.stamp_ns:
                self._add_late(estimate, latest, count, flown)
            else:
                cycles = len(self.history.unused) + is_new
                flown = self.history.unused_duty + flown
                service = self.growth.service
                hours_per_cycle = self._settings.service.hours_per_cycle
                occurrences = self._pending.ignored_usage(count, hours_per_cycle)
                entry, missing = next_entry(
                    estimate, service, hours_per_cycle, cycles, count, flown, place.shift_ns
                )
                occurrences += missing
                before = self.history.newest
                had_departed = before is not None and before.verdict == Verdict.DEPARTED
                if estimate.verdict == Verdict.DEPARTED and not had_departed:
                    occurrences.append(_departure(estimate))
                try:
                    occurrences += self.growth.add(entry)
                except Exception:
                    # The test enters neither growth nor history.
                    self._recompute_growth()
                    raise
                self.history.append(entry)
                self._shown.add(estimate)
                intermittent = self._intermittent.faults
                if is_new:
                    self._intermittent.add(estimate)
                else:
                    self._intermittent = self._intermittent_by_all()
                self._pending.report(
                    FaultRecurred(name, recurrence)
                    for name, recurrence in self._intermittent.faults.items()
                    if name not in intermittent
                    or (intermittent[name].tests_left and not recurrence.tests_left)
                )
                self._pending.report(occurrences)
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
        if test.verdict == Verdict.FAILED:
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
        if test.verdict not in (Verdict.FAILED, Verdict.DEPARTED) or is_repeated:
            return outlook
        occurrence: Occurrence = UnitFailed(test.reasons)
        if test.verdict == Verdict.DEPARTED:
            occurrence = UnitDeparted(test.reasons)
        event = UnitEvent(test.end_ns, outlook.flight_hours, occurrence)
        return replace(outlook, events=(event,))

    def _add_late(
        self, estimate: Estimate, latest: Entry, count: Count | None, flown: FlownDuty
    ) -> None:
        """Record a valid test that is older than the latest test."""
        entries, hours_per_cycle = self.history.entries, self._settings.service.hours_per_cycle
        entry = late_entry(estimate, entries, hours_per_cycle, count, flown)
        entries_before = len(entries)
        self.history.append(entry)
        self._shown.add(estimate)
        self._intermittent = self._intermittent_by_all()
        if len(entries) > entries_before:
            self._recompute_growth()
        late_s = (latest.stamp_ns - estimate.end_ns) * 1e-9
        departure = _departure(estimate) if estimate.verdict == Verdict.DEPARTED else None
        self._pending.report_late(late_s, departure)

    def follow(
        self,
        estimates: Iterable[Estimate],
        parameters: ActuatorParameters | None,
        settings: PrognosisSettings,
        counts: Sequence[Count] = (),
        flown: Sequence[tuple[int, FlownDuty]] = (),
    ) -> Iterator[tuple[Estimate, Outlook | None]]:
        """Yield each estimate with the outlook that ``update`` returns for it.

        Parameters
        ----------
        estimates, counts
            Tests and service-life counts, each in order of time.
        parameters
            Parameters of the unit; None if unknown.
        settings
            Settings to use.
        flown
            Pairs of a window's end stamp [ns] and the duty since the previous window, in order of
            time.
        """
        # The log is bounded: at each test, it contains only the counts that precede the test.
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
        """Discard tests and assessments after ``time_ns``, to which simulated time jumped back."""
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

    def note(self, person: str, text: str, stamp_ns: int = 0, time_ns: int = 0) -> None:
        """Add a person's note on an event of a test.

        The next outlook contains the note as an event; ``resume`` returns an outlook at once.

        Parameters
        ----------
        person, text
            Author and text of the note.
        stamp_ns
            Stamp of the test [ns]; 0 for the newest valid test.
        time_ns
            Time at which the note was written, since 1970, UTC [ns]; 0 if unknown.

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
            hours, published = (
                noted.flight_hours if noted else math.nan,
                newest.events if newest else (),
            )
            note = Note(person, text, time_ns)
            self._pending.add_note(note, stamp_ns or newest_ns, hours, published)
            self._intermittent.acknowledge(
                self.history.time_of(stamp_ns) if stamp_ns else newest_ns
            )

    def alarm(self, parameters: ActuatorParameters | None, settings: PrognosisSettings) -> str:
        """Return the cause of a WARN or ERROR, even if the level has expired; else ""."""
        with self._lock:
            self._apply(settings)
            if self.history.newest is None:
                return ""
            outlook = self._claimed(self._by_valid or self._outlook(parameters))
            if outlook.known_level not in (WARN, ERROR):
                return ""
            return cause_of_level(outlook) or f"its level is {LEVEL_NAMES[outlook.known_level]}"

    def change_baseline(
        self, person: str, calibration_id: str, time_ns: int = 0, *, is_forced: bool = False
    ) -> bool:
        """Record that a person changed the unit's calibration. Return whether it was recorded.

        The change becomes an event of the newest valid test; without a valid test it is not
        recorded. The next outlook contains the event; ``resume`` returns an outlook at once.

        Parameters
        ----------
        person, time_ns, is_forced
            Author, time and acceptance of the change, see `BaselineChanged`.
        calibration_id
            Identity of the new calibration; empty after a reset.
        """
        with self._lock:
            if not self.history.entries:
                return False
            faults = self._by_valid.health.faults if self._by_valid else ()
            self._pending.add(
                baseline_change(
                    calibration_id, self.history, faults, person, time_ns, is_forced=is_forced
                )
            )
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

        The outlook is unknown, with the reason, if the scenario cannot be compared with the flown
        duty.

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
            valid_tests = [*self.history.entries, *self.history.late]
            entries = sorted(valid_tests, key=lambda entry: entry.stamp_ns)
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
        """Return a forecaster of the faults as they were at an outlook.

        Tests that are added later do not change it. The result is None if a test has been added
        since the outlook.
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
        tracker, self._fleet_text = settings.tracker, ""
        if settings.fleet is not None:
            try:
                fleet = settings.fleet.prior(settings.limits, without=self.history.unit)
                tracker, self._fleet_text = replace(tracker, fleet=fleet), fleet.text()
            except ValueError as error:
                self._fleet_text = f"the fleet is not used: {error}"
        entries = self.history.entries
        return GrowthRecord(settings.limits, tracker, entries, kept, settings.damage)

    def _shown_by_all(self) -> LastShown:
        return LastShown(self._settings.limits, (*self.history.entries, *self.history.late))

    def _intermittent_by_all(self) -> Intermittent:
        return intermittent_of(self.history, self._settings.limits)

    def _recompute_growth(self) -> None:
        self.growth = self._growth_of_all()
        self._kept_tests = 0

    def _outlook_with_events(self, parameters: ActuatorParameters | None) -> Outlook:
        outlook = self._by_valid = self._outlook(parameters)
        if not self.history.entries:
            return self._claimed(outlook)
        # Assessment of the latest test if it is assessed again, else of the previous test.
        assessments = self.history.assessments
        stamps_ns = (entry.stamp_ns for entry in reversed(self.history.entries[-2:]))
        before = next((assessments[ns] for ns in stamps_ns if ns in assessments), None)
        events = self._pending.take_events(outlook.flight_hours)
        events += other_calibration(outlook, self.history)
        assessment = assessment_of(outlook, before, self._pending.take_occurrences(), events)
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
        """Return an outlook adapted to the newest test, with its validity."""
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
            tested_ns = outlook.stamp_ns - self.history.entries[-1].shift_ns
            outlook = replace(outlook, stamp_ns=tested_ns)
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
        limits, requirements = self._settings.requirements, Unmonitored()
        if parameters is not None:
            requirements = requirements_of(parameters, limits)
        elif limits != RequirementLimits() or not self.history.entries[-1].estimate.is_of_record:
            requirements = WITHOUT_MODEL
        entries, shown = self.history.entries, self._shown.estimates
        from_ns = recent_from_ns(entries, self._settings.good_for_s)
        from_ns = max(from_ns, self._step_ns + 1)
        from_ns = since_clock_step_ns(self.history.tests, from_ns, self._settings.has_clock)
        recent = recent_faults(shown, from_ns)
        outlook = outlook_of(
            self.growth, self._settings, requirements, shown, recent, self._intermittent.faults
        )
        needed = self._settings.level_confirmations
        outlook = with_unconfirmed_levels(outlook, self.history, needed)
        failure = self._intermittent.failure
        outlook = with_earlier_failure(outlook, self.history, failure, needed)
        # Laplace's rule gives the probability that a test has no valid estimate.
        missing = max(entries[-1].cycles - entries[0].cycles + 1 - len(entries), 0)
        worn = worn_baseline(self.history)
        reasons = [outlook.health.reason, text_of(worn) if worn else ""]
        reason = "; ".join(filter(None, reasons))
        return replace(
            outlook,
            health=replace(outlook.health, reason=reason),
            assumption="; ".join(filter(None, [outlook.assumption, self._fleet_text])),
            failed_since=failed_since(outlook, self.history),
            last_level=last_level(outlook, self.history),
            missing_share=(missing + 1) / (missing + len(entries) + 2),
        )

    def mark_clock_step(self, until_ns: int | None = None) -> None:
        """Treat faults that were shown by tests up to a time as not shown recently.

        These tests were stamped before a clock stepped back, so that their age is unknown.

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


def _departure(estimate: Estimate) -> UnitDeparted:
    """Return the event of a valid estimate whose verdict is a departure."""
    return UnitDeparted(estimate.reasons, estimate.comparison)
