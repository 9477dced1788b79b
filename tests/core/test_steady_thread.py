# SPDX-License-Identifier: Apache-2.0
"""A thread that ends unexpectedly is detected, restarted at a bounded rate, and counted."""

import sys
import threading
from collections.abc import Callable
from typing import Any

import pytest

from ema_core import steady_thread
from ema_core.steady_thread import SteadyThread

from ..waiting import DEADLINE_S


@pytest.fixture(autouse=True)
def short_waits(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(steady_thread, "_FIRST_WAIT_S", 0.01)


def fail() -> None:
    raise ZeroDivisionError("made up")


@pytest.mark.parametrize(
    ("ending", "reason"),
    [
        (fail, "ZeroDivisionError('made up')"),
        (sys.exit, "SystemExit"),
        (lambda: None, "it returned"),
    ],
)
def test_work_that_ends_unexpectedly_is_restarted_and_reported(
    ending: Callable[[], Any], reason: str
):
    reported: list[str] = []
    begun = threading.Semaphore(0)

    def work() -> None:
        begun.release()
        if len(reported) < 3:
            ending()
        else:
            thread.ending.wait()

    thread = SteadyThread("test", work, lambda failure, trace: reported.append(failure))
    thread.start()
    for _ in range(4):
        assert begun.acquire(timeout=DEADLINE_S)
    assert thread.ends == 3
    assert [f"the test thread has ended: {reason}" in text for text in reported] == [True] * 3
    assert thread.failure == reported[-1]
    assert "3 ends so far" in thread.failure
    thread.end()
    assert not thread.is_alive


def test_delays_between_restarts_grow_up_to_a_bound(monkeypatch: pytest.MonkeyPatch):
    waits: list[float] = []
    thread = SteadyThread("test", fail, lambda *_: None)
    monkeypatch.setattr(steady_thread, "_FIRST_WAIT_S", 1.0)
    monkeypatch.setattr(steady_thread, "_LONGEST_WAIT_S", 60.0)

    def wait(seconds: float) -> bool:
        waits.append(seconds)
        if len(waits) == 9:
            thread.ending.set()
        return True

    monkeypatch.setattr(thread.ending, "wait", wait)
    thread._run()
    assert waits == [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0, 60.0]
