# SPDX-License-Identifier: Apache-2.0
"""Windows wait in order; if the queue is full, the oldest is dropped and its refusal published."""

import sys
import threading
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_monitor.node.work.window_queue import MOST_REFUSALS, WindowQueue
from ema_monitor.reasons import StatedReason
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

from ..waiting import DEADLINE_S
from .windows import window_from

WINDOW = window_from(np.linspace(0.0, 1.0, 3))
REFUSAL = Refusal(5, 6, StatedReason("gap"))
FLAP = ActuatorDescription().actuator_id


def found(number: int, window: Window | Refusal = WINDOW, of: str = FLAP) -> Segment:
    return Segment(number, replace(ActuatorDescription(), actuator_id=of), window)


def drain(queue: WindowQueue, count: int) -> list[Segment]:
    items = [queue.next() for _ in range(count)]
    return [item for item in items if item is not None]


def names(items: list[Segment]) -> list[tuple[str, int]]:
    return [(item.description.actuator_id, item.number) for item in items]


def test_any_number_waits_in_order_without_a_limit():
    queue = WindowQueue()
    assert [queue.add(found(number), None) for number in range(100)] == [[]] * 100
    assert (len(queue), queue.dropped) == (100, {})
    assert drain(queue, 100) == [found(number) for number in range(100)]
    assert len(queue) == 0


@pytest.mark.parametrize("lowered", [False, True])
def test_oldest_is_dropped_and_replaced_by_its_refusal(lowered):
    """A lowered limit applies from the next window on."""
    queue = WindowQueue()
    gone = [queue.add(found(n), None if lowered and n < 4 else 2) for n in range(5)]
    expected = [[], [], [], [], [0, 1, 2]] if lowered else [[], [], [0], [1], [2]]
    assert [[item.number for item in items] for items in gone] == expected
    assert (len(queue), queue.dropped) == (2, {FLAP: 3})
    left = drain(queue, 5)
    assert [item.number for item in left] == [0, 1, 2, 3, 4]
    assert [isinstance(item.window, Window) for item in left] == [False] * 3 + [True] * 2
    for item in left[:3]:
        assert isinstance(item.window, Refusal)
        assert "more than 2 windows waited" in item.window.reason
        assert item.window.is_dropped
        assert (item.window.start_ns, item.window.end_ns) == (WINDOW.start_ns, WINDOW.end_ns)


def test_stretches_of_motion_never_displace_a_test():
    """Tests wait when the monitor is switched to ordinary motion, and many stretches follow."""
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


def test_refusals_do_not_count_against_the_limit():
    queue = WindowQueue()
    assert queue.add(found(0), 1) == []
    assert [queue.add(found(number, REFUSAL), 1) for number in (1, 2)] == [[], []]
    assert len(queue) == 1
    assert queue.add(found(3), 1) == [found(0)]
    left = drain(queue, 4)
    assert [item.number for item in left] == [0, 1, 2, 3]
    assert left[1:3] == [found(1, REFUSAL), found(2, REFUSAL)]


@pytest.mark.parametrize("is_closed", [False, True])
def test_consumer_waits_for_the_next_window_or_the_end(is_closed):
    queue, got = WindowQueue(), []
    getter = threading.Thread(target=lambda: got.append(queue.next()))
    getter.start()
    assert got == []
    assert (queue.close() if is_closed else queue.add(found(7), 1)) == []
    getter.join(DEADLINE_S)
    assert got == [None if is_closed else found(7)]


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

    thread = threading.Thread(target=come_and_go)
    thread.start()
    try:
        for _ in range(2000):
            assert 49 <= len(queue) <= 51
    except RuntimeError as error:
        failures.append(error)
    ended.set()
    thread.join(DEADLINE_S)
    assert failures == []


def test_actuators_take_turns_so_that_a_busy_one_delays_each_other_by_one_window():
    queue = WindowQueue()
    for number in range(4):
        queue.add(found(number, of="busy"), None)
    for name in ("a", "b"):
        for number in range(2):
            queue.add(found(number, of=name), None)
    assert names(drain(queue, 8)) == [
        *(("busy", 0), ("a", 0), ("b", 0)),
        *(("busy", 1), ("a", 1), ("b", 1)),
        *(("busy", 2), ("busy", 3)),
    ]


def test_flooding_actuator_is_served_as_often_as_the_others():
    """It makes ten windows while one is identified: each of the four gets its share."""
    queue, served = WindowQueue(), []
    quiet = ("a", "b", "c")
    for step in range(100):
        for number in range(10):
            queue.add(found(10 * step + number, of="busy"), 2)
        if step % 4 == 0:
            for name in quiet:
                queue.add(found(step, of=name), 2)
        while not isinstance((segment := drain(queue, 1)[0]).window, Window):
            pass
        served.append(segment.description.actuator_id)
    assert [served.count(name) for name in ("busy", *quiet)] == [25] * 4
    assert all(queue.dropped[name] == 0 for name in quiet)
    # Two wait, and one may already have been taken.
    assert queue.dropped["busy"] == 1000 - 25 - 2


def test_waiting_refusals_are_limited_and_dropped_ones_are_counted():
    queue = WindowQueue()
    queue.add(found(0, of="a"), 2)
    for number in range(1, MOST_REFUSALS + 6):
        queue.add(found(number, REFUSAL, "a"), 2)
    queue.add(found(0, of="b"), 2)
    assert (queue.unanswered["a"], queue.dropped["a"]) == (5, 0)
    left = names(drain(queue, MOST_REFUSALS + 2))
    # The turn ends with the window, and after as many refusals as may wait.
    assert left[:3] == [("a", 0), ("b", 0), ("a", 6)]
    for number in range(2 * MOST_REFUSALS):
        queue.add(found(number, REFUSAL, "a"), None)
    assert queue.unanswered["a"] == 5


def test_windows_of_a_removed_actuator_are_released():
    queue = WindowQueue()
    for number in range(4):
        queue.add(found(number, of="a"), 2)
    queue.add(found(0, of="b"), 2)
    queue.forget("a")
    assert (len(queue), queue.dropped) == (1, {"": 2, "b": 0})
    assert names(drain(queue, 1)) == [("b", 0)]
    queue.forget("unknown")
