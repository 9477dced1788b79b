"""The command that the command line names: a shape, or a CSV file of samples."""

import csv
from dataclasses import fields
from pathlib import Path
from typing import Any

from ema_core.commands import COMMAND_SHAPES, Command
from ema_core.wording import unknown_name

_FIGURES = [item.name for item in fields(Command) if item.name not in ("shape", "samples")]


def command_from(shape: str, figures: dict[str, float]) -> Command:
    """Return the command of a shape with its figures.

    Parameters
    ----------
    shape
        "step", "ramp", "sine", "chirp", "moves" or the path of a CSV file whose last column holds
        one angle [rad] a sample; a first line that is no number is taken for a heading.
    figures
        Figures of the shape by name. A step goes to 1 rad, a sine has 2 Hz and moves last 10 s
        unless they say otherwise.

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
    if shape.endswith(".csv"):
        if figures:
            raise ValueError(f"a command from a file takes no figures, but {next(iter(figures))}")
        return Command("custom", samples=_column(Path(shape)))
    if shape not in COMMAND_SHAPES or shape == "custom":
        shapes = ", ".join(name for name in COMMAND_SHAPES if name != "custom")
        raise ValueError(f"command {shape!r} is neither one of {shapes} nor a .csv file")
    own: dict[str, dict[str, Any]] = {
        "step": {"amplitude": 1.0},
        "ramp": {"amplitude": 0.05},
        "sine": {"start_frequency": 2.0},
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
