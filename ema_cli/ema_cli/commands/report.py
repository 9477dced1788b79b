# SPDX-License-Identifier: Apache-2.0
"""``ema report``: write a page with a unit's verdict, evidence and pictures."""

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import click

from ema_archive.fleet import fleet_summary
from ema_cli.bags.predicting import Predicting
from ema_cli.bags.unit_course import diagnose_unit, find_bags
from ema_cli.main import ARGUMENTS
from ema_cli.options import REFUSED
from ema_cli.output import output_option, require_free
from ema_cli.parameters import settings_options
from ema_cli.report.page import fleet_page, report_page
from ema_cli.report.verdict import is_unjudged, verdict_of
from ema_core.event_kinds import EventKind
from ema_core.files import complete_file
from ema_monitor.prognosis.events import UnitEvent
from ema_monitor.prognosis.history import history_path, read_history

_NOTED: Final = (EventKind.NOTE, EventKind.CALIBRATION)


@click.command()
@click.argument("bags", metavar="BAG...", nargs=-1, type=click.Path(path_type=Path))
@settings_options(Predicting)
@output_option("Page to write (.html)", required=False, dir_okay=False, default="report.html")
@click.pass_context
def report(
    context: click.Context,
    bags: tuple[Path, ...],
    options: Predicting,
    overwrite: bool,
    output: Path,
) -> None:
    """Write a report on a unit from the tests in bags, or folders of bags.

    All tests must belong to one unit, as for `ema predict`. Notes and baseline changes come from
    its history ACTUATOR+SERIAL.sqlite, given as a BAG, or in the folder of a BAG or its subfolder
    `history`. The page is self-contained. Without a BAG, --fleet reports on the fleet of an `ema
    archive`.

    Exit code 3: no test has a valid estimate, the newest test has failed or departed, or the newest
    record does not determine the level.
    """
    archive = options.archive
    histories = [path for path in bags if path.suffix == ".sqlite"]
    bags = tuple(path for path in bags if path not in histories)
    if (archive is None) == (not bags):
        raise click.UsageError("expected at least one BAG, or --fleet ARCHIVE")
    command = shlex.join(context.meta[ARGUMENTS])
    files = filter(None, (options.calibration_file, options.actuator_file))
    inputs = [*find_bags(bags), *files]
    require_free(output, inputs, overwrite=overwrite, endings=(".html", ".htm"))
    if archive is not None:
        lines, is_useless = (), False
        page = fleet_page(archive, fleet_summary(archive), command)
    else:
        course = diagnose_unit(bags, options, skips_unreadable=True)
        verdict = verdict_of(course)
        lines = verdict.lines
        is_useless = not course.outlooks or bool(course.now.finding) or is_unjudged(course)
        unit = course.record.description.unit_key
        notes = _notes(histories or _beside(bags, unit), unit)
        page = report_page(bags, course, verdict, command, notes)
    with complete_file(output) as partial:
        partial.write_text(page, encoding="utf-8", errors="backslashreplace")
    for line in (*lines, output):
        click.echo(f"{line}")
    if is_useless:
        sys.exit(REFUSED)


def _beside(bags: Sequence[Path], unit: tuple[str, str]) -> list[Path]:
    """Return the histories of a unit in the bags' folders and their ``history`` subfolders."""
    folders = dict.fromkeys(
        folder for bag in map(Path.resolve, bags) for folder in (bag, bag.parent)
    )
    paths = [
        history_path(folder / inner, *unit) for folder in folders for inner in (".", "history")
    ]
    return [path for path in paths if path.is_file()]


def _notes(histories: Sequence[Path], unit: tuple[str, str]) -> list[UnitEvent]:
    """Return a unit's notes and baseline changes from its histories, oldest first."""
    loaded = [read_history(path) for path in histories]
    for path, history in zip(histories, loaded, strict=True):
        if history.unit != unit:
            raise ValueError(f"{path}: expected a history of {unit[0]} ({unit[1]})")
    kept = (assessment.events for history in loaded for assessment in history.assessments.values())
    notes = [event for events in kept for event in events if event.kind in _NOTED]
    return sorted(notes, key=lambda event: event.stamp_ns)
