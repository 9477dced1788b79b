# SPDX-License-Identifier: Apache-2.0
"""Command options for a simulated actuator on its test bench."""

import csv
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import click
import yaml

from ema_cli.parameters import Command as ClickCommand
from ema_cli.parameters import Parameters
from ema_core.commands import COMMAND_SHAPES, THESIS_CHIRP, Command
from ema_core.description import ActuatorDescription
from ema_core.files import complete_file
from ema_core.parameters import ActuatorParameters
from ema_ros.actuator_file import load_description
from ema_sim.bench import BenchSettings
from ema_sim.settings import FileSettings, ResolutionSettings, RunSettings

_FIGURES: Final = [item.name for item in fields(Command) if item.name not in ("shape", "samples")]
_OWN_FIGURES: Final[dict[str, dict[str, Any]]] = {
    "step": {"amplitude": 1.0},
    "ramp": {"amplitude": 0.05},
    "sine": {"start_frequency": 2.0},
    "swing": {"start_frequency": 10.0, "end_frequency": 14.0},
    "moves": {"duration": 10.0},
}
"""Default parameters of command shapes, where they differ from the chirp's."""

COMMAND_OPTION: Final = click.option(
    "--command",
    "shape",
    help=(
        "step, ramp, sine, chirp (default), swing (a chirp from rest to rest), moves (random "
        "smooth moves with dwells; parameters: command.NAME), or a CSV file with angles [rad] in "
        "its last column."
    ),
)


@dataclass(frozen=True)
class RigSettings:
    """Settings of a simulated actuator on its test bench."""

    OPTIONS: ClassVar[tuple[Callable[[ClickCommand], ClickCommand], ...]] = (
        click.option(
            "--actuator",
            "actuator_file",
            type=click.Path(path_type=Path, dir_okay=False),
            help="Actuator file (YAML); by default the built-in actuator.",
        ),
        click.option(
            "--sample-rate",
            type=click.FloatRange(100.0, 1e6),
            help="Sample rate of the telemetry [Hz]; overrides the actuator file.",
        ),
        click.option(
            "--current-noise",
            type=float,
            help="Standard deviation of the noise on each current sample [A].",
        ),
        click.option("--seed", type=click.IntRange(0), help="Seed of all noise."),
    )
    SECTIONS: ClassVar[tuple[tuple[Any, str], ...]] = (
        (FileSettings, ""),
        (RunSettings, ""),
        (BenchSettings, ""),
        (ActuatorParameters, "plant."),
        (Command, "command."),
        (ResolutionSettings, "resolution."),
    )

    description: ActuatorDescription
    """Description of the actuator, with its nominal parameters."""
    parameters: ActuatorParameters
    """True parameters of the plant."""
    settings: BenchSettings
    resolutions: dict[str, float]
    """Resolution of the published columns, keyed by name; unlisted columns are exact."""
    command: Command
    actuator_file: Path | None
    sample_rate: float | None

    @classmethod
    def of(
        cls, parameters: Parameters, sample_rate: float | None = None, shape: str | None = None
    ) -> Self:
        """Build the bench from options and parameters; print contradictions in the description."""
        run = parameters.over(RunSettings())
        file = parameters.path("actuator_file")
        description = load_description(file, is_simulated=True) if file else ActuatorDescription()
        identity = {name: getattr(run, name) for name in ("actuator_id", "serial_number")}
        description = replace(description, **{k: value for k, value in identity.items() if value})
        for remark in description.remarks:
            click.echo(f"remark: {remark}", err=True)
        if sample_rate is not None:
            sample_period = round(1e6 / sample_rate) * 1e-6
            if abs(sample_period * sample_rate - 1.0) > 1e-6:
                raise click.UsageError(
                    f"--sample-rate {sample_rate:g} Hz: the period must be a whole number of "
                    "microseconds"
                )
            description = replace(description, sample_period=sample_period)
        command = _command(shape, parameters)
        if warning := command.travel_warning(description.parameters):
            click.echo(f"warning: {warning}", err=True)
        return cls(
            description,
            parameters.over(description.parameters, "plant."),
            parameters.over(BenchSettings()),
            parameters.over(ResolutionSettings(), "resolution.").resolutions(),
            command,
            file,
            sample_rate,
        )


def _command(shape: str | None, parameters: Parameters) -> Command:
    """Return the command with a shape (None for the default) and parameters, or from a CSV file."""
    shape = shape or str(parameters.values.get("command.shape", THESIS_CHIRP.shape))
    if shape.endswith(".csv"):
        figures = [name for name in _FIGURES if f"command.{name}" in parameters.values]
        if figures:
            raise click.UsageError(
                f"a command from a file has no parameters: remove command.{figures[0]}"
            )
        return Command("custom", samples=_column(Path(shape)))
    shapes = [name for name in COMMAND_SHAPES if name != "custom"]
    if shape not in shapes:
        raise click.UsageError(
            f"command {shape!r} is neither one of {', '.join(shapes)} nor a .csv file; pass a "
            "file of `ema design` by --params"
        )
    command = Command(shape, **_OWN_FIGURES.get(shape, {}))
    return parameters.with_options(**{"command.shape": shape}).over(command, "command.")


def _column(path: Path) -> list[float]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.reader(file) if row]
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not a CSV file: {error}") from error
    samples = []
    for number, row in enumerate(rows):
        try:
            samples.append(float(row[-1]))
        except ValueError as error:
            # A first row without a number is a heading.
            if number > 0:
                raise ValueError(
                    f"{path}: row {number + 1} ends with {row[-1]!r}, expected an angle [rad]"
                ) from error
    return samples


def save_command(path: Path, command: Command, comment: str) -> None:
    """Write a parameter file with a command for the actuator and its length for the monitor.

    Parameters
    ----------
    path
        YAML file to write.
    command
        Command of any shape except ``custom``.
    comment
        Comment lines on the origin of the command.
    """
    figures = {name: getattr(command, name) for name in ("shape", *_FIGURES)}
    content = {
        "/**/actuator": {"ros__parameters": {"command": figures}},
        "/**/monitor": {"ros__parameters": {"window_s": command.duration}},
    }
    heading = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    with complete_file(path) as partial:
        partial.write_text(heading + yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
