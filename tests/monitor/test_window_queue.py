"""Windows wait in order; where too many wait, the oldest is dropped and its refusal published."""

import sys
import threading
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_monitor.node.window_queue import QueueClosedError, WindowQueue
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

from .windows import window_from

WINDOW = window_from(np.linspace(0.0, 1.0, 3))
REFUSAL = Refusal(5, 6, "gap")
FLAP = ActuatorDescription().actuator_id


def found(number: int, window: Window | Refusal = WINDOW) -> Segment:
    return Segment(number, ActuatorDescription(), window)


def drain(queue: WindowQueue, count: int) -> list[Segment]:
    items = [queue.next() for _ in range(count)]
    return [item for item in items if item is not None]


def test_any_number_waits_in_order_when_there_is_no_limit():
    queue = WindowQueue()
    assert [queue.add(found(number), None) for number in range(100)] == [[]] * 100
    assert (len(queue), queue.dropped) == (100, {})
    assert drain(queue, 100) == [found(number) for number in range(100)]
    assert len(queue) == 0


def test_oldest_is_dropped_and_leaves_its_refusal_in_its_place():
    queue = WindowQueue()
    gone = [queue.add(found(number), 2) for number in range(5)]
    assert [[item.number for item in items] for items in gone] == [[], [], [0], [1], [2]]
    assert (len(queue), queue.dropped) == (2, {FLAP: 3})
    left = drain(queue, 5)
    assert [item.number for item in left] == [0, 1, 2, 3, 4]
    assert [isinstance(item.window, Window) for item in left] == [False] * 3 + [True] * 2
    for item in left[:3]:
        assert isinstance(item.window, Refusal)
        assert "more than 2 windows waited" in item.window.reason
        assert item.window.is_dropped
        assert (item.window.start_ns, item.window.end_ns) == (WINDOW.start_ns, WINDOW.end_ns)


def test_stretches_of_motion_never_drop_a_test():
    """Tests wait when the monitor is set to ordinary motion: a burst of it is no reason."""
    queue = WindowQueue()
    for number in range(2):
        queue.add(found(number), 2)
    stretches = [replace(found(number), is_stretch=True) for number in range(2, 6)]
    gone = [queue.add(stretch, 2) for stretch in stretches]
    assert gone == [[], [], [stretches[0]], [stretches[1]]]
    left = drain(queue, 6)
    assert left[:2] == [found(0), found(1)]
    assert left[4:] == stretches[2:]
    assert "more than 2 stretches waited" in getattr(left[2].window, "reason", "")


def test_refusals_take_no_place():
    queue = WindowQueue()
    assert queue.add(found(0), 1) == []
    assert [queue.add(found(number, REFUSAL), 1) for number in (1, 2)] == [[], []]
    assert len(queue) == 1
    assert queue.add(found(3), 1) == [found(0)]
    left = drain(queue, 4)
    assert [item.number for item in left] == [0, 1, 2, 3]
    assert left[1:3] == [found(1, REFUSAL), found(2, REFUSAL)]


def test_limit_that_is_lowered_holds_from_the_next_window_on():
    queue = WindowQueue()
    for number in range(4):
        queue.add(found(number), None)
    assert len(queue) == 4
    queue.add(found(4), 2)
    assert (len(queue), queue.dropped) == (2, {FLAP: 3})
    left = drain(queue, 5)
    assert [isinstance(item.window, Window) for item in left] == [False] * 3 + [True] * 2


def test_consumer_waits_for_the_next_window():
    queue, got = WindowQueue(), []
    getter = threading.Thread(target=lambda: got.append(queue.next()))
    getter.start()
    assert got == []
    queue.add(found(7), 1)
    getter.join(5.0)
    assert got == [found(7)]


def test_closing_wakes_the_consumer():
    queue, got = WindowQueue(), [found(0)]
    getter = threading.Thread(target=lambda: got.append(queue.next()))  # type: ignore[arg-type]
    getter.start()
    assert queue.close() == []
    getter.join(5.0)
    assert got == [found(0), None]
    assert queue.next() is None


def test_closing_returns_the_waiting_windows_in_order():
    queue = WindowQueue()
    for number in range(3):
        queue.add(found(number), 3)
    assert queue.close() == [found(0), found(1), found(2)]
    assert (len(queue), queue.next()) == (0, None)


def test_closed_queue_accepts_no_window():
    queue = WindowQueue()
    queue.close()
    with pytest.raises(QueueClosedError):
        queue.add(found(0), None)


@pytest.fixture
def frequent_switches() -> Iterator[None]:
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)


@pytest.mark.usefixtures("frequent_switches")
def test_waiting_windows_are_counted_while_others_come_and_go():
    queue, ended, failures = WindowQueue(), threading.Event(), []
    for number in range(50):
        queue.add(found(number), None)

    def come_and_go() -> None:
        while not ended.is_set():
            queue.add(found(0), None)
            queue.next()

    other = threading.Thread(target=come_and_go)
    other.start()
    try:
        for _ in range(2000):
            assert 49 <= len(queue) <= 51
    except RuntimeError as error:
        failures.append(error)
    ended.set()
    other.join(5.0)
    assert failures == []
