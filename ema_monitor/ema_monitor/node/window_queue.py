"""The queue of windows between the thread that receives and the one that identifies."""

import threading
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from ema_core.wording import counted
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window


class QueueClosedError(Exception):
    """A window was added to a queue that is closed."""


class WindowQueue:
    """Windows in their order.

    Live, a window beyond the limit of its actuator drops that actuator's oldest one: the refusal
    of that one stays in its place, so that order and numbers are kept and every window gets an
    estimate. An actuator never drops the windows of another, and stretches of ordinary motion no
    test cycles: these wait apart.

    Attributes
    ----------
    dropped
        Number of windows dropped, by actuator.
    """

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        self._queue: deque[Segment] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self._current: Segment | None = None
        self._is_publishing = False

    def __len__(self) -> int:
        with self._changed:
            return sum(isinstance(item.window, Window) for item in self._queue)

    @property
    def is_closed(self) -> bool:
        """Whether no more windows are accepted."""
        return self._closed

    def add(self, segment: Segment, most_waiting: int | None) -> list[Segment]:
        """Add a window, or the refusal of one, at the end.

        Parameters
        ----------
        segment
            The window.
        most_waiting
            How many windows of its kind and actuator may wait; None for any number.

        Returns
        -------
        list of Segment
            The windows that were dropped for it.

        Raises
        ------
        QueueClosedError
            When the queue is closed.
        """
        actuator_id, dropped = segment.description.actuator_id, []
        with self._changed:
            if self._closed:
                raise QueueClosedError
            self._queue.append(segment)
            places = [
                place
                for place, item in enumerate(self._queue)
                if item.description.actuator_id == actuator_id
                and item.is_stretch == segment.is_stretch
                and isinstance(item.window, Window)
            ]
            if most_waiting is not None:
                limit = counted(most_waiting, "stretch" if segment.is_stretch else "window")
                reason = f"dropped: more than {limit} waited for identification"
                for place in places[: max(0, len(places) - most_waiting)]:
                    dropped.append(oldest := self._queue[place])
                    start_ns, end_ns = oldest.window.start_ns, oldest.window.end_ns
                    refusal = Refusal(start_ns, end_ns, reason, is_dropped=True)
                    self._queue[place] = replace(oldest, window=refusal)
                self.dropped[actuator_id] += len(dropped)
            self._changed.notify_all()
        return dropped

    def next(self) -> Segment | None:
        """Wait for the next window and return it; None when the queue is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._closed)
            self._current = None if self._closed else self._queue.popleft()
            return self._current

    @contextmanager
    def publishing(self, segment: Segment) -> Iterator[bool]:
        """Yield whether the estimate of the window that ``next`` returned last is to be published.

        It is, in this context alone, unless the window was abandoned.
        """
        with self._changed:
            self._is_publishing = self._current is segment
        try:
            yield self._is_publishing
        finally:
            with self._changed:
                self._is_publishing = False
                self._current = None
                self._changed.notify_all()

    def close(self) -> list[Segment]:
        """Accept no more windows; return those that wait."""
        with self._changed:
            self._closed = True
            waiting = list(self._queue)
            self._queue.clear()
            self._changed.notify_all()
        return waiting

    def abandon(self) -> Segment | None:
        """Return the window that is being identified, if any: it will not be published.

        If its estimate is being published, wait until it is, and return None.
        """
        with self._changed:
            self._changed.wait_for(lambda: not self._is_publishing)
            current, self._current = self._current, None
        return current
