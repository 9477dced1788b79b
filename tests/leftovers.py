# SPDX-License-Identifier: Apache-2.0
"""What a test may not leave behind: DDS participants and threads of Python."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Threads of nodes may finish a kernel first, on whatever cores a busy machine has left.
DEADLINE_S = 60.0


def participants() -> set[str]:
    """Return the event threads of Fast DDS in this process: each participant has one."""
    found = set()
    for folder in Path("/proc/self/task").iterdir():
        try:
            name = (folder / "comm").read_text()
        except OSError:  # it has just ended
            continue
        if name.startswith("dds.ev."):
            found.add(f"DDS participant (thread {folder.name})")
    return found


def threads() -> set[threading.Thread]:
    """Return the threads of Python, but for the pool of the monitor model: a process keeps it."""
    return {item for item in threading.enumerate() if not item.name.startswith("model_")}


@contextmanager
def nothing_left(deadline_s: float = DEADLINE_S) -> Iterator[None]:
    """Fail if participants or threads that began within are still there after a deadline.

    Nothing is left to the garbage collector: it would destroy a participant in the midst of
    another test, and Fast DDS may then wait for ever while it holds the interpreter's lock.
    """
    participants_before, threads_before = participants(), threads()
    yield
    end_s = time.monotonic() + deadline_s
    while True:
        begun = threads() - threads_before
        left = sorted(participants() - participants_before) + [repr(item) for item in begun]
        if not left:
            return
        if time.monotonic() > end_s:
            raise AssertionError(f"left behind: {', '.join(left)}")
        for item in begun:
            item.join(0.05)
        threading.Event().wait(0.01)
