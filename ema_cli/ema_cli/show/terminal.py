# SPDX-License-Identifier: Apache-2.0
"""Display on a terminal: names, shapes and colours of levels, and a live table."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Self

import click
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.live import Live
from rich.table import Table

from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN

SHAPES: Final[Mapping[int, str]] = MappingProxyType({OK: "●", WARN: "▲", ERROR: "■", STALE: "○"})
COLOURS: Final[Mapping[int, str]] = MappingProxyType(
    {OK: "green", WARN: "yellow", ERROR: "bold red", STALE: "bright_black"}
)
"""Style of each level on a terminal, keyed by level."""


def level_text(level: int) -> str:
    """Return shape and name of a level, such as "● OK"."""
    return f"{SHAPES[level]} {LEVEL_NAMES[level]}"


class TerminalDisplay:
    """Shows a live table if there is a terminal; a context manager."""

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

    def report(self, line: str, *, is_error: bool = False) -> None:
        """Print a line above the live table. Without a terminal, errors go to stderr."""
        if self._console.is_terminal:
            self._console.print(line, markup=False, highlight=False)
        else:
            click.echo(line, err=is_error)

    def _table(self, title: str, *below: str) -> Table:
        """Return an empty table with a title, and the non-empty lines of ``below`` as caption."""
        return Table(
            title=title,
            title_justify="left",
            caption="\n".join(filter(None, below)),
            caption_justify="left",
            box=SIMPLE_HEAD,
            show_edge=False,
            padding=(0, 1, 0, 0),
        )
