# SPDX-License-Identifier: Apache-2.0
"""Identification state of one actuator."""

from collections.abc import Iterator
from contextlib import contextmanager
from queue import SimpleQueue

from ema_monitor.diagnosis import Diagnosis
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.window import Window


class ActuatorWork:
    """Identification state of one actuator.

    Attributes
    ----------
    latest
        Its latest complete window; None before the first window.
    awaiting
        Queues of the calls that wait for its next windows.
    diagnosis
        Identifies its windows; None before the first window.
    """

    def __init__(self) -> None:
        self.latest: Segment | None = None
        self.awaiting: list[SimpleQueue[Segment]] = []
        self.diagnosis: Diagnosis | None = None

    def note(self, segment: Segment) -> None:
        """Store a window as the latest, and pass it to waiting calls."""
        if isinstance(segment.window, Window):
            self.latest = segment
        for queue in tuple(self.awaiting):
            queue.put(segment)

    @contextmanager
    def next_windows(self) -> Iterator[SimpleQueue[Segment]]:
        """Yield a queue that receives the next windows, including refused windows."""
        queue: SimpleQueue[Segment] = SimpleQueue()
        self.awaiting.append(queue)
        try:
            yield queue
        finally:
            self.awaiting.remove(queue)
