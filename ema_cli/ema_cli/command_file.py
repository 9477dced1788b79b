"""The command that the command line names: a shape, a CSV file of samples, or one designed."""

import csv
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from ema_core.commands import COMMAND_SHAPES, Command
from ema_core.files import complete_file
from ema_core.wording import unknown_name
from ema_core.yaml_file import load_yaml

_ACTUATOR = "/**/actuator"
_MONITOR = "/**/monitor"
_PARAMETERS = "ros__parameters"
_FIGURES = [item.name for item in fields(Command) if item.name not in ("shape", "samples")]


def command_from(shape: str, figures: dict[str, float]) -> Command:
    """Return the command of a shape with its figures.

    Parameters
    ----------
    shape
        "step", "ramp", "sine", "chirp", "moves", "swing", the path of a CSV file whose last column
        holds one angle [rad] a sample (a first line that is no number is taken for a heading), or
        of a YAML file with ROS parameters ``command`` of the actuator, as `save_command` writes it.
    figures
        Figures of the shape by name. A step goes to 1 rad, a sine has 2 Hz, a swing 10 to 14 Hz and
        moves last 10 s unless they say otherwise.

    Raises
    ------
    ValueError
        When the shape or a figure is unknown or impossible, or the file is no such table.
    OSError
        When the file cannot be read.
    """
    for name in figures:
        if name not in _FIGURES:
            raise ValueError(unknown_name("command figure", name, _FIGURES))
    if shape.endswith((".csv", ".yaml", ".yml")):
        if figures:
            raise ValueError(f"a command from a file takes no figures, but {next(iter(figures))}")
        if shape.endswith(".csv"):
            return Command("custom", samples=_column(Path(shape)))
        return _parameters(Path(shape))
    if shape not in COMMAND_SHAPES or shape == "custom":
        shapes = ", ".join(name for name in COMMAND_SHAPES if name != "custom")
        raise ValueError(f"command {shape!r} is neither one of {shapes} nor a .csv or .yaml file")
    own: dict[str, dict[str, Any]] = {
        "step": {"amplitude": 1.0},
        "ramp": {"amplitude": 0.05},
        "sine": {"start_frequency": 2.0},
        "swing": {"start_frequency": 10.0, "end_frequency": 14.0},
        "moves": {"duration": 10.0},
    }
    return Command(shape, **{**own.get(shape, {}), **figures})


def _column(path: Path) -> list[float]:
    try:
        with path.open(newline="") as file:
            rows = [row for row in csv.reader(file) if row]
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not a CSV file: {error}") from error
    samples = []
    for number, row in enumerate(rows):
        try:
            samples.append(float(row[-1]))
        except ValueError as error:
            if number > 0:
                raise ValueError(
                    f"{path}: row {number + 1} ends in {row[-1]!r}, expected an angle [rad]"
                ) from error
    return samples


def save_command(path: Path, command: Command, window_s: float, comment: str) -> None:
    """Write a command as ROS parameters of actuator and monitor.

    Parameters
    ----------
    path
        YAML file to write.
    command
        Any but a custom one.
    window_s
        Length of its windows [s].
    comment
        Lines that say where it comes from.

    Raises
    ------
    OSError
        When it cannot be written.
    """
    figures: dict[str, Any] = {"shape": command.shape}
    figures |= {name: getattr(command, name) for name in _FIGURES}
    content = {
        _ACTUATOR: {_PARAMETERS: {"command": figures}},
        _MONITOR: {_PARAMETERS: {"window_s": window_s}},
    }
    heading = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    with complete_file(path) as partial:
        partial.write_text(heading + yaml.safe_dump(content, sort_keys=False))


def _parameters(path: Path) -> Command:
    try:
        content = load_yaml(path)
    except IsADirectoryError as error:
        raise ValueError(f"{path} is not a YAML file: it is a folder") from error
    try:
        figures = dict(content[_ACTUATOR][_PARAMETERS]["command"])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} has no parameters `command` of {_ACTUATOR}") from error
    for name in figures:
        if name not in ("shape", *_FIGURES):
            raise ValueError(f"{path}: {unknown_name('command figure', name, _FIGURES)}")
    try:
        return Command(**figures)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error
