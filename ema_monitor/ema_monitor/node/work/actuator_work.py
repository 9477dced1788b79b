"""The windows of one actuator as they are worked on."""

from collections.abc import Iterator
from contextlib import contextmanager
from queue import SimpleQueue

from ema_monitor.diagnosis import Diagnosis
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.window import Window


class ActuatorWork:
    """Work on one actuator.

    Attributes
    ----------
    latest
        Its latest complete window; None when there was none.
    awaiting
        Queues of those who wait for its next windows.
    diagnosis
        Identifies its windows; None before the first one.
    """

    def __init__(self) -> None:
        self.latest: Segment | None = None
        self.awaiting: list[SimpleQueue[Segment]] = []
        self.diagnosis: Diagnosis | None = None

    def note(self, segment: Segment) -> None:
        """Keep a window as the latest, and give it to those who wait."""
        if isinstance(segment.window, Window):
            self.latest = segment
        for queue in tuple(self.awaiting):
            queue.put(segment)

    @contextmanager
    def next_windows(self) -> Iterator[SimpleQueue[Segment]]:
        """Yield a queue of the windows from now on, and of those that cannot be used."""
        queue: SimpleQueue[Segment] = SimpleQueue()
        self.awaiting.append(queue)
        try:
            yield queue
        finally:
            self.awaiting.remove(queue)
