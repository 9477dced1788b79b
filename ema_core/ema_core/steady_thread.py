# SPDX-License-Identifier: Apache-2.0
"""Thread that reports an unexpected end of its work and restarts it."""

import threading
import time
import traceback
from collections.abc import Callable
from typing import Final

from ema_core.wording import counted

_FIRST_WAIT_S: Final = 1.0
_LONGEST_WAIT_S: Final = 60.0
_SETTLED_S: Final = 10.0


class SteadyThread:
    """Runs ``work`` in a thread until ``end`` is called; restarts it if it returns or raises.

    The delay before a restart is 1 s, doubling up to 60 s. It resets to 1 s if the work ran for
    longer than the last delay. After each unexpected end, the thread calls ``on_failure`` with the
    reason in one line, and the traceback.

    Attributes
    ----------
    ending
        Event that is set to end the thread.
    ends
        Number of unexpected ends of the work.
    """

    def __init__(
        self, name: str, work: Callable[[], object], on_failure: Callable[[str, str], object]
    ) -> None:
        self.ending = threading.Event()
        self.ends = 0
        self._name = name
        self._work = work
        self._on_failure = on_failure
        self._failure = ""
        self._begun_s = 0.0
        self._is_working = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    @property
    def is_alive(self) -> bool:
        """Whether the thread has started and not ended."""
        return self._thread.is_alive()

    @property
    def failure(self) -> str:
        """Reason of the last unexpected end and number of ends; "" from 10 s after a restart."""
        if self._is_working and time.monotonic() - self._begun_s >= _SETTLED_S:
            return ""
        return self._failure

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def end(self, join_s: float | None = None) -> None:
        """Set ``ending`` and wait for the thread for up to ``join_s`` [s], None for no limit."""
        self.ending.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(join_s)

    def _run(self) -> None:
        wait_s = _FIRST_WAIT_S
        while not self.ending.is_set():
            self._begun_s, self._is_working = time.monotonic(), True
            # Also catch SystemExit: nothing else would report it.
            try:
                self._work()
                reason, trace = "it returned", ""
            except BaseException as error:
                reason, trace = repr(error), traceback.format_exc()
            self._is_working = False
            if self.ending.is_set():
                return
            if time.monotonic() - self._begun_s > wait_s:
                wait_s = _FIRST_WAIT_S
            self.ends += 1
            self._failure = (
                f"the {self._name} thread has ended: {reason}; restarted after {wait_s:g} s "
                f"({counted(self.ends, 'end')} so far)"
            )
            try:
                self._on_failure(self._failure, trace)
            except Exception:
                self._failure += f"; not reported: {traceback.format_exc(limit=1)}"
            self.ending.wait(wait_s)
            wait_s = min(2.0 * wait_s, _LONGEST_WAIT_S)
