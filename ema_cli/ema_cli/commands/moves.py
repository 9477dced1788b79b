# SPDX-License-Identifier: Apache-2.0
"""``ema moves``: diagnosis from measurements of whole moves, for drives that log no samples."""

import json
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ema_cli.options import REFUSED
from ema_core.levels import ERROR, LEVEL_NAMES, WARN
from ema_core.wording import counted
from ema_monitor.joint.moves import MoveSeries, MoveVerdict
from ema_monitor.reason_texts import figure_text


@click.command()
@click.argument("table", type=click.Path(path_type=Path, dir_okay=False, exists=True))
@click.option(
    "--mapping",
    "mapping_file",
    type=click.Path(path_type=Path),
    required=True,
    help="YAML file with the names of the columns (docs/real-data.md).",
)
@click.option(
    "--limit", type=float, required=True, help="Ratio to the healthy value at which life ends."
)
@click.option("--reference", type=int, default=5, help="Number of healthy tests at the start.")
@click.option("--json", "as_json", is_flag=True, help="Print a list with an object per test.")
def moves(table: Path, mapping_file: Path, limit: float, reference: int, as_json: bool) -> None:
    """Compare each test in TABLE (CSV or Parquet, a row per move) with earlier tests.

    Exit code 3: the last test of a unit departs or exceeds the limit.
    """
    from ema_bags.inputs.moves import load_moves_mapping, read_moves

    units = read_moves(table, load_moves_mapping(mapping_file))
    judged = {}
    for unit, series in units.items():
        follow = MoveSeries(limit=limit, reference=reference)
        judged[unit] = [(move, follow.add(move)) for move in series]
    if as_json:
        rows = [
            {
                "unit": unit,
                "stamp_ns": move.stamp_ns,
                "ratio": item.ratio,
                "level": LEVEL_NAMES[item.level],
                "probability": item.probability,
                "life_days": None if item.life_days is None else list(item.life_days),
                "reason": _reason(item, limit),
            }
            for unit, series in judged.items()
            for move, item in series
        ]
        click.echo(json.dumps(rows))
    else:
        for unit, series in judged.items():
            _show(unit, [(move.stamp_ns, verdict) for move, verdict in series], limit)
    if any(series[-1][1].level in (WARN, ERROR) for series in judged.values() if series):
        raise click.exceptions.Exit(REFUSED)


def _show(unit: str, series: list[tuple[int, MoveVerdict]], limit: float) -> None:
    import pandas as pd

    title = f"{escape(unit) or 'unit'}: {counted(len(series), 'test')}"
    columns = ("time", "times healthy", "level", "life in days, 5 / 50 / 95 %", "why")
    table = Table(*columns, title=title)
    for stamp_ns, verdict in series:
        life = " / ".join(f"{value:.1f}" for value in verdict.life_days or ())
        time = f"{pd.Timestamp(stamp_ns):%Y-%m-%d %H:%M}"
        level, why = LEVEL_NAMES[verdict.level], escape(_reason(verdict, limit))
        table.add_row(time, f"{verdict.ratio:.2f}", level, life, why)
    Console().print(table)


def _reason(verdict: MoveVerdict, limit: float) -> str:
    """Return the reason for the level of a move."""
    departure = verdict.departure
    if departure is None:
        return "reference" + (f"; {verdict.missing} more needed" if verdict.missing else "")
    if verdict.level == ERROR:
        return f"{verdict.ratio:.2f} times healthy: the limit of {limit:g} is exceeded"
    if not departure.changes:
        return "no figure departs"
    return figure_text(departure.changes[0].departed)
