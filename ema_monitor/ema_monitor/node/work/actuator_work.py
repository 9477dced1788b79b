"""Work on the windows of one actuator."""

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
        Its latest complete window; None before the first one.
    awaiting
        Queues of the calls that wait for its next windows.
    diagnosis
        Identifies its windows; None before the first one.
    """

    def __init__(self) -> None:
        self.latest: Segment | None = None
        self.awaiting: list[SimpleQueue[Segment]] = []
        self.diagnosis: Diagnosis | None = None

    def note(self, segment: Segment) -> None:
        """Keep a window as the latest, and pass it to the calls that wait for it."""
        if isinstance(segment.window, Window):
            self.latest = segment
        for queue in tuple(self.awaiting):
            queue.put(segment)

    @contextmanager
    def next_windows(self) -> Iterator[SimpleQueue[Segment]]:
        """Yield a queue of the next windows, refused windows included."""
        queue: SimpleQueue[Segment] = SimpleQueue()
        self.awaiting.append(queue)
        try:
            yield queue
        finally:
            self.awaiting.remove(queue)
