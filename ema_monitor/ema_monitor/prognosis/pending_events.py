# SPDX-License-Identifier: Apache-2.0
"""Events and findings of a unit that the next outlook publishes."""

from collections import Counter
from collections.abc import Iterable
from typing import Final

from ema_core.wording import counted
from ema_monitor.prognosis.history_entry import (
    DEPARTURE,
    NOTE,
    OTHER,
    RESTART,
    SERVICE_HOURS,
    Count,
    Finding,
    UnitEvent,
)

MOST_NOTES: Final = 50
"""Largest number of a person's notes between two valid tests."""

MOST_PERSONS: Final = 20
"""Largest number of persons with notes between two valid tests; limits the record of a test."""


class PendingEvents:
    """Events and findings for the next outlook of a unit.

    Parameters
    ----------
    findings
        Findings before the first test.
    restarted
        Time at which a history was opened [ns], and its number of tests; None for no restart event.
    """

    def __init__(
        self, findings: Iterable[Finding] = (), restarted: tuple[int, int] | None = None
    ) -> None:
        self._findings = list(findings)
        self._events: list[UnitEvent] = []
        self._restarted = restarted
        self._ignores_usage = False

    def report(self, findings: Iterable[Finding]) -> None:
        """Add the findings of a test."""
        self._findings += findings

    def report_repeated(self) -> None:
        """Add the finding that a test is already in the history."""
        text = "duplicate test ignored: it is already in the history"
        self.report([Finding(OTHER, text)])

    def report_late(self, late_s: float, departure: str) -> None:
        """Add the findings of a valid test that is older than the latest test.

        Parameters
        ----------
        late_s
            Time from the test to the latest test [s].
        departure
            Departure in the test; empty without a departure.
        """
        text = (
            f"a test arrived late, {late_s:g} s older than the latest test: it is used for growth; "
            "the latest test determines the level"
        )
        self.report([Finding(OTHER, text)])
        if departure:
            self.report([Finding(DEPARTURE, departure)])

    def ignored_usage(self, count: Count | None, hours_per_cycle: float) -> list[Finding]:
        """Return the finding that counts are ignored, once, if ``hours_per_cycle`` is set."""
        if count is None or hours_per_cycle <= 0.0 or self._ignores_usage:
            return []
        self._ignores_usage = True
        text = (
            f"usage is ignored, {count.hours:g} h: hours_per_cycle = {hours_per_cycle:g} h is set"
        )
        return [Finding(SERVICE_HOURS, text)]

    def add(self, event: UnitEvent) -> None:
        """Add an event for the next outlook."""
        self._events.append(event)

    def add_note(
        self, person: str, text: str, stamp_ns: int, hours: float, published: Iterable[UnitEvent]
    ) -> None:
        """Add a person's note on a test for the next outlook.

        Parameters
        ----------
        person, text
            Author and text of the note.
        stamp_ns, hours
            Stamp of the test [ns] and its service hours [h].
        published
            Events of the newest test that are already published.

        Raises
        ------
        ValueError
            If the newest test already has too many notes.
        """
        _check_notes(person, [*self._events, *published])
        self.add(UnitEvent(stamp_ns, hours, NOTE, f"{person}, {text}", person))

    def take_findings(self) -> list[Finding]:
        """Remove and return the findings, because each finding is published once."""
        findings, self._findings = self._findings, []
        return findings

    def take_events(self, hours: float) -> list[UnitEvent]:
        """Remove and return the events, including a restart at the service hours ``hours`` [h]."""
        events, self._events = self._events, []
        if self._restarted is not None:
            opened_ns, tests = self._restarted
            self._restarted = None
            text = f"the monitor started and read {counted(tests, 'valid test')}"
            events.append(UnitEvent(opened_ns, hours, RESTART, text))
        return events


def _check_notes(person: str, events: Iterable[UnitEvent]) -> None:
    """Raise ValueError if another note of a person would exceed the limits."""
    notes = Counter(event.person for event in events if event.kind == NOTE)
    if notes[person] >= MOST_NOTES:
        raise ValueError(
            f"the newest test already has {MOST_NOTES} notes of {person}; add further notes "
            "after the next valid test"
        )
    if person not in notes and len(notes) >= MOST_PERSONS:
        raise ValueError(
            f"the newest test already has notes of {MOST_PERSONS} persons other than {person}; "
            "add further notes after the next valid test"
        )
