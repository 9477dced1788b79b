"""The queue of windows between the thread that receives and the one that identifies."""

import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from typing import Final

from ema_core.wording import counted
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

MOST_REFUSALS: Final = 100
"""Number of refusals of each actuator beyond which the oldest are not published, live."""


class QueueClosedError(Exception):
    """A window was added to a queue that is closed."""


class WindowQueue:
    """Windows of each actuator in their order, the actuators in turn.

    A turn is one window, with the refusals before it: an actuator that has many windows delays
    another one by a single identification. Live, a window beyond the limit of its actuator drops
    that actuator's oldest one: the refusal of that one stays in its place, so that order and
    numbers are kept and every window gets an estimate. An actuator never drops the windows of
    another, and stretches of ordinary motion no test cycles: these wait apart. Of refusals,
    ``MOST_REFUSALS`` of each actuator wait; the oldest beyond them are never published.

    Attributes
    ----------
    dropped
        Number of windows dropped, by actuator; of those that were forgotten, under "".
    unanswered
        Number of refusals that are never published, by actuator in the same way.
    is_closed
        Whether no more windows are accepted.
    """

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        self.unanswered: Counter[str] = Counter()
        # By actuator, the one whose turn it is first.
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
        """Add a window, or the refusal of one; return the windows that were dropped for it.

        So many of its kind and actuator may wait; None for any number, of refusals as well. A queue
        that is closed raises QueueClosedError.
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
        """Remove the windows of an actuator that wait, and add what was counted to the others'."""
        with self._changed:
            self._queues.pop(actuator_id, None)
            for counts in (self.dropped, self.unanswered):
                counts[""] += counts.pop(actuator_id, 0)

    def next(self) -> Segment | None:
        """Wait for the next window and return it; None when the queue is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._queues or self.is_closed)
            if self.is_closed:
                return None  # what is being identified may still be abandoned
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
        """Yield whether the estimate of the window that ``next`` returned last is to be published.

        It is, in this context alone, unless the window was abandoned.
        """
        with self._publishing:
            try:
                yield self._current is segment
            finally:
                self._current = None

    def close(self) -> list[Segment]:
        """Accept no more windows; return those that wait, in order for each actuator."""
        with self._changed:
            self.is_closed = True
            waiting = list(chain.from_iterable(self._queues.values()))
            self._queues.clear()
            self._changed.notify_all()
        return waiting

    def abandon(self) -> Segment | None:
        """Return the window that is being identified, if any: it will not be published.

        If its estimate is being published, wait until it is, and return None.
        """
        with self._publishing:
            current, self._current = self._current, None
            return current


def _is_window(segment: Segment) -> bool:
    return isinstance(segment.window, Window)


def _surplus(queue: deque[Segment], most: int, counts: Callable[[Segment], bool]) -> list[int]:
    """Return the places of the oldest of some items beyond a number of them."""
    places = [place for place, item in enumerate(queue) if counts(item)]
    return places[: max(0, len(places) - most)]


def _drop(queue: deque[Segment], is_stretch: bool, most: int) -> list[Segment]:
    """Replace the oldest windows of a kind beyond a number by refusals, and return them."""
    reason = f"dropped: more than {counted(most, 'stretch' if is_stretch else 'window')} waited"
    dropped = []
    for place in _surplus(
        queue, most, lambda item: item.is_stretch == is_stretch and _is_window(item)
    ):
        dropped.append(oldest := queue[place])
        span = oldest.window.start_ns, oldest.window.end_ns
        refusal = Refusal(*span, f"{reason} for identification", is_dropped=True)
        queue[place] = replace(oldest, window=refusal)
    return dropped


def _thin(queue: deque[Segment]) -> int:
    """Remove the oldest refusals beyond those that may wait; return how many."""
    surplus = _surplus(queue, MOST_REFUSALS, lambda item: not _is_window(item))
    for place in reversed(surplus):
        del queue[place]
    return len(surplus)
