# SPDX-License-Identifier: Apache-2.0
"""``ema certify``: predict the accuracy of a test without telemetry."""

import json
import sys

import click

from ema_cli.options import REFUSED, assignments_option
from ema_cli.parameters import settings_options
from ema_cli.processes.stop_request import deferred_signals
from ema_cli.progress import progress_bar
from ema_cli.rig_settings import COMMAND_OPTION, RigSettings
from ema_cli.simulated_rig import SimulatedRig
from ema_core.faults import COMPONENTS
from ema_core.wording import unknown_name
from ema_monitor.design.certificate import CERTIFIED_WINDOWS
from ema_monitor.design.certificate import certify as certify_test


@click.command()
@settings_options(RigSettings, "actuator", more=[COMMAND_OPTION])
@assignments_option(
    "--require",
    "wanted",
    "Required sigma of a fault, e.g. friction=0.01; exit code 3 if it is not reached.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one object.")
def certify(options: RigSettings, wanted: dict[str, float], as_json: bool) -> None:
    """Predict which faults a test detects, how well, and which it cannot separate.

    No telemetry is needed: the command simulates tests of the described actuator and sensors, and
    evaluates the estimates. A fault is evaluated half-way to its limit, alone and together with
    other faults.
    """
    with progress_bar() as progress, deferred_signals() as stop:
        for name, sigma in wanted.items():
            if name not in COMPONENTS:
                raise click.UsageError(unknown_name("fault", name, COMPONENTS))
            if not sigma > 0.0:
                raise click.UsageError(f"--require: {name} = {sigma:g}: expected more than 0")
        task = progress.add_task("rehearsing", total=CERTIFIED_WINDOWS)

        def follow() -> None:
            if stop:
                raise click.Abort
            progress.advance(task)

        rig = SimulatedRig(options, follow)
        certificate = certify_test(rig, options.command, options.description)
    unmet = certificate.unmet(wanted)
    if as_json:
        click.echo(json.dumps(certificate.record() | {"unmet": unmet}, indent=2))
    else:
        click.echo(str(certificate))
        for words in unmet:
            click.echo(f"required but not reached: {words}")
    if unmet:
        sys.exit(REFUSED)
