# SPDX-License-Identifier: Apache-2.0
"""Events of a unit that the next outlook publishes."""

from collections import Counter
from collections.abc import Iterable
from typing import Final

from ema_monitor.prognosis.events import (
    CountIgnored,
    DuplicateIgnored,
    LateTestUsed,
    MonitorStarted,
    Note,
    Occurrence,
    UnitDeparted,
    UnitEvent,
)
from ema_monitor.prognosis.history_entry import Count

MOST_NOTES: Final = 50
"""Largest number of a person's notes between two valid tests."""

MOST_PERSONS: Final = 20
"""Largest number of persons with notes between two valid tests; limits the record of a test."""


class PendingEvents:
    """Events for the next outlook of a unit.

    Parameters
    ----------
    occurrences
        Occurrences before the first test.
    restarted
        Time at which a history was opened [ns], and its number of tests; None for no restart event.
    """

    def __init__(
        self, occurrences: Iterable[Occurrence] = (), restarted: tuple[int, int] | None = None
    ) -> None:
        self._occurrences = list(occurrences)
        self._events: list[UnitEvent] = []
        self._restarted = restarted
        self._ignores_usage = False

    def report(self, occurrences: Iterable[Occurrence]) -> None:
        """Add occurrences that a test shows; they become events of the latest test."""
        self._occurrences += occurrences

    def report_repeated(self) -> None:
        """Add the event that a test is already in the history."""
        self.report([DuplicateIgnored()])

    def report_late(self, late_s: float, departure: UnitDeparted | None) -> None:
        """Add the events of a valid test that is older than the latest test.

        Parameters
        ----------
        late_s
            Time from the test to the latest test [s].
        departure
            Departure in the test; None without a departure.
        """
        self.report([LateTestUsed(late_s)])
        if departure is not None:
            self.report([departure])

    def ignored_usage(self, count: Count | None, hours_per_cycle: float) -> list[Occurrence]:
        """Return the event that counts are ignored because ``hours_per_cycle`` is set, as a list.

        The list is empty if there is no count above 0 h, if the parameter is 0, or if the event was
        returned before.
        """
        if count is None or count.hours <= 0.0 or hours_per_cycle <= 0.0 or self._ignores_usage:
            return []
        self._ignores_usage = True
        return [CountIgnored(count.hours, hours_per_cycle)]

    def add(self, event: UnitEvent) -> None:
        """Add an event for the next outlook."""
        self._events.append(event)

    def add_note(
        self, note: Note, stamp_ns: int, hours: float, published: Iterable[UnitEvent]
    ) -> None:
        """Add a person's note on a test for the next outlook.

        Parameters
        ----------
        note
            The note.
        stamp_ns, hours
            Stamp of the test [ns] and its service hours [h].
        published
            Events of the newest test that are already published.

        Raises
        ------
        ValueError
            If the newest test already has too many notes.
        """
        _check_notes(note.person, [*self._events, *published])
        self.add(UnitEvent(stamp_ns, hours, note))

    def take_occurrences(self) -> list[Occurrence]:
        """Remove and return the occurrences, because each event is published once."""
        occurrences, self._occurrences = self._occurrences, []
        return occurrences

    def take_events(self, hours: float) -> list[UnitEvent]:
        """Remove and return the events, including a restart at the service hours ``hours`` [h]."""
        events, self._events = self._events, []
        if self._restarted is not None:
            opened_ns, tests = self._restarted
            self._restarted = None
            events.append(UnitEvent(opened_ns, hours, MonitorStarted(tests)))
        return events


def _check_notes(person: str, events: Iterable[UnitEvent]) -> None:
    """Raise ValueError if another note of a person would exceed the limits."""
    happened = (event.occurrence for event in events)
    notes = Counter(note.person for note in happened if isinstance(note, Note))
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
