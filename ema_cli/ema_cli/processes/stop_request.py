# SPDX-License-Identifier: Apache-2.0
"""Deferred handling of signals, so that a program ends cleanly."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that request the end of a process."""


class StopRequest:
    """Record of the signal, if any, that requested the end of the process.

    Attributes
    ----------
    number
        First received signal; None before any signal.
    """

    def __init__(self) -> None:
        self.number: int | None = None

    def __bool__(self) -> bool:
        return self.number is not None

    def record(self, number: int, _: Any) -> None:
        """Record a signal, as a signal handler; only the first signal counts."""
        if self.number is None:
            self.number = number


@contextmanager
def deferred_signals(*signals: signal.Signals) -> Iterator[StopRequest]:
    """Return a context in which signals, by default SIGINT, are recorded instead of handled.

    An interrupt during a write would damage the recording, and during a compilation would print a
    compiler traceback. An ignored SIGHUP, as under nohup, stays ignored.
    """
    request = StopRequest()
    before = {number: signal.getsignal(number) for number in signals or (signal.SIGINT,)}
    for number, handler in before.items():
        if (number, handler) != (signal.SIGHUP, signal.SIG_IGN):
            signal.signal(number, request.record)
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
