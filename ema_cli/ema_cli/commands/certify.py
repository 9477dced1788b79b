"""``ema certify``: what a test will show, before any is made."""

import json
import sys

import click

from ema_cli.bench_options import (
    acquisition_options,
    actuator_option,
    calibration_option,
    command_option,
    current_noise_option,
    described,
    figures_option,
    resolutions_option,
    sample_rate_option,
    true_values_option,
)
from ema_cli.command_file import command_from
from ema_cli.errors import REFUSED, Assignments, merged, one_clear_line
from ema_cli.processes.stop_request import deferred_signals
from ema_cli.rehearsal import Rehearsal
from ema_cli.show.progress import progress_bar
from ema_core.faults import COMPONENTS
from ema_core.wording import as_identifier, unknown_name
from ema_monitor.design.certificate import CERTIFIED_WINDOWS
from ema_monitor.design.certificate import certify as certify_test


@click.command()
@actuator_option
@command_option
@figures_option
@sample_rate_option
@acquisition_options
@current_noise_option
@resolutions_option
@true_values_option
@calibration_option
@click.option(
    "--monte-carlo",
    "repetitions",
    default=0,
    type=click.IntRange(0, 100_000),
    help="Simulate and identify so many tests with several faults each, and print what they give "
    "beside what was predicted.",
)
@click.option(
    "--require",
    "required",
    type=Assignments(as_identifier),
    multiple=True,
    help="Largest sigma of a fault, e.g. friction=0.01; exit code 3 where it is not reached.",
)
@click.option("--seed", default=0, type=click.IntRange(0), help="Of all noise.")
@click.option("--json", "as_json", is_flag=True, help="Print one object.")
def certify(
    actuator_file,
    shape,
    figures,
    sample_rate,
    sample_current,
    current_filter,
    no_speed,
    current_noise,
    resolutions,
    true_values,
    calibration_file,
    repetitions,
    required,
    seed,
    as_json,
) -> None:
    """Tell which faults a test will show, how well, and what it cannot tell apart.

    No telemetry is needed: tests of the described actuator are simulated with the given sensors,
    and their estimates judged. A fault is judged half-way to its limit, alone and among others.
    """
    with one_clear_line(), progress_bar() as progress, deferred_signals() as stop:
        wanted = merged(required, "--require")
        for name, sigma in wanted.items():
            if name not in COMPONENTS:
                raise ValueError(unknown_name("fault", name, COMPONENTS))
            if not sigma > 0.0:
                raise ValueError(f"--require: {name} = {sigma:g}: expected more than 0")
        description = described(
            actuator_file, sample_rate, sample_current, current_filter, no_speed
        )
        command = command_from(shape, merged(figures, "--command-set"))
        if warning := command.travel_warning(description.parameters):
            click.echo(f"warning: {warning}", err=True)
        task = progress.add_task("rehearsing", total=CERTIFIED_WINDOWS + repetitions)

        def follow() -> None:
            if stop:
                raise click.Abort
            progress.advance(task)

        record = Rehearsal.of_unit(
            description,
            merged(true_values, "--set"),
            current_noise,
            merged(resolutions, "--quantise"),
            seed,
            follow,
            calibration_file,
            command,
        )
        certificate = certify_test(record, command, description, repetitions=repetitions)
    unmet = certificate.unmet(wanted)
    if as_json:
        click.echo(json.dumps(certificate.record() | {"unmet": unmet}, indent=2))
    else:
        click.echo(str(certificate))
        for words in unmet:
            click.echo(f"required and not reached: {words}")
    if unmet:
        sys.exit(REFUSED)
