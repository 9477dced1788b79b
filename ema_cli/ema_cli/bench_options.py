"""Options that describe an actuator on its test bench, the same for every command that has them."""

from dataclasses import replace
from pathlib import Path
from typing import Final

import click
from click.decorators import FC

from ema_cli.errors import Assignments
from ema_core.acquisition import CURRENT_SAMPLINGS, Acquisition
from ema_core.description import ActuatorDescription
from ema_ros.actuator_file import load_description

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
    help="step, ramp, sine, chirp, swing (a chirp that begins and ends at rest), moves (random "
    "smooth moves with dwells, as in ordinary motion), a CSV file with one angle [rad] a sample in "
    "its last column, or a YAML file of `ema design`.",
)
figures_option: Final = click.option(
    "--command-set",
    "figures",
    type=Assignments(),
    multiple=True,
    help="Figures of the command: amplitude [rad], duration [s], start_time [s], rate [rad/s], "
    "start_frequency, end_frequency [Hz], final_fraction [-], seed.",
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
sample_rate_option: Final = click.option(
    "--sample-rate",
    type=click.FloatRange(100.0, 1e6),
    help="Samples per second of the telemetry, in place of the description's sample_period [Hz].",
)
calibration_option: Final = click.option(
    "--calibration",
    "calibration_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Calibration of the unit: the simulated actuator deviates and scatters as it does.",
)


def acquisition_options(command: FC) -> FC:
    """Add the options of how telemetry is acquired, in place of what the description says."""
    for option in (
        click.option("--no-speed", is_flag=True, help="The speed is not measured."),
        click.option(
            "--current-filter",
            type=float,
            metavar="S",
            help="Time constant of the filter of a filtered current [s].",
        ),
        click.option(
            "--sample-current",
            type=click.Choice(CURRENT_SAMPLINGS),
            help="What a sample of the current stands for: its mean over the sample, its value at "
            "the end behind a filter, that value itself, or nothing: it is not measured. By "
            "default as the description says, as a rule its mean.",
        ),
    ):
        command = option(command)
    return command


def acquisition_words(
    sample_rate: float | None,
    sample_current: str | None,
    current_filter: float | None,
    no_speed: bool,
) -> str:
    """Return options of rate and acquisition as they are typed, each after a space."""
    given = {
        "--sample-rate": sample_rate,
        "--sample-current": sample_current,
        "--current-filter": current_filter,
    }
    words = [f" {name} {value}" for name, value in given.items() if value is not None]
    return "".join(words) + (" --no-speed" if no_speed else "")


def described(
    actuator_file: Path | None,
    sample_rate: float | None,
    sample_current: str | None = None,
    current_filter: float | None = None,
    no_speed: bool = False,
) -> ActuatorDescription:
    """Return the description of the actuator, sampled as is asked for.

    What its parameters contradict each other in is printed.

    Parameters
    ----------
    actuator_file
        The built-in actuator when None.
    sample_rate
        In place of that of the description [Hz]; that of the description when None.
    sample_current, current_filter, no_speed
        In place of the description's acquisition.

    Raises
    ------
    ValueError
        When the file is no description, the period no whole number of microseconds, or the
        acquisition impossible.
    """
    description = load_description(actuator_file) if actuator_file else ActuatorDescription()
    for remark in description.remarks:
        click.echo(f"remark: {remark}", err=True)
    given = description.acquisition
    sampling = sample_current or ("filtered" if current_filter else given.current)
    filter_s = given.current_filter if current_filter is None else current_filter
    if sampling != "filtered" and current_filter is None:
        filter_s = 0.0
    acquisition = Acquisition(sampling, filter_s, given.speed and not no_speed)
    description = replace(description, acquisition=acquisition)
    if sample_rate is None:
        return description
    sample_period = round(1e6 / sample_rate) * 1e-6
    if abs(sample_period * sample_rate - 1.0) > 1e-6:
        raise ValueError(
            f"--sample-rate {sample_rate:g} Hz: the period must be a whole number of microseconds"
        )
    return replace(description, sample_period=sample_period)
