"""Messages that a subscription lost, by the numbers that their publisher gave them."""

from collections.abc import Hashable


class SequenceGaps:
    """Counts the gaps in the sequence numbers of a topic that has one publisher.

    With several publishers the numbers cannot be told apart, so that nothing is counted. A gap
    counts once the publishers are seen to be the same after it as before it: a second publisher
    that has just come is no loss.

    Attributes
    ----------
    lost
        Messages lost so far.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._publishers: frozenset[Hashable] = frozenset()
        self._last: int | None = None
        self._suspected = 0

    def take(self, number: int | None) -> None:
        """Take note of a message that came.

        Parameters
        ----------
        number
            Its sequence number; None where the middleware gives none.
        """
        if number is None:
            return
        if self._last is not None and number > self._last:
            self._suspected += number - self._last - 1
        self._last = number

    def take_publishers(self, publishers: frozenset[Hashable]) -> None:
        """Take note of who publishes now; to be called regularly."""
        if publishers != self._publishers:
            self._publishers, self._last = publishers, None
        elif len(publishers) == 1:
            self.lost += self._suspected
        self._suspected = 0
