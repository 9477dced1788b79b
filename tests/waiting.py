# SPDX-License-Identifier: Apache-2.0
"""Waiting for conditions, with deadlines that a busy machine meets."""

import math
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# Nothing takes a tenth of this on an idle machine.
DEADLINE_S = 90.0


def wait_for(condition: Callable[[], Any], what: str, deadline_s: float = DEADLINE_S) -> Any:
    """Wait until a condition is true, and return its value.

    Parameters
    ----------
    condition
        Function to call repeatedly.
    what
        Description of the condition for the error message.
    deadline_s
        Longest time to wait [s].

    Raises
    ------
    AssertionError
        If the condition is not true in time.
    """
    pause, end_s = threading.Event(), time.monotonic() + deadline_s
    while not (result := condition()):
        assert time.monotonic() < end_s, f"not within {deadline_s:g} s: {what}"
        pause.wait(0.01)
    return result


class SimulatedTime(threading.Event):
    """A clock that advances only during ``wait``; an event that sets itself at a time."""

    def __init__(self, set_at_s: float = math.inf) -> None:
        super().__init__()
        self.now_s = 100.0
        self._set_at_s = self.now_s + set_at_s

    def monotonic(self) -> float:
        return self.now_s

    def time_ns(self) -> int:
        return round(1e9 * self.now_s)

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        if not self.is_set():
            self.now_s = min(self.now_s + timeout, self._set_at_s)
        if self.now_s == self._set_at_s:
            self.set()
        return self.is_set()


@contextmanager
def started(command: list[Any], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """Start a process like ``subprocess.Popen``, and kill it on exit from the context."""
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            process.kill()
