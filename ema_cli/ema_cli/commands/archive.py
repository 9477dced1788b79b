# SPDX-License-Identifier: Apache-2.0
"""``ema archive``: store the results of a fleet's bags in tables, update and query them."""

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ema_archive.manifest import Manifest, Status
from ema_archive.query import FORMATS, answer, columns_of, export
from ema_archive.running import run, scan
from ema_archive.settings import ArchiveSettings
from ema_cli.bags.identifying import ALGORITHM_OPTION, SEED_OPTION
from ema_cli.bags.predicting import GROWTH_OPTIONS, PROGNOSIS_SECTIONS, prognosis_over, with_growth
from ema_cli.bags.reading import ReadingOptions
from ema_cli.executor_options import ExecutorOptions, executor_options
from ema_cli.options import REFUSED
from ema_cli.output import output_option, require_free
from ema_cli.parameters import Command, Parameters, settings_options
from ema_cli.progress import progress_bar
from ema_cli.show.prognosis_table import as_values
from ema_core.wording import counted
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.windows.trigger import TEST_CYCLE

_ARCHIVE = click.argument("folder", metavar="ARCHIVE", type=click.Path(path_type=Path))
_LONGEST_REASON: Final = 200
_MOST_NAMED: Final = 3
_USUAL_REASON: Final = (
    "SELECT arg_min(reason, (bag, number)) FROM refused WHERE number IS NOT NULL "
    "GROUP BY codes ORDER BY count(*) DESC, codes LIMIT 1"
)


@dataclass(frozen=True)
class GivenSettings:
    """Archive settings from the command line; unspecified settings remain unchanged."""

    OPTIONS: ClassVar[tuple[Callable[[Command], Command], ...]] = (
        click.option(
            "--calibration",
            metavar="PATTERN",
            help=(
                "Path of the units' calibrations, with {actuator_id} and {serial_number} "
                "replaced for each unit; by default calibration.yaml next to the bags, else the "
                "shipped calibration."
            ),
        ),
        ALGORITHM_OPTION,
        SEED_OPTION,
        *GROWTH_OPTIONS,
    )
    SECTIONS: ClassVar[tuple[tuple[Any, str], ...]] = (
        *ReadingOptions.SECTIONS,
        (SearchSettings, ""),
        *PROGNOSIS_SECTIONS,
    )

    parameters: Parameters

    @classmethod
    def of(cls, parameters: Parameters, calibration: str | None, **growth: Any) -> Self:
        """Build the settings from options and parameters."""
        parameters = parameters.with_options(calibration_file=calibration or None)
        return cls(with_growth(parameters, **growth))

    def applied_to(self, settings: ArchiveSettings) -> ArchiveSettings:
        """Return settings updated with the options; raise ValueError if a setting is invalid."""
        parameters, source = (
            self.parameters,
            ReadingOptions(measured_max_age_s=settings.measured_max_age_s),
        )
        return replace(
            settings,
            calibration=parameters.values.get("calibration_file") or settings.calibration,
            measured_max_age_s=parameters.over(source).measured_max_age_s,
            # An archive stores test cycles, and the rows of a bag depend on that bag only.
            trigger=replace(parameters.over(settings.trigger), windows=TEST_CYCLE),
            search=replace(parameters.over(settings.search), warm_start=False),
            prognosis=prognosis_over(settings.prognosis, parameters),
        )


@click.group()
def archive() -> None:
    """Store results of a fleet's bags in tables: estimates, health, life and growth.

    ARCHIVE is the folder of the tables. `scan` lists bags. `run` processes bags that are new, or
    whose content, calibration, settings or software has changed. `status` counts bags and units.
    `query` and `export` run SQL queries. docs/archive.md lists the columns and views.
    """


@archive.command("scan")
@_ARCHIVE
@click.argument("sources", metavar="[SOURCE]...", nargs=-1)
@settings_options(GivenSettings)
def scan_(folder: Path, sources: tuple[str, ...], options: GivenSettings) -> None:
    """List the bags in and below each SOURCE, a folder or an address such as s3://fleet/bags.

    The archive stores its sources and settings for later scans. New options replace stored
    settings; only the results that depend on them are recomputed.
    """
    with Manifest(folder, is_new=True) as manifest:
        manifest.settings = options.applied_to(manifest.settings)
        if not sources and not manifest.sources:
            raise click.UsageError(f"{folder} has no bags yet: expected a SOURCE")
        with progress_bar() as progress:
            task = progress.add_task("listing", total=None)
            bags = scan(
                manifest, sources, lambda count: progress.update(task, state=counted(count, "bag"))
            )
        status = manifest.status(manifest.settings)
    click.echo(f"{folder}: {counted(bags, 'bag')}")
    click.echo(_due_text(status))


@archive.command("run")
@_ARCHIVE
@executor_options
def run_(folder: Path, executor: ExecutorOptions) -> None:
    """Estimate the faults in outdated bags, then update health and life of outdated units.

    Ctrl-C stops the run at any time; the same command resumes. Unreadable bags become rows with the
    reason. Exit code 3: a bag is unreadable or incomplete, a unit cannot be processed, the order of
    a unit's tests is unknown, or no window is valid.
    """
    with Manifest(folder) as manifest:
        with progress_bar() as progress:
            task = progress.add_task("starting", total=None)
            shown, began_s = "", time.monotonic()

            def follow(what: str, done: int, total: int, failures: int) -> None:
                nonlocal task, shown, began_s
                if what != shown:
                    progress.update(task, visible=False)
                    task, shown = progress.add_task(what, total=total), what
                    began_s = time.monotonic()
                state = f"{done} of {total}"
                if done:
                    state += f", {done / max(time.monotonic() - began_s, 1e-3):.1f} a second"
                if failures:
                    state += f", {failures} failed"
                progress.update(task, completed=done, state=state)

            def stopped() -> str:
                left = counted(manifest.find_due(manifest.settings), "bag")
                return f"stopped: {left} left in {folder}; the same command resumes"

            kept = "completed work is kept; the same command resumes"
            with executor.open(stopped, kept) as workers:
                tally = run(manifest, workers, follow)
        status = manifest.status(manifest.settings)
    click.echo(
        f"{counted(tally.bags, 'bag')} and {counted(tally.units, 'unit')} processed; "
        f"{tally.damaged} damaged, {tally.incomplete} read in part, {tally.failed} unreadable"
    )
    click.echo(_unread_text(status), nl=False)
    click.echo(_refused_text(folder, status), nl=False)
    click.echo(_due_text(status))
    for words in tally.mended:
        click.echo(words, err=True)
    for unit, reason in tally.not_followed.items():
        click.echo(f"unit {unit} could not be processed: {reason}", err=True)
    is_damaged = bool(status.damaged or status.incomplete or status.failed)
    if is_damaged:
        click.echo(f'reasons: ema archive query {folder} "select * from refused_why"', err=True)
    is_useless = bool(status.windows) and not status.valid
    if is_damaged or tally.not_followed or status.unordered or is_useless:
        sys.exit(REFUSED)


@archive.command("status")
@_ARCHIVE
@click.option("--json", "as_json", is_flag=True, help="Print one object.")
def status_(folder: Path, as_json: bool) -> None:
    """Count bags, windows and units, and outdated bags by reason."""
    with Manifest(folder, writes=False) as manifest:
        settings = manifest.settings
        status, sources = manifest.status(settings), manifest.sources
    if as_json:
        values = asdict(status) | {"sources": sources, "settings": settings.as_mapping()}
        click.echo(json.dumps(values, indent=2))
        return
    click.echo(f"{counted(status.bags, 'bag')} of {', '.join(sources)}")
    click.echo(
        f"{counted(status.windows, 'window')}, {status.valid} valid; "
        f"{counted(status.units, 'unit')}"
    )
    click.echo(_unread_text(status), nl=False)
    if status.gone:
        click.echo(f"{counted(status.gone, 'bag')} missing: their results stay")
    click.echo(_refused_text(folder, status), nl=False)
    click.echo(_due_text(status))


@archive.command("query")
@_ARCHIVE
@click.argument("question", metavar="[SQL]", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print a list with an object per row.")
def query_(folder: Path, question: str | None, as_json: bool) -> None:
    """Query the tables in SQL, such as "select * from worst_first limit 20".

    Without SQL, the command lists the tables and views with their columns. A query can only read
    tables of the archive.
    """
    if question is None:
        for name, columns in columns_of(folder).items():
            click.echo(f"{name}: {', '.join(f'{column} {kind}' for column, kind in columns)}")
        return
    names, rows = answer(folder, question)
    if as_json:
        objects = [dict(zip(names, map(_plain, row), strict=True)) for row in rows]
        click.echo(json.dumps(objects, indent=2))
        return
    _print(names, rows)


@archive.command("export")
@_ARCHIVE
@click.argument("what", metavar="TABLE|SQL")
@output_option(f"File to write: {' or '.join(FORMATS)}", dir_okay=False)
def export_(folder: Path, what: str, output: Path, overwrite: bool) -> None:
    """Write a table, a view or the result of an SQL query to a CSV or Parquet file."""
    require_free(output, [], overwrite=overwrite)
    rows = export(folder, what, output)
    click.echo(f"{output}: {counted(rows, 'row')}")


def _unread_text(status: Status) -> str:
    """Return lines on the bags that were not read completely, or belong to no known unit, or ""."""
    lines = [
        f"{counted(count, 'bag')} {what}: later tests may be lost"
        for count, what in (
            (status.damaged, "cannot be read"),
            (status.incomplete, "can be read only in part"),
            (status.failed, "could not be read in the last run"),
        )
        if count
    ]
    if bags := status.of_no_unit:
        more = f" and {len(bags) - _MOST_NAMED} more" if len(bags) > _MOST_NAMED else ""
        what = f"{counted(len(bags), 'bag')} without a known unit cannot be read"
        lines.append(f"{what}: {', '.join(bags[:_MOST_NAMED])}{more}")
    return "".join(f"{line}\n" for line in lines)


def _refused_text(folder: Path, status: Status) -> str:
    """Return a line on the number of refused windows and the most frequent reason, if any."""
    if status.windows == status.valid:
        return ""
    refused = f"{status.windows - status.valid} of {counted(status.windows, 'window')} refused"
    if status.damaged_tables:
        return f"{refused}\n"
    _, rows = answer(folder, _USUAL_REASON)
    return "".join(f"{refused}, most often because: {_shown(reason)}\n" for (reason,) in rows)


def _due_text(status: Status) -> str:
    tables = ""
    if status.damaged_tables:
        tables = f"; {counted(len(status.damaged_tables), 'table')} damaged"
    if not status.due and not status.units_due and not tables:
        return "everything is up to date"
    reasons = ", ".join(f"{count} {why}" for why, count in status.reasons.items())
    bags = counted(status.due, "bag") + (f" ({reasons})" if reasons else "")
    return f"to process: {bags}, {counted(status.units_due, 'unit')}{tables}"


def _plain(value: Any) -> Any:
    return as_values(value) if isinstance(value, int | float | list | None) else str(value)


def _print(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    if not sys.stdout.isatty():
        # For other programs: complete values, separated by tabs.
        click.echo("\t".join(names))
        for row in rows:
            click.echo("\t".join(" ".join(str(_plain(value)).split()) for value in row))
        return
    # ``Text``, so that brackets in a name or reason are not markup.
    table = Table()
    for name in names:
        table.add_column(Text(name))
    for row in rows:
        table.add_row(*(Text(_shown(value)) for value in row))
    Console().print(table)


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    words = "" if value is None else str(value)
    return words if len(words) <= _LONGEST_REASON else f"{words[:_LONGEST_REASON]} ..."
