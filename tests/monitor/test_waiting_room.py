"""Windows wait in order; where too many wait, the oldest gives way and nothing vanishes."""

import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_monitor.trigger import Refusal
from ema_monitor.waiting_room import WaitingRoom
from ema_monitor.watch import Found
from ema_monitor.window import Window

from .windows import window_from

WINDOW = window_from(np.linspace(0.0, 1.0, 3))
REFUSAL = Refusal(5, 6, "gap")


def found(number: int, window: Window | Refusal = WINDOW) -> Found:
    return Found(number, ActuatorDescription(), window)


def drain(room: WaitingRoom, count: int) -> list[Found]:
    items = [room.get() for _ in range(count)]
    return [item for item in items if item is not None]


def test_any_number_waits_in_order_when_there_is_no_limit():
    room = WaitingRoom(None)
    assert [room.put(found(number)) for number in range(100)] == [[]] * 100
    assert (len(room), room.dropped) == (100, 0)
    assert drain(room, 100) == [found(number) for number in range(100)]
    assert len(room) == 0


def test_oldest_gives_way_and_leaves_its_refusal_in_its_place():
    room = WaitingRoom(2)
    gone = [room.put(found(number)) for number in range(5)]
    assert [[item.number for item in items] for items in gone] == [[], [], [0], [1], [2]]
    assert (len(room), room.dropped) == (2, 3)
    left = drain(room, 5)
    assert [item.number for item in left] == [0, 1, 2, 3, 4]
    assert [isinstance(item.window, Window) for item in left] == [False] * 3 + [True] * 2
    for item in left[:3]:
        assert isinstance(item.window, Refusal)
        assert "more than 2 windows waited" in item.window.reason
        assert (item.window.start_ns, item.window.end_ns) == (WINDOW.start_ns, WINDOW.end_ns)


def test_refusals_take_no_place():
    room = WaitingRoom(1)
    assert room.put(found(0)) == []
    assert [room.put(found(number, REFUSAL)) for number in (1, 2)] == [[], []]
    assert len(room) == 1
    assert room.put(found(3)) == [found(0)]
    left = drain(room, 4)
    assert [item.number for item in left] == [0, 1, 2, 3]
    assert left[1:3] == [found(1, REFUSAL), found(2, REFUSAL)]


def test_limit_that_is_lowered_holds_from_the_next_window_on():
    room = WaitingRoom(None)
    for number in range(4):
        room.put(found(number))
    room.limit(2)
    assert len(room) == 4
    room.put(found(4))
    assert (len(room), room.dropped) == (2, 3)
    left = drain(room, 5)
    assert [isinstance(item.window, Window) for item in left] == [False] * 3 + [True] * 2


def test_one_who_gets_waits_for_the_next():
    room, got = WaitingRoom(1), []
    getter = threading.Thread(target=lambda: got.append(room.get()))
    getter.start()
    assert got == []
    room.put(found(7))
    getter.join(5.0)
    assert got == [found(7)]


def test_closing_sends_everybody_home():
    room, got = WaitingRoom(None), [found(0)]
    getter = threading.Thread(target=lambda: got.append(room.get()))  # type: ignore[arg-type]
    getter.start()
    assert room.close() == []
    getter.join(5.0)
    assert got == [found(0), None]
    assert room.get() is None


def test_closing_returns_who_was_left_in_order():
    room = WaitingRoom(3)
    for number in range(3):
        room.put(found(number))
    assert room.close() == [found(0), found(1), found(2)]
    assert (len(room), room.get()) == (0, None)


@pytest.fixture
def frequent_switches() -> Iterator[None]:
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)


@pytest.mark.usefixtures("frequent_switches")
def test_waiting_windows_are_counted_while_others_come_and_go():
    room, ended, failures = WaitingRoom(None), threading.Event(), []
    for number in range(50):
        room.put(found(number))

    def come_and_go() -> None:
        while not ended.is_set():
            room.put(found(0))
            room.get()

    other = threading.Thread(target=come_and_go)
    other.start()
    try:
        for _ in range(2000):
            assert 49 <= len(room) <= 51
    except RuntimeError as error:
        failures.append(error)
    ended.set()
    other.join(5.0)
    assert failures == []
