"""Signals that wait until it does no harm to end."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals by which a process is asked to end."""


class StopRequest:
    """Whether the process was asked to end, and by which signal.

    Attributes
    ----------
    number
        The first signal; None as long as there was none.
    """

    def __init__(self) -> None:
        self.number: int | None = None

    def __bool__(self) -> bool:
        return self.number is not None

    def record(self, number: int, _: Any) -> None:
        """Handle a signal; since this may interrupt anything, it does nothing else."""
        if self.number is None:
            self.number = number


@contextmanager
def deferred_signals(*signals: signal.Signals) -> Iterator[StopRequest]:
    """Record signals, SIGINT if none is named, instead of ending wherever the program is.

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
