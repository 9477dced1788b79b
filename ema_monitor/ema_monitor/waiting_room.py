"""Where windows wait for their identification."""

import threading
from collections import deque
from dataclasses import replace

from ema_monitor.trigger import Refusal
from ema_monitor.watch import Found
from ema_monitor.window import Window


class WaitingRoom:
    """A queue of windows between the thread that receives and the one that identifies.

    Live, a window that comes while too many of the same actuator wait makes the oldest of these
    give way: what leaves the queue in its place is its refusal, so that order and numbers are kept
    and nothing vanishes. No actuator can push out the windows of another.

    Parameters
    ----------
    most_waiting
        How many windows of an actuator may wait; None for any number.

    Attributes
    ----------
    dropped
        How many windows had to give way.
    """

    def __init__(self, most_waiting: int | None) -> None:
        self.dropped = 0
        self._most_waiting = most_waiting
        self._queue: deque[Found] = deque()
        self._changed = threading.Condition()
        self._closed = False

    def __len__(self) -> int:
        with self._changed:
            return sum(isinstance(item.window, Window) for item in self._queue)

    def limit(self, most_waiting: int | None) -> None:
        """Change how many windows of an actuator may wait, from the next one on.

        Parameters
        ----------
        most_waiting
            As at construction.
        """
        self._most_waiting = most_waiting

    def put(self, found: Found) -> list[Found]:
        """Let a window, or a refusal, wait.

        Parameters
        ----------
        found
            What was found.

        Returns
        -------
        list of Found
            The windows that had to give way, if any had to.
        """
        with self._changed:
            self._queue.append(found)
            gone = []
            if self._most_waiting is not None:
                places = self._places_of(found.description.actuator_id)
                surplus = max(0, len(places) - self._most_waiting)
                gone = [self._drop(place, self._most_waiting) for place in places[:surplus]]
            self._changed.notify()
        return gone

    def get(self) -> Found | None:
        """Wait for the next one and return it; None when the room is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._closed)
            return None if self._closed else self._queue.popleft()

    def close(self) -> list[Found]:
        """Send home whoever waits or will wait, and return who was left."""
        with self._changed:
            self._closed = True
            left = list(self._queue)
            self._queue.clear()
            self._changed.notify_all()
        return left

    def _places_of(self, actuator_id: str) -> list[int]:
        """Return where windows of an actuator stand in the queue, the oldest first."""
        return [
            place
            for place, item in enumerate(self._queue)
            if item.description.actuator_id == actuator_id and isinstance(item.window, Window)
        ]

    def _drop(self, place: int, most_waiting: int) -> Found:
        self.dropped += 1
        given_up = self._queue[place]
        reason = f"dropped: more than {most_waiting} windows waited for identification"
        refusal = Refusal(given_up.window.start_ns, given_up.window.end_ns, reason)
        self._queue[place] = replace(given_up, window=refusal)
        return given_up
