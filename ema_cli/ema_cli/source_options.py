"""Options that say what of a bag to look at, shared by the commands that read bags."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any

import click

from ema_monitor.trigger import TriggerSettings

_DEFAULTS = TriggerSettings()
_OPTIONS = (
    click.option("--actuator-id", help="Which actuator, if the bag holds several."),
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
    """

    actuator_id: str | None
    topic: str | None
    threshold: float
    rest_s: float

    def trigger_settings(self) -> TriggerSettings:
        """Return the settings of the window trigger.

        Raises
        ------
        ValueError
            When a figure is not positive.
        """
        return TriggerSettings(rest_s=self.rest_s, threshold=self.threshold)


def source_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options; it gets them as one argument, ``source``."""

    @wraps(command)
    def with_options(
        *,
        actuator_id: str | None,
        topic: str | None,
        threshold: float,
        rest_s: float,
        **others: Any,
    ) -> None:
        command(source=Source(actuator_id, topic, threshold, rest_s), **others)

    for option in reversed(_OPTIONS):
        with_options = option(with_options)
    return with_options
