"""Options that say what of a bag to look at, shared by the commands that read bags."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import click

from ema_cli.gathered_options import Command, gathered
from ema_monitor.model.measured import GRAMMAR, describe_measurable
from ema_monitor.model.measurements import MAX_AGE_S
from ema_monitor.windows.trigger import ANY_MOTION, TEST_CYCLE, TriggerSettings

USE_OPTIONS: Final = (
    "Use --actuator and --calibration even against the description in the bag, and say so."
)
"""Help of ``--accept-defects`` where a bag is identified."""

_DEFAULTS = TriggerSettings()
_REST = (
    click.option(
        "--threshold",
        default=_DEFAULTS.threshold,
        help="Change of the command that counts as motion; above its noise [rad].",
    ),
    click.option(
        "--rest",
        "rest_s",
        default=_DEFAULTS.rest_s,
        help="How long the command rests before a window [s].",
    ),
)
_LENGTH = click.option(
    "--window-s",
    default=_DEFAULTS.window_s,
    help="Length of a window, that of the test command [s].",
)
_MAX_AGE = click.option(
    "--measured-max-age",
    "measured_max_age_s",
    default=MAX_AGE_S,
    type=click.FloatRange(0.0),
    help="Age at the start of a window up to which a measurement in the bag holds for it [s].",
)
WINDOW_OPTIONS: Final = (*_REST, _LENGTH, _MAX_AGE)
"""Which windows of test cycles are looked at, and which measurements hold for them."""

REPLACE_OPTION: Final = click.option(
    "--replace", "overwrite", is_flag=True, help="Replace OUTPUT if it is there."
)
"""Of the commands that write what they make of a bag."""

CONDITION_OPTION: Final = click.option(
    "--condition",
    default="",
    help='What has to be alike and telemetry does not tell, such as a load: "20 kg".',
)
"""Of the commands that compare a test with a unit's own normal."""

_OPTIONS = (
    click.option("--actuator-id", help="Which actuator, if the bag holds several."),
    click.option(
        "--actuator",
        "actuator_file",
        type=click.Path(path_type=Path, dir_okay=False),
        help="YAML file that describes the actuator, for a bag without a description of it.",
    ),
    click.option("--topic", help="Topic of the telemetry, if there are several."),
    *_REST,
    click.option(
        "--any-motion",
        is_flag=True,
        help="Windows are stretches of ordinary motion and not test cycles.",
    ),
    _LENGTH,
)
_MEASURED = (
    click.option(
        "--measured",
        multiple=True,
        metavar=GRAMMAR,
        help="A hidden cause that was measured, with its standard deviation, e.g. "
        "load_torque=0.1:0.005, instead of what the bag holds of it; may be repeated; known, with "
        f"unit: {describe_measurable()}.",
    ),
    _MAX_AGE,
)


@dataclass(frozen=True)
class SourceOptions:
    """What the options say.

    Attributes
    ----------
    accept_defects
        Whether the options hold even against the bag: the description in ``actuator_file`` is used
        for a bag that has one too, and a calibration that does not fit it.
    any_motion
        Whether windows are stretches of ordinary motion.
    measured
        Hidden causes that were measured, as texts, for all windows.
    measured_max_age_s
        Age up to which a measurement in the bag holds for a window [s].
    """

    actuator_id: str | None
    topic: str | None
    threshold: float
    rest_s: float
    actuator_file: Path | None = None
    accept_defects: bool = False
    any_motion: bool = False
    window_s: float = _DEFAULTS.window_s
    measured: tuple[str, ...] = ()
    measured_max_age_s: float = MAX_AGE_S

    def trigger_settings(self) -> TriggerSettings:
        """Return the settings of the window trigger.

        Raises
        ------
        ValueError
            When a figure is not positive.
        """
        windows = ANY_MOTION if self.any_motion else TEST_CYCLE
        return TriggerSettings(windows, self.window_s, self.rest_s, self.threshold)


def source_options(
    accepts: str = "Use --actuator even against the description in the bag.",
    *,
    identifies: bool = False,
) -> Callable[[Command], Command]:
    """Return a decorator that gives a command the options; it gets them as one, ``source``.

    Parameters
    ----------
    accepts
        Help of ``--accept-defects``, for a command where it means more.
    identifies
        Whether the command identifies windows, so that it matters what was measured.
    """
    measured = _MEASURED if identifies else ()
    offered = (*_OPTIONS, *measured, click.option("--accept-defects", is_flag=True, help=accepts))
    return gathered("source", SourceOptions, SourceOptions.__annotations__, offered)
