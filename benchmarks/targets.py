# SPDX-License-Identifier: Apache-2.0
"""Targets beside what was measured, and tables of figures."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rich.markup import escape
from rich.table import Table


class Row(NamedTuple):
    """A row of the table of targets; ``met`` is None where no target is set."""

    what: str
    target: str
    measured: str
    met: bool | None
    beside: str = ""


def at_most(what: str, value: float, limit: float, measured: str = "", beside: str = "") -> Row:
    """Return the row of a value that is to be at most so large."""
    return Row(what, f"<= {limit:g}", measured or f"{value:.2f}", bool(value <= limit), beside)


def at_least(what: str, value: float, limit: float, measured: str = "") -> Row:
    """Return the row of a value that is to be at least so large."""
    return Row(what, f">= {limit:g}", measured or f"{value:.2f}", bool(value >= limit))


def share_at_most(what: str, share: float, limit: float, of: int) -> Row:
    """Return the row of a share of so many, which is to be at most so large."""
    return at_most(f"{what} [%]", 100.0 * share, 100.0 * limit, f"{100.0 * share:.2f} of {of}")


def share_at_least(what: str, flags: Sequence[Any], limit: float) -> Row:
    """Return the row of how many of some conditions hold, of which a share is to."""
    share = 100.0 * sum(map(bool, flags)) / max(1, len(flags))
    return at_least(f"{what} [%]", share, 100.0 * limit, f"{share:.1f} of {len(flags)}")


def none_of(what: str, count: int, measured: str = "") -> Row:
    """Return the row of what is not to happen."""
    return Row(what, "0", measured or str(count), count == 0)


def all_of(what: str, met: Iterable[bool], worst: str = "") -> Row:
    """Return the row of conditions that are all to be met, with the worst in words."""
    flags = list(met)
    measured = f"{sum(flags)}; {worst}" if worst else str(sum(flags))
    return Row(what, str(len(flags)), measured, len(flags) > 0 and all(flags))


def untargeted(what: str, measured: str) -> Row:
    """Return the row of a figure without a target."""
    return Row(what, "", measured, None)


def target_table(title: str, rows: Iterable[Row], beside: str = "") -> Table:
    """Return what was measured beside its targets and the figures of others, as named."""
    table = Table("what", "target", "measured", "met", beside, title=title)
    for column in table.columns:
        column.no_wrap = True
    for row in rows:
        met = {None: "", True: "[green]yes[/]", False: "[bold red]no[/]"}[row.met]
        # A unit in brackets would be taken for markup.
        table.add_row(escape(row.what), row.target, row.measured, met, row.beside)
    return table


def grid(
    title: str, headings: Iterable[str], rows: Iterable[Iterable[Any]], digits: int = 2
) -> Table:
    """Return a table: names to the left, figures with so many digits to the right."""

    def shown(cell: Any) -> str:
        text = f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell)
        # Of what is not known the cell stays empty.
        return escape(text.replace("nan", ""))

    table = Table(*map(escape, headings), title=escape(title))
    for column in table.columns[1:]:
        column.justify = "right"
    for row in rows:
        table.add_row(*map(shown, row))
    return table


def percent(share: float, digits: int = 0) -> str:
    """Return a share as a percentage; nothing where it is NaN."""
    return "" if share != share else f"{100.0 * share:.{digits}f}"
