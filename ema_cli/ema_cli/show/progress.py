"""Progress bars on standard error, so that standard output stays clean."""

import sys
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from rich.progress import Progress


class _Hidden:
    """What commands call of a progress bar, without effect."""

    def add_task(self, *_: Any, **__: Any) -> int:
        return 0

    def update(self, *_: Any, **__: Any) -> None:
        pass

    advance = update

    def track(self, items: Iterable[Any], **_: Any) -> Iterable[Any]:
        return items


def progress_bar() -> AbstractContextManager["Progress"]:
    """Return a progress bar that shows only on a terminal; a task may say its ``state``."""
    if not sys.stderr.isatty():
        # rich is not imported for nobody: it takes as long as `ema info` has.
        return nullcontext(cast("Progress", _Hidden()))
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
        """What a task is doing at the moment, if it says so."""

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
