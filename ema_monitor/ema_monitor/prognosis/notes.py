"""Queue of user notes for the next outlook of a unit."""

from collections import Counter
from collections.abc import Iterable
from typing import Final

from ema_monitor.prognosis.history_entry import NOTE, UnitEvent

MOST_NOTES: Final = 50
"""Largest number of a person's notes between two valid tests."""

MOST_PERSONS: Final = 20
"""Largest number of persons with notes between two valid tests; limits the record of a test."""


class Notes:
    """Queue of user events for the next outlook."""

    def __init__(self) -> None:
        self._waiting: list[UnitEvent] = []

    def add(self, event: UnitEvent) -> None:
        """Add an event for the next outlook."""
        self._waiting.append(event)

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
            Events of the newest test that are published already.

        Raises
        ------
        ValueError
            If the newest test has too many notes already.
        """
        self._check(person, [*self._waiting, *published])
        self.add(UnitEvent(stamp_ns, hours, NOTE, f"{person}, {text}", person))

    def take(self) -> list[UnitEvent]:
        """Remove and return the queued events."""
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
