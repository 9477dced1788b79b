# SPDX-License-Identifier: Apache-2.0
"""Queue of windows between the receiving and identifying threads."""

import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from typing import Final

from ema_monitor.reasons import QueueFull
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

MOST_REFUSALS: Final = 100
"""Maximum number of queued refusals per actuator; for live telemetry the oldest are dropped."""


class QueueClosedError(Exception):
    """Raised when a window is added to a closed queue."""


class WindowQueue:
    """Window queue, in order per actuator and round-robin across actuators.

    Each turn is one window plus any refusals before it, so a busy actuator delays others by only
    one identification. If a live actuator exceeds its limit, its oldest window is replaced by a
    refusal, so that order and numbers are kept and every window gets an estimate. An actuator never
    drops windows of another actuator. Stretches of ordinary motion and test cycles have separate
    limits. At most ``MOST_REFUSALS`` refusals of an actuator are queued; older ones are never
    published.

    Attributes
    ----------
    dropped
        Number of dropped windows by actuator; "" collects forgotten actuators.
    unanswered
        Number of unpublished refusals by actuator; "" collects forgotten actuators.
    is_closed
        Whether the queue accepts no more windows.
    """

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        self.unanswered: Counter[str] = Counter()
        # By actuator, in the order of their turns.
        self._queues: dict[str, deque[Segment]] = {}
        self._refusals_in_turn = 0
        self._changed = threading.Condition()
        self.is_closed = False
        self._current: Segment | None = None
        self._publishing = threading.Lock()

    def __len__(self) -> int:
        with self._changed:
            return sum(map(_is_window, chain.from_iterable(self._queues.values())))

    def add(self, segment: Segment, most_waiting: int | None) -> list[Segment]:
        """Add a window or refusal. Return the windows that it displaces.

        Parameters
        ----------
        segment
            The window or refusal.
        most_waiting
            Largest number of queued windows of its kind and actuator; None for any number of
            windows and refusals.

        Raises
        ------
        QueueClosedError
            If the queue is closed.
        """
        actuator_id, dropped = segment.description.actuator_id, []
        with self._changed:
            if self.is_closed:
                raise QueueClosedError
            queue = self._queues.setdefault(actuator_id, deque())
            queue.append(segment)
            if most_waiting is not None:
                dropped = _drop(queue, segment.is_stretch, most_waiting)
                self.dropped[actuator_id] += len(dropped)
                self.unanswered[actuator_id] += _thin(queue)
            self._changed.notify_all()
        return dropped

    def forget(self, actuator_id: str) -> None:
        """Remove an actuator's queued windows and move its counts to ""."""
        with self._changed:
            self._queues.pop(actuator_id, None)
            for counts in (self.dropped, self.unanswered):
                counts[""] += counts.pop(actuator_id, 0)

    def next(self) -> Segment | None:
        """Wait for the next window and return it; None when the queue is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._queues or self.is_closed)
            if self.is_closed:
                return None  # the current window may still be abandoned
            self._current = self._take()
            return self._current

    def _take(self) -> Segment:
        actuator_id, queue = next(iter(self._queues.items()))
        segment = queue.popleft()
        self._refusals_in_turn += not _is_window(segment)
        if not queue:
            del self._queues[actuator_id]
        elif _is_window(segment) or self._refusals_in_turn >= MOST_REFUSALS:
            self._queues[actuator_id] = self._queues.pop(actuator_id)
        else:
            return segment
        self._refusals_in_turn = 0
        return segment

    @contextmanager
    def publishing(self, segment: Segment) -> Iterator[bool]:
        """Yield whether the estimate of the current window may be published, as a context manager.

        The current window is the last that ``next`` returned. Its estimate may be published within
        this context only, and not if the window was abandoned.
        """
        with self._publishing:
            try:
                yield self._current is segment
            finally:
                self._current = None

    def close(self) -> list[Segment]:
        """Close the queue. Return the queued windows, in order per actuator."""
        with self._changed:
            self.is_closed = True
            waiting = list(chain.from_iterable(self._queues.values()))
            self._queues.clear()
            self._changed.notify_all()
        return waiting

    def abandon(self) -> Segment | None:
        """Abandon and return the window being identified, if any; its estimate is not published.

        If its estimate is already being published, waits until done and returns None.
        """
        with self._publishing:
            current, self._current = self._current, None
            return current


def _is_window(segment: Segment) -> bool:
    return isinstance(segment.window, Window)


def _surplus(queue: deque[Segment], most: int, counts: Callable[[Segment], bool]) -> list[int]:
    """Return the positions of all counted items except the ``most`` newest."""
    places = [place for place, item in enumerate(queue) if counts(item)]
    return places[: max(0, len(places) - most)]


def _drop(queue: deque[Segment], is_stretch: bool, most: int) -> list[Segment]:
    """Replace the oldest windows of a kind beyond ``most`` with refusals. Return these windows."""
    dropped = []
    for place in _surplus(
        queue, most, lambda item: item.is_stretch == is_stretch and _is_window(item)
    ):
        dropped.append(oldest := queue[place])
        span = oldest.window.start_ns, oldest.window.end_ns
        refusal = Refusal(*span, QueueFull(most, is_stretch), is_dropped=True)
        queue[place] = replace(oldest, window=refusal)
    return dropped


def _thin(queue: deque[Segment]) -> int:
    """Remove the oldest refusals beyond ``MOST_REFUSALS``; return their number."""
    surplus = _surplus(queue, MOST_REFUSALS, lambda item: not _is_window(item))
    for place in reversed(surplus):
        del queue[place]
    return len(surplus)
