"""Options that describe an actuator on its test bench, the same for every command that has them."""

from pathlib import Path
from typing import Final

import click

from ema_cli.errors import Assignments

actuator_option: Final = click.option(
    "--actuator",
    "actuator_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="YAML file that describes the actuator; without it the built-in one.",
)
command_option: Final = click.option(
    "--command",
    "shape",
    default="chirp",
    help="step, ramp, sine, chirp, or a CSV file with one angle [rad] a sample in its last column.",
)
figures_option: Final = click.option(
    "--command-set",
    "figures",
    type=Assignments(),
    multiple=True,
    help="Figures of the command: amplitude [rad], duration [s], start_time [s], rate [rad/s], "
    "start_frequency, end_frequency [Hz], final_fraction [-].",
)
true_values_option: Final = click.option(
    "--set",
    "true_values",
    type=Assignments(),
    multiple=True,
    help="True parameter of the plant, e.g. R_s=2.24; the description keeps the nominal one.",
)
current_noise_option: Final = click.option(
    "--current-noise",
    default=0.0,
    help="Standard deviation of Gaussian noise on each published current sample [A].",
)
resolutions_option: Final = click.option(
    "--quantise",
    "resolutions",
    type=Assignments(),
    multiple=True,
    help="Resolution of a published column, e.g. current=0.01,position=1e-6 [A, rad, rad/s].",
)
