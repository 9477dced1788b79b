# SPDX-License-Identifier: Apache-2.0
"""Playback of recorded messages at the recorded pace, or at a multiple of it."""

import threading
import time
from collections.abc import Callable, Iterable

from ema_bags.recording import Recorded


class Playback:
    """Publishes messages when they are due, along with the playback time.

    A message is due at a fixed time after the start, so that delays do not accumulate. The
    playback time runs between messages, never past the next message, and stands still while
    playback is paused.

    Parameters
    ----------
    messages
        Messages in the order of their log times.
    rate
        Playback rate: recorded time per wall time [-].
    tick_s
        Wall time between ticks [s].
    publish
        Called with each message that is due.
    tick
        Called with the current log time [ns], at the start, regularly, and at the end.

    Attributes
    ----------
    rate
        Playback rate, which may change while playback is paused [-].
    start_ns, reached_ns
        Log time of the first message, and current log time [ns].
    played
        Number of published messages.

    Raises
    ------
    ValueError
        If there is no message.
    """

    def __init__(
        self,
        messages: Iterable[Recorded],
        rate: float,
        tick_s: float,
        publish: Callable[[Recorded], None],
        tick: Callable[[int], None],
    ) -> None:
        self._messages = iter(messages)
        self._next = next(self._messages, None)
        if self._next is None:
            raise ValueError("no message to play")
        self.rate = rate
        self._tick_s = tick_s
        self._publish = publish
        self._tick = tick
        self.played = 0
        self.start_ns = self.reached_ns = self._next.log_time_ns

    def go_to(self, time_ns: int, messages: Iterable[Recorded]) -> None:
        """Move to a log time [ns], with the messages after it, while paused."""
        self._messages = iter(messages)
        self._next = next(self._messages, None)
        self.reached_ns = time_ns
        self._tick(time_ns)

    def step(self, count: int, stop: threading.Event) -> int:
        """Play up to ``count`` messages without delay; return the number played.

        Fewer are played if the messages end or ``stop`` is set.
        """
        played = 0
        while self._next is not None and played < count and not stop.is_set():
            self._tick(self._next.log_time_ns)
            self._publish_next(self._next)
            played += 1
        return played

    def run(self, stop: threading.Event) -> bool:
        """Continue the playback until it is stopped; return whether the end is reached."""
        begin_ns, begin_s = self.reached_ns, time.monotonic()
        next_tick_s = begin_s
        while self._next is not None:
            due_s = begin_s + (self._next.log_time_ns - begin_ns) / 1e9 / self.rate
            while (now_s := time.monotonic()) < due_s or now_s >= next_tick_s:
                now_ns = begin_ns + round((now_s - begin_s) * 1e9 * self.rate)
                self.reached_ns = min(now_ns, self._next.log_time_ns)
                if now_s >= next_tick_s:
                    self._tick(self.reached_ns)
                    missed = (now_s - next_tick_s) // self._tick_s
                    next_tick_s += (missed + 1) * self._tick_s
                elif stop.wait(min(due_s, next_tick_s) - now_s):
                    return False
            if stop.is_set():
                return False
            self._publish_next(self._next)
        self._tick(self.reached_ns)
        return True

    def _publish_next(self, item: Recorded) -> None:
        self.reached_ns = item.log_time_ns
        self._publish(item)
        self.played += 1
        self._next = next(self._messages, None)
