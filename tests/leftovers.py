# SPDX-License-Identifier: Apache-2.0
"""Check that a test leaves no DDS participants and no Python threads behind."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Threads of nodes may have to finish a kernel first, on a busy machine.
DEADLINE_S = 60.0


def participants() -> set[str]:
    """Return the event threads of Fast DDS in this process, one for each participant."""
    names = set()
    for folder in Path("/proc/self/task").iterdir():
        try:
            name = (folder / "comm").read_text()
        except OSError:  # the thread has just ended
            continue
        if name.startswith("dds.ev."):
            names.add(f"DDS participant (thread {folder.name})")
    return names


def threads() -> set[threading.Thread]:
    """Return the Python threads, except the pool of the monitor model, which stays alive."""
    return {item for item in threading.enumerate() if not item.name.startswith("model_")}


@contextmanager
def nothing_left(deadline_s: float = DEADLINE_S) -> Iterator[None]:
    """Fail if participants or threads that began in the context outlive a deadline.

    They must not be left to the garbage collector. It would destroy a participant during another
    test, and Fast DDS may then wait forever while it holds the interpreter lock.
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
