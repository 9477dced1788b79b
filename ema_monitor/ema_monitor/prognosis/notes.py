"""Notes of persons that wait for the next outlook of a unit."""

from collections import Counter
from collections.abc import Iterable
from typing import Final

from ema_monitor.prognosis.history_entry import NOTE, UnitEvent

MOST_NOTES: Final = 50
"""Notes of one person between one valid test and the next."""

MOST_PERSONS: Final = 20
"""Persons with notes between one valid test and the next, which bounds the record of a test."""


class Notes:
    """Events by persons that no outlook has yet."""

    def __init__(self) -> None:
        self._waiting: list[UnitEvent] = []

    def add(self, event: UnitEvent) -> None:
        """Keep an event for the next outlook."""
        self._waiting.append(event)

    def add_note(
        self, person: str, text: str, stamp_ns: int, hours: float, published: Iterable[UnitEvent]
    ) -> None:
        """Keep a note of a person on a test of a stamp [ns], at service hours [h].

        Raises
        ------
        ValueError
            When the newest test, whose published events are given, takes no further note of the
            person.
        """
        self._check(person, [*self._waiting, *published])
        self.add(UnitEvent(stamp_ns, hours, NOTE, f"{person}, {text}", person))

    def take(self) -> list[UnitEvent]:
        """Return the events that wait, and keep them no longer."""
        waiting, self._waiting = self._waiting, []
        return waiting

    @staticmethod
    def _check(person: str, events: Iterable[UnitEvent]) -> None:
        """Raise ValueError when a person's further note exceeds the limits."""
        notes = Counter(event.person for event in events if event.kind == NOTE)
        if notes[person] >= MOST_NOTES:
            raise ValueError(
                f"the newest test has {MOST_NOTES} notes of {person} already; the next valid test "
                "takes further ones"
            )
        if person not in notes and len(notes) >= MOST_PERSONS:
            raise ValueError(
                f"the newest test has notes of {MOST_PERSONS} persons already, and none of "
                f"{person}; the next valid test takes further ones"
            )
