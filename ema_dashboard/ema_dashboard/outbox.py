"""What waits to be sent to one client, bounded."""

import asyncio
from collections import OrderedDict, deque


class OverflowingError(Exception):
    """A client leaves even the messages of the protocol waiting."""


class Outbox:
    """Frames that wait for a client, in their order.

    Messages of topics may be dropped, the oldest first; those of the protocol, without which a
    client cannot read the others, never.

    Parameters
    ----------
    most_bytes
        How much may wait [B].

    Attributes
    ----------
    dropped
        Number of messages that were dropped.
    waiting_bytes
        How much waits [B].
    """

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        # By number: a dropped message leaves a gap, and nothing is moved.
        self._frames: OrderedDict[int, str | bytes] = OrderedDict()
        self._droppable: deque[int] = deque()
        self._next = 0
        self._filled = asyncio.Event()
        self.dropped = 0
        self.waiting_bytes = 0

    def put(self, frame: str | bytes, *, droppable: bool) -> None:
        """Add a frame, and drop the oldest messages that make it too many.

        Raises
        ------
        OverflowingError
            When what must not be dropped does not fit.
        """
        if droppable:
            if len(frame) > self._most_bytes:
                self.dropped += 1
                return
            self._droppable.append(self._next)
        self._frames[self._next] = frame
        self._next += 1
        self.waiting_bytes += len(frame)
        while self.waiting_bytes > self._most_bytes:
            if not self._droppable:
                raise OverflowingError
            oldest = self._frames.pop(self._droppable.popleft())
            self.waiting_bytes -= len(oldest)
            self.dropped += 1
        self._filled.set()

    async def take(self) -> str | bytes:
        """Wait for the oldest frame and remove it."""
        while not self._frames:
            self._filled.clear()
            await self._filled.wait()
        number, frame = self._frames.popitem(last=False)
        if self._droppable and self._droppable[0] == number:
            self._droppable.popleft()
        self.waiting_bytes -= len(frame)
        return frame
