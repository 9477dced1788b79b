# SPDX-License-Identifier: Apache-2.0
"""Queue of windows: each window is identified or otherwise answered, once and in order."""

from collections import Counter

import numpy as np
from hypothesis import strategies as st
from hypothesis.stateful import invariant, precondition, rule

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.node.work.window_queue import MOST_REFUSALS, QueueClosedError, WindowQueue
from ema_monitor.reasons import StatedReason
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

from .stateful import Walk

_ROW = np.linspace(0.0, 1.0, 3)
_WINDOW = Window(Telemetry(0, 1e-4, 0, _ROW, _ROW, _ROW, _ROW), 0.0)
_REFUSAL = Refusal(5, 6, StatedReason("gap"))
_UNITS = {name: ActuatorDescription(actuator_id=name) for name in ("a", "b", "c")}
_unit = st.sampled_from(sorted(_UNITS))


class Queue(Walk):
    """A queue, and the segments that were added to and taken from it."""

    def __init__(self) -> None:
        super().__init__()
        self.queue = WindowQueue()
        self.number = 0
        # Numbers of the waiting segments by actuator, and of the windows among them.
        self.waiting: dict[str, list[int]] = {name: [] for name in _UNITS}
        self.whole: set[int] = set()
        self.answers: Counter[int] = Counter()
        self.gone: set[int] = set()
        self.unanswered: Counter[str] = Counter()
        self.current: Segment | None = None

    def _add(self, name: str, *, refused: bool, stretch: bool, most: int | None) -> None:
        number, self.number = self.number, self.number + 1
        segment = Segment(
            number, _UNITS[name], _REFUSAL if refused else _WINDOW, is_stretch=stretch
        )
        if self.queue.is_closed:
            try:
                self.queue.add(segment, most)
            except QueueClosedError:
                return
            raise AssertionError("a closed queue took a window")
        dropped = self.queue.add(segment, most)
        self.waiting[name].append(number)
        if not refused:
            self.whole.add(number)
        for item in dropped:
            assert item.description.actuator_id == name, "a window of another one was dropped"
            assert item.is_stretch == stretch, "a window of another kind was dropped"
            assert item.number in self.whole, "what was dropped was no window that waited"
            self.whole.remove(item.number)
        lost = self.queue.unanswered[name] - self.unanswered[name]
        refusals = [n for n in self.waiting[name] if n not in self.whole]
        for gone in refusals[:lost]:
            self.waiting[name].remove(gone)
            self.gone.add(gone)
        self.unanswered[name] += lost
        if most is not None:
            assert len(refusals) - lost <= MOST_REFUSALS

    @rule(name=_unit, stretch=st.booleans(), most=st.sampled_from((1, 2, 3, None)))
    def add_window(self, name: str, stretch: bool, most: int | None) -> None:
        """Add a window to the queue."""
        self._add(name, refused=False, stretch=stretch, most=most)

    @rule(name=_unit, count=st.sampled_from((1, 3, 130)), most=st.sampled_from((1, 2, None)))
    def add_refusals(self, name: str, count: int, most: int | None) -> None:
        """Add refusals to the queue, also a burst of them."""
        for _ in range(count):
            self._add(name, refused=True, stretch=False, most=most)

    @precondition(lambda self: any(self.waiting.values()) or self.queue.is_closed)
    @rule()
    def take(self) -> None:
        """Take the next segment, as the identification thread does."""
        segment = self.queue.next()
        if self.queue.is_closed:
            assert segment is None, "a closed queue gave a window"
            self.current = None
            return
        assert segment is not None
        name = segment.description.actuator_id
        assert self.waiting[name][0] == segment.number, "the order was not kept"
        assert isinstance(segment.window, Window) == (segment.number in self.whole)
        self.waiting[name].pop(0)
        self.answers[segment.number] += 1
        self.current = segment

    @precondition(lambda self: self.current is not None)
    @rule(abandoned=st.booleans())
    def finish(self, abandoned: bool) -> None:
        """Publish the taken segment, unless it was abandoned before."""
        current, self.current = self.current, None
        assert current is not None
        if abandoned:
            assert self.queue.abandon() is current
        with self.queue.publishing(current) as is_to_be:
            assert is_to_be != abandoned, "it is published although abandoned, or the reverse"
        assert self.queue.abandon() is None

    @rule(name=_unit)
    def forget(self, name: str) -> None:
        """Forget an actuator and its segments."""
        self.queue.forget(name)
        self.gone.update(self.waiting[name])
        self.waiting[name] = []
        self.unanswered[name] = 0
        assert self.queue.unanswered[name] == 0

    @precondition(lambda self: self._steps > 15)
    @rule()
    def close(self) -> None:
        """Close the queue, which must return all waiting segments in order."""
        left = self.queue.close()
        returned: dict[str, list[int]] = {name: [] for name in _UNITS}
        for item in left:
            returned[item.description.actuator_id].append(item.number)
            self.answers[item.number] += 1
        assert returned == self.waiting, "what waited is not what was given back"
        self.waiting = {name: [] for name in _UNITS}

    @invariant()
    def counts_are_right(self) -> None:
        """Check that each segment is answered once, waiting, or counted as dropped."""
        waiting = [number for numbers in self.waiting.values() for number in numbers]
        assert all(count == 1 for count in self.answers.values()), "a window was answered twice"
        assert len(self.queue) == sum(number in self.whole for number in waiting)
        if not self.queue.is_closed:
            accounted = {*waiting, *self.answers, *self.gone}
            assert accounted == set(range(self.number)), "a window is neither answered nor gone"
