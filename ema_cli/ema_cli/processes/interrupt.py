"""Ctrl-C that waits until it does no harm."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def deferred_interrupt() -> Iterator[threading.Event]:
    """Set an event on Ctrl-C instead of raising wherever the program happens to be.

    An interrupt in the middle of a write would leave a damaged recording, and one in the middle of
    a compilation a traceback of the compiler.
    """
    interrupted = threading.Event()
    before = signal.signal(signal.SIGINT, lambda *_: interrupted.set())
    try:
        yield interrupted
    finally:
        signal.signal(signal.SIGINT, before)
