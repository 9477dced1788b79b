"""Which tests of a unit to believe, when their service hours contradict each other."""

from bisect import bisect_right
from itertools import pairwise
from typing import Final

_LEAST_TESTS: Final = 3
_LONGEST_JUMP: Final = 10.0


class ServiceOrder:
    """Chooses among tests by their service hours, one test after the other.

    The hours of a unit never go back. Used are the most tests of which that is true; of several
    choices of the same size the one in use stays. So a single wrong count costs its own test: one
    too low is left out at once, one too high as soon as two tests after it contradict it.

    Until then one too high would have growth extrapolated to its hours. So the last test in use
    waits for the next one to confirm it if its hours are further from those of the test before
    than ten times the longest interval until then, of at least three tests.

    Attributes
    ----------
    used
        Numbers of the tests in use, ascending.
    """

    def __init__(self) -> None:
        self.used: list[int] = []
        self._hours: list[float] = []
        # Of each test, how many tests it can be the last of; of each such number, the least hours.
        self._sizes: list[int] = []
        self._ends: list[float] = []

    @property
    def is_waiting(self) -> bool:
        """Whether the last test in use waits to be confirmed."""
        if len(self.used) <= _LEAST_TESTS:
            return False
        hours = [self._hours[number] for number in self.used]
        *intervals, latest = (after - before for before, after in pairwise(hours))
        # Tests at one and the same hour do not tell how fast hours go by.
        return 0.0 < _LONGEST_JUMP * max(intervals) < latest

    @property
    def confirmed(self) -> list[int]:
        """Numbers of the tests in use without one that waits."""
        return self.used[:-1] if self.is_waiting else list(self.used)

    def add(self, hours: float) -> list[int]:
        """Take the next test.

        Parameters
        ----------
        hours
            Its service hours [h].

        Returns
        -------
        list of int
            Numbers of the tests that were in use and are no longer.
        """
        number = len(self._hours)
        size = bisect_right(self._ends, hours) + 1
        self._hours.append(hours)
        self._sizes.append(size)
        self._ends[size - 1 : size] = [hours]
        if not self.used or hours >= self._hours[self.used[-1]]:
            self.used.append(number)
        elif size > len(self.used):
            before, self.used = self.used, self._most_until(number)
            return sorted(set(before) - set(self.used))
        return []

    def _most_until(self, number: int) -> list[int]:
        """Return the most tests that a test can be the last of, early ones rather than late."""
        chosen = [number]
        for size in range(self._sizes[number] - 1, 0, -1):
            number = next(
                i
                for i in range(number)
                if self._sizes[i] == size and self._hours[i] <= self._hours[number]
            )
            chosen.append(number)
        return chosen[::-1]
