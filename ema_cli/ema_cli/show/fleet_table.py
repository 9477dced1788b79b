"""A fleet as it changes: a table on a terminal, else a line for each change."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

import click
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ema_cli.fleet import Row
from ema_cli.show.levels import COLOURS, level_in_words
from ema_cli.show.terminal_display import TerminalDisplay
from ema_core.wording import counted

_LINES_BESIDE: Final = 6
_REASONS: Final = 3
"""Number of actuators, the worst first, whose reasons are shown."""


class FleetTable(TerminalDisplay):
    """Shows the actuators of a fleet; to be used under ``with``."""

    def __init__(self, title: str, console: Console | None = None) -> None:
        super().__init__(console)
        self._title = title
        self._told: dict[tuple[str, str], tuple[object, ...]] = {}
        self._said = ""

    def show(self, rows: Sequence[Row], state: str) -> None:
        """Show the actuators, and what there is to say of the whole."""
        if self._console.is_terminal:
            self._live.update(self._table(rows, state), refresh=True)
            return
        for row in rows:
            key = row.place, row.actuator_id
            if self._told.get(key) != row.content:
                self._told[key] = row.content
                click.echo(f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC  {_line(row)}")
        if not rows and state != self._said:
            click.echo(state, err=True)
        self._said = state

    def _table(self, rows: Sequence[Row], state: str) -> Table:
        shown = rows[: max(3, self._console.height - _LINES_BESIDE)]
        reasons = [f"{row.actuator_id}: {row.why}" for row in shown[:_REASONS] if row.why]
        table = Table(
            title=f"{counted(len(rows), 'actuator')} {self._title}",
            title_justify="left",
            caption="\n".join(filter(None, (*reasons, state))),
            caption_justify="left",
            box=SIMPLE_HEAD,
            show_edge=False,
            padding=(0, 1, 0, 0),
        )
        table.add_column("actuator")
        table.add_column("level", no_wrap=True)
        table.add_column("index", justify="right", no_wrap=True)
        table.add_column("dominant (limit)")
        table.add_column("RUL [h]\n50 % (5 to 95)", justify="right")
        table.add_column("remove\nbefore", justify="right")
        table.add_column("last\ntest", justify="right")
        for row in shown:
            table.add_row(
                Text(_name(row, rows)),
                Text(level_in_words(row.level), COLOURS[row.level]),
                _index(row),
                Text(row.dominant or "-"),
                _life(row),
                row.remove_before or "-",
                age_in_words(row.test_age_s),
            )
        return table


def age_in_words(seconds: float) -> str:
    """Return a time that has passed [s] in the unit that suits it."""
    if not math.isfinite(seconds):
        return "-"
    for size, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


def _name(row: Row, rows: Sequence[Row]) -> str:
    several = len({other.place for other in rows}) > 1
    return f"{row.place}/{row.actuator_id}" if several else row.actuator_id


def _index(row: Row) -> str:
    return f"{row.health_index:.2f}" if math.isfinite(row.health_index) else "-"


def _life(row: Row) -> str:
    if row.life is None:
        return "unknown"
    low, median, high = (f"{hours:,.0f}" if math.isfinite(hours) else "more" for hours in row.life)
    return f"{median} ({low} to {high})"


def _line(row: Row) -> str:
    """Return an actuator as one plain line."""
    life = _life(row)
    parts = (
        level_in_words(row.level),
        f"{row.place}/{row.actuator_id} ({row.serial_number})",
        f"index {_index(row)}",
        row.dominant,
        f"RUL {life}{' h' * (row.life is not None)}",
        f"remove before {row.remove_before}" if row.remove_before.endswith("h") else "",
        "remove now" if row.remove_before == "now" else "",
        f"last test {age_in_words(row.test_age_s)} ago",
        row.why,
    )
    return "  ".join(filter(None, parts))
