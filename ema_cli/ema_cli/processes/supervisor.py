# SPDX-License-Identifier: Apache-2.0
"""Supervision of child processes, which end with the process that started them."""

import ctypes
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from functools import partial
from pathlib import Path
from typing import Final

POLL_S: Final = 0.05
_HEAD_START_S: Final = 1.0
_PR_SET_PDEATHSIG: Final = 1


class Supervisor(AbstractContextManager["Supervisor", None]):
    """Starts processes, reports unexpected exits, and stops all processes at the end.

    Every process has its own session, so that Ctrl-C reaches only the supervisor, which stops the
    processes in order. If the supervisor is killed, the processes receive SIGTERM. Use it as a
    context manager in the main thread.

    Parameters
    ----------
    report
        Called with a status line about a process.
    last
        Name of the process to stop last, such as a recorder of the final messages.
    patience_s
        Time between SIGTERM and SIGKILL [s].

    Attributes
    ----------
    failed
        Names of the processes that exited unexpectedly with a nonzero code.
    """

    def __init__(
        self, report: Callable[[str], None], last: str = "", patience_s: float = 5.0
    ) -> None:
        self._output = report
        self._last = last
        self._patience_s = patience_s
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self.failed: list[str] = []
        # Loaded here, because a child should do as little as possible between fork and exec.
        self._prctl = ctypes.CDLL(None).prctl

    def __exit__(self, *_: object) -> None:
        self.stop_all()

    @property
    def running(self) -> list[str]:
        """Names of the running processes, in the order in which they were started."""
        return list(self._children)

    def start(self, name: str, command: Sequence[str], log: Path | None = None) -> None:
        """Start a process.

        Parameters
        ----------
        name
            Name of the process in reports.
        command
            Program and arguments.
        log
            File for its output; None for the output of the supervisor.
        """
        output = log.open("wb") if log else None
        try:
            self._children[name] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT if output else None,
                start_new_session=True,
                preexec_fn=partial(self._prctl, _PR_SET_PDEATHSIG, int(signal.SIGTERM)),
            )
        finally:
            if output:
                output.close()

    def check(self) -> None:
        """Report processes that have exited, and add those with a nonzero code to ``failed``."""
        for name, child in list(self._children.items()):
            code = child.poll()
            if code is None:
                continue
            del self._children[name]
            if code == 0:
                self._report(f"{name} has exited")
                continue
            self.failed.append(name)
            how = f"failed, exit code {code}"
            if code < 0:
                is_signal = -code in set(signal.Signals)
                how = (
                    "was terminated by "
                    f"{signal.Signals(-code).name if is_signal else f'signal {-code}'}"
                )
            self._report(f"{name} {how}")

    def stop(self, name: str) -> None:
        """Stop a process if it is running, and wait for its exit."""
        self._await_exit(self._terminate([name]))

    def stop_all(self) -> None:
        """Stop all processes and wait for their exit.

        The process ``last`` is stopped when the others have exited, or after 1 s.
        """
        children = self._terminate([name for name in self._children if name != self._last])
        _wait(children.values(), _HEAD_START_S)
        self._await_exit({**children, **self._terminate([self._last])})

    def _terminate(self, names: Iterable[str]) -> dict[str, "subprocess.Popen[bytes]"]:
        self.check()
        children = {name: self._children.pop(name) for name in names if name in self._children}
        for child in children.values():
            child.terminate()
        return children

    def _await_exit(self, children: dict[str, "subprocess.Popen[bytes]"]) -> None:
        _wait(children.values(), self._patience_s)
        for name, child in children.items():
            if child.poll() is None:
                self._report(f"{name} did not exit within {self._patience_s:g} s and is killed")
                child.kill()
                child.wait()

    def _report(self, line: str) -> None:
        # Ignore a closed pipe: the processes must be stopped in any case.
        with suppress(OSError):
            self._output(line)


def _wait(children: Iterable["subprocess.Popen[bytes]"], longest_s: float) -> None:
    deadline = time.monotonic() + longest_s
    for child in children:
        with suppress(subprocess.TimeoutExpired):
            child.wait(max(0.0, deadline - time.monotonic()))
