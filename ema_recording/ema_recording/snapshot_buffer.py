"""What was received in the last seconds, kept for a snapshot."""

from collections import deque
from typing import Final, NamedTuple

_BESIDES_BYTES: Final = 200
"""Memory of a message besides its data [B]."""


class Kept(NamedTuple):
    """A serialised message with its times [ns]."""

    topic: str
    data: bytes
    log_time_ns: int
    publish_time_ns: int | None


class SnapshotBuffer:
    """Messages of a span of log time, at most of a size.

    Parameters
    ----------
    duration_s
        How far it reaches back [s].
    most_bytes
        How much it holds [B].

    Attributes
    ----------
    size
        How much it holds now [B].
    is_short
        Whether messages of the span had to go for want of room.
    """

    def __init__(self, duration_s: float, most_bytes: int) -> None:
        self._duration_ns = round(duration_s * 1e9)
        self._most_bytes = most_bytes
        self._kept: deque[Kept] = deque()
        self.size = 0
        self.is_short = False

    def __len__(self) -> int:
        """Return how many messages are kept."""
        return len(self._kept)

    @property
    def span_s(self) -> float:
        """Time from the first to the last message [s]."""
        kept = self._kept
        return max(0.0, (kept[-1].log_time_ns - kept[0].log_time_ns) / 1e9) if kept else 0.0

    def append(self, item: Kept) -> list[Kept]:
        """Take a message, and return those that go for it."""
        self._kept.append(item)
        self.size += _size(item)
        gone = []
        while self._kept and (self.size > self._most_bytes or self._is_old(item.log_time_ns)):
            self.is_short |= not self._is_old(item.log_time_ns)
            gone.append(self._kept.popleft())
            self.size -= _size(gone[-1])
        return gone

    def take(self) -> list[Kept]:
        """Return what is kept, and keep it no longer."""
        kept, self._kept = list(self._kept), deque()
        self.size, self.is_short = 0, False
        return kept

    def _is_old(self, now_ns: int) -> bool:
        # A clock that was set back makes nothing old.
        return now_ns - self._kept[0].log_time_ns > self._duration_ns


def _size(item: Kept) -> int:
    return len(item.data) + _BESIDES_BYTES
