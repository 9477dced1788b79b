"""A display that a terminal shows in place."""

from typing import Self

from rich.console import Console
from rich.live import Live


class TerminalDisplay:
    """Shows a table in place where there is a terminal; to be used under ``with``."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console()
        self._live = Live(console=self._console, auto_refresh=False)

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._console.is_terminal:
            self._live.stop()
