# SPDX-License-Identifier: Apache-2.0
"""``ema predict``: predict a unit's remaining life from bags of its tests."""

import json
import math
import sys
from pathlib import Path

import click
from rich.console import Console

from ema_cli.bags.predicting import Predicting
from ema_cli.bags.unit_course import diagnose_unit
from ema_cli.figures.files import PICTURES, picture_option, save_picture
from ema_cli.figures.prognosis import draw_course
from ema_cli.options import REFUSED
from ema_cli.output import require_free
from ema_cli.parameters import settings_options
from ema_cli.report.verdict import is_unjudged, latest_comparison
from ema_cli.show.prognosis_table import (
    advice_text,
    as_values,
    course_as_values,
    summary,
    table_of_growth,
    table_of_scenarios,
)
from ema_core.levels import LEVEL_NAMES
from ema_core.wording import counted
from ema_monitor.joint.wording import table_text
from ema_monitor.reports import health_report, scenario_report


@click.command()
@click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@settings_options(Predicting)
@click.option("--json", "as_json", is_flag=True, help="Print one object.")
@picture_option()
def predict(
    bags: tuple[Path, ...], options: Predicting, as_json: bool, output: Path | None, overwrite: bool
) -> None:
    """Predict the remaining life of a unit from tests in bags or folders of bags.

    All tests must belong to one unit; they are sorted by their stamps. The results equal the
    messages of a monitor after the last test.

    Exit code 3: no test has a valid estimate, the newest test has failed or departed, or the newest
    record does not determine the level.
    """
    if options.archive is not None:
        raise click.BadParameter(
            f"--fleet {options.archive} is a folder: expected a file of `ema learn-fleet`"
        )
    if output is not None:
        require_free(output, bags, overwrite=overwrite, endings=PICTURES)
    course = diagnose_unit(bags, options)
    record, tests = course.record, counted(len(course.steps), "test")
    report = health_report(course.now, record.description.unit_key)
    if not course.outlooks:
        why = f": {LEVEL_NAMES[report.level]}, {report.cause}" if course.now.finding else ""
        click.echo(
            f"no prognosis: none of {counted(len(course.steps), 'window')} is usable{why}", err=True
        )
        sys.exit(REFUSED)
    if math.isnan(report.flight_hours) and not record.counts:
        click.echo(
            "remaining life unknown: the bags have no usage messages; set --hours-per-cycle",
            err=True,
        )
    scenarios = [scenario_report(*scenario) for scenario in course.scenarios]
    if as_json:
        values = as_values(report) | {"tests": course_as_values(course)}
        if scenarios:
            values["scenarios"] = as_values(scenarios)
        if course.advice is not None:
            values["advice"] = as_values(course.advice)
        click.echo(json.dumps(values, indent=2))
    else:
        calibration_id = course.calibration.calibration_id
        click.echo(f"calibration {calibration_id} ({course.options.calibration_source})")
        hours = f"{report.flight_hours:.6g}" if report.flight_hours >= 0.0 else "unknown"
        click.echo(
            f"{report.actuator_id} ({report.serial_number}): {len(course.outlooks)} valid of "
            f"{tests}, service hours {hours}, cycles {report.cycles}"
        )
        click.echo(report.removal)
        if words := advice_text(course):
            click.echo(words)
        if (latest := latest_comparison(course)) is not None:
            comparison, ended = latest
            click.echo(f"record that ended at {ended}:\n{table_text(comparison)}")
        Console().print(table_of_growth(report, are_records=latest is not None))
        click.echo("\n".join(summary(course, report)))
        if scenarios:
            Console().print(table_of_scenarios(scenarios))
    if output is not None:
        # After the results are printed: a full disk affects only the picture.
        save_picture(draw_course(course), output)
        if not as_json:
            click.echo(f"{output}")
    if course.now.finding or is_unjudged(course):
        sys.exit(REFUSED)
