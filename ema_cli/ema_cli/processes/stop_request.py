"""Signals that are deferred until the program can end without damage."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that request the end of a process."""


class StopRequest:
    """Whether a signal has requested the end of the process, and which.

    Attributes
    ----------
    number
        The first signal; None before any.
    """

    def __init__(self) -> None:
        self.number: int | None = None

    def __bool__(self) -> bool:
        return self.number is not None

    def record(self, number: int, _: Any) -> None:
        """Record the first signal only, since a handler may interrupt any code."""
        if self.number is None:
            self.number = number


@contextmanager
def deferred_signals(*signals: signal.Signals) -> Iterator[StopRequest]:
    """Record signals, by default SIGINT, instead of ending at any point of the program.

    An interrupt in the middle of a write would leave a damaged recording, and one in the middle of
    a compilation a traceback of the compiler. A SIGHUP that is ignored, as under nohup, stays so.
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
