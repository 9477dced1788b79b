# SPDX-License-Identifier: Apache-2.0
"""Tables of targets with measured values, and of results."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rich.markup import escape
from rich.table import Table


class Row(NamedTuple):
    """A row of the table of targets.

    ``met`` is None without a target. ``beside`` is a reference value.
    """

    what: str
    target: str
    measured: str
    met: bool | None
    beside: str = ""


def at_most(what: str, value: float, limit: float, measured: str = "", beside: str = "") -> Row:
    """Return the row of a value with an upper limit."""
    return Row(what, f"<= {limit:g}", measured or f"{value:.2f}", bool(value <= limit), beside)


def at_least(what: str, value: float, limit: float, measured: str = "") -> Row:
    """Return the row of a value with a lower limit."""
    return Row(what, f">= {limit:g}", measured or f"{value:.2f}", bool(value >= limit))


def share_at_most(what: str, share: float, limit: float, of: int) -> Row:
    """Return the row of a share [-] of ``of`` items with an upper limit [-]."""
    return at_most(f"{what} [%]", 100.0 * share, 100.0 * limit, f"{100.0 * share:.2f} of {of}")


def share_at_least(what: str, flags: Sequence[Any], limit: float) -> Row:
    """Return the row of the share of true flags, with a lower limit [-]."""
    share = 100.0 * sum(map(bool, flags)) / max(1, len(flags))
    return at_least(f"{what} [%]", share, 100.0 * limit, f"{share:.1f} of {len(flags)}")


def none_of(what: str, count: int, measured: str = "") -> Row:
    """Return the row of a count that must be 0."""
    return Row(what, "0", measured or str(count), count == 0)


def all_of(what: str, met: Iterable[bool], worst: str = "") -> Row:
    """Return the row of conditions that must all be met; ``worst`` describes the worst one."""
    flags = list(met)
    measured = f"{sum(flags)}; {worst}" if worst else str(sum(flags))
    return Row(what, str(len(flags)), measured, len(flags) > 0 and all(flags))


def untargeted(what: str, measured: str) -> Row:
    """Return the row of a measured value without a target."""
    return Row(what, "", measured, None)


def target_table(title: str, rows: Iterable[Row], beside: str = "") -> Table:
    """Return the table of targets; ``beside`` is the heading of the reference values."""
    table = Table("what", "target", "measured", "met", beside, title=title)
    for column in table.columns:
        column.no_wrap = True
    for row in rows:
        met = {None: "", True: "[green]yes[/]", False: "[bold red]no[/]"}[row.met]
        # rich would interpret a unit in brackets as markup.
        table.add_row(escape(row.what), row.target, row.measured, met, row.beside)
    return table


def grid(
    title: str, headings: Iterable[str], rows: Iterable[Iterable[Any]], digits: int = 2
) -> Table:
    """Return a table with names on the left and right-aligned values.

    ``digits`` is the number of decimals of floats.
    """

    def shown(cell: Any) -> str:
        text = f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell)
        # The cell of an unknown value is empty.
        return escape(text.replace("nan", ""))

    table = Table(*map(escape, headings), title=escape(title))
    for column in table.columns[1:]:
        column.justify = "right"
    for row in rows:
        table.add_row(*map(shown, row))
    return table


def percent(share: float, digits: int = 0) -> str:
    """Return a share as a percentage, or "" for NaN."""
    return "" if share != share else f"{100.0 * share:.{digits}f}"
