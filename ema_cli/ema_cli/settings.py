"""Options that say how to identify, shared by the commands that do."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ema_monitor.calibration import Calibration
from ema_monitor.fitness import WEIGHTS
from ema_monitor.identification import Settings
from ema_monitor.optimizers import ALGORITHMS, DEFAULT_ALGORITHM
from ema_monitor.optimizers.driver import Termination

_OPTIONS = (
    click.option(
        "--algorithm",
        default=DEFAULT_ALGORITHM,
        show_default=True,
        type=click.Choice(list(ALGORITHMS)),
    ),
    click.option(
        "--fitness",
        default="total_least_squares",
        show_default=True,
        type=click.Choice(list(WEIGHTS)),
    ),
    click.option(
        "--budget",
        default=Termination.budget,
        show_default=True,
        type=click.IntRange(1),
        help="Largest number of model evaluations a window.",
    ),
    click.option(
        "--seed", default=0, show_default=True, type=click.IntRange(0), help="Of the algorithm."
    ),
    click.option(
        "--calibration",
        "calibration_file",
        type=click.Path(path_type=Path, dir_okay=False),
        help="File made by `ema calibrate`; without it that of the built-in actuator.",
    ),
    click.option("--actuator-id", help="Which actuator, if the bag holds several."),
    click.option(
        "--force", is_flag=True, help="Estimate even if the calibration does not fit, and say so."
    ),
)


def identification_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def settings_from(algorithm: str, fitness: str, budget: int, seed: int) -> Settings:
    """Return the settings that the options say."""
    return Settings(algorithm, fitness, Termination(budget), seed)


def calibration_from(path: Path | None) -> Calibration:
    """Return the calibration of a file, or the shipped one."""
    return Calibration.load(path) if path else Calibration.builtin()
