"""``ema report``: a unit's verdict, evidence and pictures as one page."""

import shlex
import sys
from pathlib import Path

import click

from ema_archive.fleet import fleet_summary
from ema_cli.bags.output_path import require_free
from ema_cli.bags.predicting import Predicting
from ema_cli.bags.source import REPLACE_OPTION
from ema_cli.bags.unit_course import diagnose_unit
from ema_cli.bags.unit_record import find_bags
from ema_cli.errors import REFUSED, one_clear_line
from ema_cli.main import ARGUMENTS
from ema_cli.parameters import settings_options
from ema_cli.report.page import fleet_page, report_page
from ema_cli.report.verdict import verdict_of
from ema_core.files import complete_file


@click.command()
@click.argument("bags", metavar="BAG...", nargs=-1, type=click.Path(path_type=Path))
@settings_options(Predicting)
@REPLACE_OPTION
@click.option(
    "-o",
    "--output",
    default="report.html",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Page to write (.html).",
)
@click.pass_context
def report(
    context: click.Context,
    bags: tuple[Path, ...],
    given: Predicting,
    overwrite: bool,
    output: Path,
) -> None:
    """Write what the tests in each BAG or folder of bags say of a unit as one page.

    It holds the verdict, what to do, the evidence, pictures, and where all this comes from; it
    needs no other file and no network, and can be printed. All tests are of one unit, as for
    `ema prognose`. Of several bags, one that cannot be read is named in the report.

    Without a BAG, --fleet ARCHIVE names an archive of `ema archive`: the page is then the summary
    of its fleet, with the worst units, models, ages, survival, calibrations and test coverage.

    Exit code 3 means that no test has a valid estimate, or that the newest one shows a failure of
    drive or shaft; the report then says why.
    """
    archive = given.archive
    if (archive is None) == (not bags):
        raise click.UsageError("give one BAG or several, or --fleet ARCHIVE")
    command = shlex.join(context.meta[ARGUMENTS])
    with one_clear_line():
        if output.suffix.lower() not in (".html", ".htm"):
            raise ValueError(f"{output}: a report ends in .html")
        if not output.parent.is_dir():
            raise ValueError(f"{output}: there is no folder {output.parent}")
        if archive is not None:
            require_free(output, [], overwrite=overwrite)
            _write(output, fleet_page(archive, fleet_summary(archive), command))
            click.echo(f"{output}")
            return
        read = [*find_bags(bags), *filter(None, (given.calibration_file, given.actuator_file))]
        require_free(output, read, overwrite=overwrite)
        course = diagnose_unit(bags, given, skips_unreadable=True)
        verdict = verdict_of(course)
        _write(output, report_page(bags, course, verdict, command))
    for line in verdict.lines:
        click.echo(line)
    click.echo(f"{output}")
    if not course.outlooks or course.now.failure:
        sys.exit(REFUSED)


def _write(output: Path, page: str) -> None:
    with complete_file(output) as partial:
        partial.write_text(page, encoding="utf-8")
