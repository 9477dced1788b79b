"""The valid tests of a history: the latest as they are, earlier ones in little memory."""

from collections.abc import Sequence
from typing import Final, overload

from ema_monitor.prognosis.history_entry import Entry, EntryFile, EntryRow
from ema_monitor.prognosis.packed_rows import PackedRows

LATEST: Final = 20
"""How many are kept as they are."""


class KeptEntries(Sequence[Entry]):
    """Valid tests in the order in which they came; any thread may read.

    Of all but the latest 20 the estimates are packed. Those that are left to a file are made anew
    each time they are asked for.

    Parameters
    ----------
    file
        Gives the estimate and the duty of what is left to it.
    """

    def __init__(self, file: EntryFile) -> None:
        self._file = file
        self._left = PackedRows(EntryRow)
        self._kept: dict[int, Entry] = {}
        self._size = 0

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, place: int) -> Entry: ...

    @overload
    def __getitem__(self, place: slice) -> list[Entry]: ...

    def __getitem__(self, place: int | slice) -> Entry | list[Entry]:
        if isinstance(place, slice):
            return [self._at(one) for one in range(*place.indices(len(self)))]
        if not -len(self) <= place < len(self):
            raise IndexError(f"place {place} of {len(self)} tests")
        return self._at(place % len(self))

    def _at(self, place: int) -> Entry:
        # In this order: another thread may be leaving it, or taking it back.
        left = self._left
        if (kept := self._kept.get(place)) is not None:
            return kept
        return Entry.of_row(left[place], self._file)

    def append(self, entry: Entry) -> None:
        """Add a test."""
        self._kept[self._size] = entry
        self._size += 1
        if (earlier := self._kept.get(self._size - LATEST - 1)) is not None:
            earlier.pack()

    def leave(self, tests: int) -> None:
        """Leave all but the latest to the file, as far as it has them.

        Parameters
        ----------
        tests
            How many test cycles it has.
        """
        while (place := len(self._left)) < self._size - LATEST:
            entry = self._kept[place]
            if entry.number > tests:
                return
            # In this order: another thread may be reading.
            self._left.append(entry.as_row())
            entry.leave_to(self._file)
            del self._kept[place]

    def take_back(self, entries: Sequence[Entry]) -> None:
        """Keep these tests alone from now on, which are no more than before; none is left."""
        # In this order: another thread may be reading.
        self._size = len(entries)
        self._kept = dict(enumerate(entries))
        self._left = PackedRows(EntryRow)

    def in_memory(self) -> dict[int, Entry]:
        """Return those that are not left to a file, by their numbers."""
        return {entry.number: entry for entry in self._kept.values()}
