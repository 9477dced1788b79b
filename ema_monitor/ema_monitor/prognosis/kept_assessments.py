"""What was found after the tests of a unit: the latest in memory, earlier ones in a file."""

from array import array
from collections.abc import Callable, Iterator, Mapping

from ema_monitor.prognosis.assessment import Assessment


class KeptAssessments(Mapping[int, Assessment]):
    """Assessments by the stamps of their tests [ns], in the order of these; any thread may read.

    All are in memory until ``leave`` is called.
    """

    def __init__(self) -> None:
        self._latest: dict[int, Assessment] = {}
        self._left = array("q")
        self._read: Callable[[int], Assessment | None] = lambda _: None

    def __getitem__(self, stamp_ns: int) -> Assessment:
        found = self._latest.get(stamp_ns)
        if found is None and self._left:
            found = self._read(stamp_ns)
        if found is None:
            raise KeyError(stamp_ns)
        return found

    def __iter__(self) -> Iterator[int]:
        return iter(dict.fromkeys([*self._left, *self._latest]))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def put(self, assessment: Assessment) -> None:
        """Add an assessment, or replace it."""
        self._latest[assessment.stamp_ns] = assessment

    def leave(self, most: int, read: Callable[[int], Assessment | None]) -> None:
        """Keep the latest alone; the others are in a file.

        Parameters
        ----------
        most
            How many are kept.
        read
            Reads that of a test from the file; None when it is not there.
        """
        self._read = read
        for stamp_ns in list(self._latest)[: max(len(self._latest) - most, 0)]:
            # In this order: another thread may be reading.
            self._left.append(stamp_ns)
            del self._latest[stamp_ns]

    def take_back(self) -> None:
        """Keep all in memory again that can be read."""
        found = {stamp_ns: self._read(stamp_ns) for stamp_ns in self._left}
        self._latest = {key: one for key, one in found.items() if one is not None} | self._latest
        self._left = array("q")
