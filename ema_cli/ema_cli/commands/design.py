# SPDX-License-Identifier: Apache-2.0
"""``ema design``: find the shortest test command that reaches target standard deviations."""

import json
import sys
from dataclasses import asdict
from pathlib import Path

import click

from ema_cli.options import REFUSED, Assignments, assignments_option, values_of_options
from ema_cli.output import output_option, require_free
from ema_cli.parameters import settings_options
from ema_cli.processes.stop_request import deferred_signals
from ema_cli.progress import progress_bar
from ema_cli.rig_settings import RigSettings, save_command
from ema_cli.simulated_rig import SimulatedRig
from ema_core.faults import COMPONENTS
from ema_monitor.design.certificate import certify
from ema_monitor.design.designing import Design, design_command
from ema_monitor.design.limits import UNITS, MotionLimits

_DEFAULT_LIMIT = "by default 90 % of the actuator's limit"


class WantedSigmas(Assignments):
    """Option type: ``name=value`` pairs, or one value for all faults."""

    name = "sigma"

    def convert(self, value, param, ctx):
        """Return the standard deviations, keyed by fault."""
        if isinstance(value, str) and "=" not in value:
            value = ",".join(f"{name}={value}" for name in COMPONENTS)
        return super().convert(value, param, ctx)


@click.command()
@settings_options(RigSettings, "actuator")
@click.option(
    "--travel",
    required=True,
    type=float,
    help="Largest travel of the user shaft, from end to end [rad].",
)
@click.option("--torque", type=float, help=f"Largest motor torque; {_DEFAULT_LIMIT} [N.m].")
@click.option("--current", type=float, help=f"Largest current; {_DEFAULT_LIMIT} [A].")
@click.option(
    "--speed", type=float, help=f"Largest speed of the motor shaft; {_DEFAULT_LIMIT} [rad/s]."
)
@click.option("--longest", default=0.5, help="Longest duration of the command [s].")
@assignments_option(
    "--sigma",
    "wanted",
    "Target standard deviation of all faults (0.01) or of some (friction=0.005,gain=0.002); by "
    "default the standard deviations reached by the thesis's chirp.",
    WantedSigmas(),
)
@click.option("--json", "as_json", is_flag=True, help="Print one object.")
@output_option(
    "YAML file to write, with parameters of actuator and monitor for --params", dir_okay=False
)
def design(
    options: RigSettings,
    travel: float,
    torque: float | None,
    current: float | None,
    speed: float | None,
    longest: float,
    wanted: dict[str, float],
    as_json: bool,
    overwrite: bool,
    output: Path,
) -> None:
    """Find the shortest test command that reaches a target accuracy within limits.

    Limits of torque, current and speed apply to the model of the actuator, healthy and with faults,
    without the ripple of the inverter. Exit code 3: the targets cannot be reached, and no file is
    written.
    """
    with progress_bar() as progress, deferred_signals() as stop:
        inputs = filter(None, [options.actuator_file])
        require_free(output, inputs, overwrite=overwrite, endings=(".yaml", ".yml"))
        description = options.description
        with values_of_options():
            limits = MotionLimits.within(
                description.parameters,
                travel=travel,
                torque=torque,
                current=current,
                speed=speed,
                longest=longest,
            )
        task = progress.add_task("designing", total=None)

        def follow() -> None:
            if stop:
                raise click.Abort

        def report(state: str) -> None:
            follow()
            progress.update(task, state=state)

        rig = SimulatedRig(options, follow)
        result = design_command(rig, description, limits, wanted or None, on_progress=report)
        report("evaluating hidden causes")
        certificate = certify(rig, result.command, description, rehearsed=result.rehearsed)
        if result.reached:
            sigmas = ", ".join(f"{name} {sigma:.4f}" for name, sigma in result.sigma.items())
            heading = "Test command of `ema design`. Expected standard deviations:"
            save_command(output, result.command, f"{heading}\n{sigmas}")
    if as_json:
        click.echo(json.dumps(_record(result) | {"certificate": certificate.record()}, indent=2))
    else:
        click.echo(str(certificate))
        click.echo(_design_text(result))
        if result.reached:
            click.echo(_next_steps(output, options))
    if not result.reached:
        if not as_json:
            click.echo(f"not written: {output}", err=True)
        sys.exit(REFUSED)


def _record(result: Design) -> dict:
    figures = ("shape", "amplitude", "duration", "start_frequency", "end_frequency")
    command = {name: getattr(result.command, name) for name in (*figures, "final_fraction")}
    return {
        "reached": result.reached,
        "verdict": result.verdict,
        "command": command,
        "wanted": dict(result.wanted),
        "limits": asdict(result.limits),
        "demands": asdict(result.demands),
        "binding": result.binding,
    }


def _design_text(result: Design) -> str:
    command = result.command
    demands = ", ".join(
        f"{name} {demand:.4g} of {getattr(result.limits, name):.4g} {UNITS[name]}"
        for name, demand in asdict(result.demands).items()
        if name != "longest"
    )
    chirp = f", the chirp takes {result.reference_s:g} s" if result.reference_s else ""
    return (
        f"swing of {1e3 * command.amplitude:.3g} mrad to {command.final_fraction:.3g} of it, "
        f"{command.start_frequency:.3g} to {command.end_frequency:.3g} Hz, "
        f"{command.duration:.4g} s{chirp}: {result.verdict}\n"
        f"Required: {demands}"
    )


def _next_steps(output: Path, options: RigSettings) -> str:
    file, rate = options.actuator_file, options.sample_rate
    actuator = f" --actuator {file}" if file else ""
    actuator += f" --sample-rate {rate:g}" if rate else ""
    steps = [
        f"{output}: next",
        f"  ema simulate --params {output}{actuator} --cycles 12 -o healthy.mcap",
        f"  ema calibrate healthy.mcap --params {output} -o calibration.yaml",
        f"  ema estimate case.mcap --params {output} --calibration calibration.yaml",
    ]
    # Nodes read the sample rate only from the actuator file.
    if not rate:
        file_option = f" -p actuator_file:={file}" if file else ""
        steps.append(
            f"  ema up --params {output}{file_option} -p calibration_file:=calibration.yaml"
        )
    return "\n".join(steps)
