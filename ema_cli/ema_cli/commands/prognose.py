"""``ema prognose``: how long a unit will last, from the bags of its tests."""

import json
import math
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Final

import click
from rich.console import Console

from ema_cli.bags.source_options import USE_OPTIONS, Source, source_options
from ema_cli.bags.unit_course import follow
from ema_cli.bags.unit_record import UnitRecord, read_unit, with_calibration_beside
from ema_cli.commands.estimate import estimate_windows
from ema_cli.errors import REFUSED, Assignments, merged, one_clear_line
from ema_cli.figures.files import picture_option, require_drawable, save_picture
from ema_cli.figures.prognosis import draw_course
from ema_cli.identification_options import IdentificationOptions, identification_options
from ema_cli.show.prognosis_table import (
    as_values,
    course_as_values,
    summary,
    table_of_growth,
)
from ema_core.wording import as_identifier, counted, unknown_name
from ema_monitor.health import HealthLimits
from ema_monitor.node.messages import health_to_message
from ema_monitor.prognosis.growth.known_laws import FORM as FORM_OF_LAW
from ema_monitor.prognosis.growth.known_laws import known_law
from ema_monitor.prognosis.growth.settings import KnownLaw, TrackerSettings
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings

FORM: Final = f"FAULT={FORM_OF_LAW}"


class KnownLawType(click.ParamType):
    """``fault=law``, with the median rate and the second figure of the law where they are known."""

    name = FORM

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[str, KnownLaw]:
        """Return fault and law."""
        if not isinstance(value, str):
            return value
        fault, _, law = value.partition("=")
        fault = as_identifier(fault)
        try:
            return fault, known_law(fault, law)
        except ValueError as error:
            self.fail(f"{value!r}: {error}", param, ctx)


def _finite(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value:g} is not a number of hours", ctx, param)
    return value


@click.command()
@click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@source_options(USE_OPTIONS, identifies=True)
@identification_options
@click.option(
    "--hours-per-cycle",
    default=Service.hours_per_cycle,
    help="Flight hours that a test cycle stands for, whatever usage the bags hold; 0: usage "
    "counts them.",
)
@click.option(
    "--duty",
    default=Service.duty,
    help="Growth of the faults in a future flight hour, relative to a past one.",
)
@click.option(
    "--known-law",
    "laws",
    type=KnownLawType(),
    multiple=True,
    help=f"A law that is known, {FORM}, e.g. friction=exponential; those not named are averaged "
    "over all laws.",
)
@click.option(
    "--limit",
    "limits",
    type=Assignments(as_identifier),
    multiple=True,
    help="Where life ends, e.g. friction=0.4 or bandwidth=15; as the monitor's parameters "
    "limits.NAME and requirements.NAME.",
)
@click.option(
    "--end-hours",
    type=click.FloatRange(min=0.0),
    callback=_finite,
    help="Service hour at which a fault truly reached its limit, for the picture, where life goes "
    "on beyond the bags.",
)
@click.option(
    "--at",
    "at_hours",
    type=click.FloatRange(min=0.0),
    callback=_finite,
    help="Service hour at which the prognosis is made: later tests are left out.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one object, as the health message.")
@picture_option()
def prognose(
    bags: tuple[Path, ...],
    source: Source,
    options: IdentificationOptions,
    hours_per_cycle: float,
    duty: float,
    laws: tuple[tuple[str, KnownLaw], ...],
    limits: tuple[list[tuple[str, float]], ...],
    end_hours: float | None,
    at_hours: float | None,
    as_json: bool,
    output: Path | None,
) -> None:
    """Predict how many flight hours a unit has left, from the tests in each BAG or folder of bags.

    All tests are of one unit; the stamps of their windows give their order. The figures are those
    that a monitor publishes after the last of these tests. Without --calibration, a file
    calibration.yaml beside the bags is used as the unit's.

    Exit code 3 means that there is no prognosis, since no test has a valid estimate.
    """
    with one_clear_line():
        settings = _settings(merged(limits, "--limit"), laws, Service(duty, hours_per_cycle))
        if output is not None:
            require_drawable(output)
        record = read_unit(bags, source)
        if at_hours is not None:
            record = _as_known_at(at_hours, record)
        # The bags first: those of two units are refused, whatever lies beside them.
        options = with_calibration_beside(options, bags)
        calibration = options.calibration()
        for remark in record.remarks:
            click.echo(remark, err=True)
        estimates = estimate_windows(
            record.windows,
            calibration,
            options,
            force=source.force,
            any_motion=source.any_motion,
        )
        course = follow(record, estimates, calibration.unit_parameters, settings)
        for number, estimate in enumerate(estimates):
            if not estimate.valid:
                click.echo(f"window {number}: no valid estimate: {estimate.reason}", err=True)
        if not course.outlooks:
            click.echo(
                f"no prognosis: none of {counted(len(estimates), 'window')} can be used", err=True
            )
            sys.exit(REFUSED)
        message = health_to_message(course.outlooks[-1], record.description)
        if math.isnan(message.flight_hours) and not record.counts:
            click.echo(
                "service hours are unknown, so is the remaining life: the bags hold no usage; give "
                "--hours-per-cycle",
                err=True,
            )
    if as_json:
        values = as_values(message) | {"tests": course_as_values(course)}
        click.echo(json.dumps(values, indent=2))
    else:
        click.echo(f"calibration {calibration.calibration_id} ({options.calibration_source})")
        hours = f"{message.flight_hours:.6g}" if message.flight_hours >= 0.0 else "unknown"
        click.echo(
            f"{message.actuator_id} ({message.serial_number}): {len(course.outlooks)} valid of "
            f"{counted(len(estimates), 'test')}, flight hours {hours}, cycles {message.cycles}"
        )
        click.echo(message.removal)
        Console().print(table_of_growth(message))
        click.echo("\n".join(summary(course, message)))
    if output is not None:
        # After the figures: they stand, even if the disk is full.
        with one_clear_line():
            save_picture(draw_course(course, end_hours), output)
        if not as_json:
            click.echo(f"{output}")


def _as_known_at(hours: float, record: UnitRecord) -> UnitRecord:
    """Return what was known of a unit at a service hour [h].

    Raises
    ------
    ValueError
        When there was no test before.
    """
    later = min((one.stamp_ns for one in record.counts if one.hours > hours), default=math.inf)
    windows = [window for window in record.windows if window.end_ns < later]
    if not record.counts or not windows:
        raise ValueError(f"--at {hours:g}: the bags have no test whose count of hours is so small")
    counts = [count for count in record.counts if count.stamp_ns < later]
    return replace(record, windows=windows, counts=counts)


def _settings(
    limits: dict[str, float], laws: tuple[tuple[str, KnownLaw], ...], service: Service
) -> PrognosisSettings:
    """Return what the options say.

    Raises
    ------
    ValueError
        When a limit is unknown or out of its range, or a fault has two laws.
    """
    of_faults, of_requirements = (
        [item.name for item in fields(kind)] for kind in (HealthLimits, RequirementLimits)
    )
    for name in limits:
        if name not in (*of_faults, *of_requirements):
            known = (*of_faults, *of_requirements)
            raise ValueError(f"--limit: {unknown_name('limit', name, known)}")
    if len(dict(laws)) < len(laws):
        raise ValueError("--known-law: a fault has more than one law")
    return PrognosisSettings(
        replace(HealthLimits(), **{n: v for n, v in limits.items() if n in of_faults}),
        replace(RequirementLimits(), **{n: v for n, v in limits.items() if n in of_requirements}),
        TrackerSettings(laws=dict(laws)),
        service,
    )
