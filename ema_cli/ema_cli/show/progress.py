"""Progress bars on standard error, so that standard output stays clean."""

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


class _State(ProgressColumn):
    """What a task is doing at the moment, if it says so."""

    def render(self, task: Task) -> str:
        return str(task.fields.get("state", ""))


def progress_bar() -> Progress:
    """Return a progress bar that shows only on a terminal; a task may say its ``state``."""
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        _State(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
