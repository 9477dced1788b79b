"""Options that say what of a bag to look at, shared by the commands that read bags."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, Final

import click

from ema_monitor.windows.trigger import TriggerSettings

USE_OPTIONS: Final = (
    "Use --actuator and --calibration even against the description in the bag, and say so."
)
"""Help of ``--force`` where a bag is identified."""

_DEFAULTS = TriggerSettings()
_OPTIONS = (
    click.option("--actuator-id", help="Which actuator, if the bag holds several."),
    click.option(
        "--actuator",
        "actuator_file",
        type=click.Path(path_type=Path, dir_okay=False),
        help="YAML file that describes the actuator, for a bag without a description of it.",
    ),
    click.option("--topic", help="Topic of the telemetry, if there are several."),
    click.option(
        "--threshold",
        default=_DEFAULTS.threshold,
        show_default=True,
        help="Change of the command that counts as motion; above its noise [rad].",
    ),
    click.option(
        "--rest",
        "rest_s",
        default=_DEFAULTS.rest_s,
        show_default=True,
        help="How long the command rests before a window [s].",
    ),
)


@dataclass(frozen=True)
class Source:
    """What the options say.

    Attributes
    ----------
    actuator_id, topic
        Which actuator and which topic; None where there is no choice.
    threshold
        Change of the command that counts as motion [rad].
    rest_s
        How long the command rests before a window [s].
    actuator_file
        Description for a bag that holds none.
    force
        Whether the options hold even against the bag: the description in ``actuator_file`` is used
        for a bag that has one too, and a calibration that does not fit it.
    """

    actuator_id: str | None
    topic: str | None
    threshold: float
    rest_s: float
    actuator_file: Path | None = None
    force: bool = False

    def trigger_settings(self) -> TriggerSettings:
        """Return the settings of the window trigger.

        Raises
        ------
        ValueError
            When a figure is not positive.
        """
        return TriggerSettings(rest_s=self.rest_s, threshold=self.threshold)


def source_options(
    force: str = "Use --actuator even against the description in the bag.",
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that gives a command the options; it gets them as one, ``source``.

    Parameters
    ----------
    force
        Help of ``--force``, for a command where it means more.
    """
    offered = (*_OPTIONS, click.option("--force", is_flag=True, help=force))

    def add_options(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def with_options(
            *,
            actuator_id: str | None,
            topic: str | None,
            threshold: float,
            rest_s: float,
            actuator_file: Path | None,
            force: bool,
            **others: Any,
        ) -> None:
            source = Source(actuator_id, topic, threshold, rest_s, actuator_file, force)
            command(source=source, **others)

        for option in reversed(offered):
            with_options = option(with_options)
        return with_options

    return add_options
