# SPDX-License-Identifier: Apache-2.0
"""Display of progress on standard error, as a bar or as lines."""

import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from operator import length_hint
from typing import TYPE_CHECKING, Any, Final, Self, cast

import click

from ema_core.wording import time_text

if TYPE_CHECKING:
    from rich.progress import Progress

FIRST_LINE_S: Final = 5.0
LINES_S: Final = 10.0


class _Lines:
    """Replacement for a progress bar that prints lines about the newest task.

    A thread prints the lines, because a task may report nothing for minutes.
    """

    def __init__(self) -> None:
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._print, daemon=True)
        self.add_task("starting")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def add_task(self, description: str, total: float | None = None, state: str = "") -> int:
        self._description, self._total, self._state = description, total, state
        self._completed, self._began_s = 0.0, time.monotonic()
        return 0

    def update(self, _: int, **fields: Any) -> None:
        self._total = fields.get("total", self._total)
        self._completed = fields.get("completed", self._completed) + fields.get("advance", 0.0)
        self._state = fields.get("state", self._state)

    def advance(self, task: int, advance: float = 1.0) -> None:
        self.update(task, advance=advance)

    def track(
        self, items: Iterable[Any], total: float | None = None, description: str = "working"
    ) -> Iterator[Any]:
        task = self.add_task(description, total or length_hint(items) or None)
        for item in items:
            yield item
            self.advance(task)

    def _print(self) -> None:
        wait_s = FIRST_LINE_S
        while not self._ended.wait(wait_s):
            click.echo(str(self), err=True)
            wait_s = LINES_S

    def __str__(self) -> str:
        parts, passed_s = [self._state], time.monotonic() - self._began_s
        if self._total and self._completed:
            parts.insert(0, f"{self._completed / self._total:.0%}")
            left_s = passed_s * max(self._total / self._completed - 1.0, 0.0)
            parts.append(f"about {time_text(left_s)} left")
        else:
            parts.append(f"{time_text(passed_s)} so far")
        return f"{self._description}: {', '.join(filter(None, parts))}"


def progress_bar() -> AbstractContextManager["Progress"]:
    """Return a progress bar as a context manager.

    Without a terminal, it prints a line after 5 s and then every 10 s. The field ``state`` of a
    task is shown with it.
    """
    if not sys.stderr.isatty():
        # Import rich only for a terminal: the import takes as long as `ema info`.
        return cast("Progress", _Lines())
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    class State(ProgressColumn):
        """Current state of a task, if it reports one."""

        def render(self, task: Task) -> str:
            return str(task.fields.get("state", ""))

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        State(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
