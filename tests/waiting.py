"""Waiting for conditions: on a busy machine everything comes, though late."""

import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# Nothing takes a tenth of this on an idle machine.
DEADLINE_S = 90.0


def wait_for(condition: Callable[[], Any], what: str, deadline_s: float = DEADLINE_S) -> Any:
    """Wait until a condition holds, and return what it returned.

    Parameters
    ----------
    condition
        Asked again and again.
    what
        What is waited for, for the message.
    deadline_s
        How long at most [s].

    Raises
    ------
    AssertionError
        If it does not hold in time.
    """
    pause, end_s = threading.Event(), time.monotonic() + deadline_s
    while not (result := condition()):
        assert time.monotonic() < end_s, f"not within {deadline_s:g} s: {what}"
        pause.wait(0.01)
    return result


@contextmanager
def started(command: list[Any], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """Start a process as ``subprocess.Popen`` does; what has not ended in the end is killed."""
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            process.kill()
