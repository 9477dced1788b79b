"""Options that say what an archive is computed with; those that are not given stay as they were."""

from dataclasses import dataclass, fields, replace
from typing import Any

import click
from click.core import ParameterSource

from ema_archive.settings import ArchiveSettings
from ema_cli.bags.source_options import WINDOW_OPTIONS
from ema_cli.errors import merged
from ema_cli.gathered_options import gathered
from ema_cli.identification_options import SEARCH_OPTIONS
from ema_cli.prognosis_options import GROWTH_OPTIONS, with_laws, with_limits
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.prognosis.growth.settings import KnownLaw
from ema_monitor.prognosis.service import Service
from ema_monitor.windows.trigger import TriggerSettings

_CALIBRATION = click.option(
    "--calibration",
    default="",
    metavar="PATTERN",
    help="Path of the units' calibrations, in which {actuator_id} and {serial_number} stand for "
    "those of a unit; without it calibration.yaml beside the bags, or else the shipped one.",
)


@dataclass(frozen=True)
class GivenSettings:
    """Settings of an archive that were given, by the names of the options' arguments."""

    values: dict[str, Any]

    def applied_to(self, settings: ArchiveSettings) -> ArchiveSettings:
        """Return settings with those that were given.

        Raises
        ------
        ValueError
            When one is unknown or out of its range.
        """
        given = dict(self.values)
        prognosis = settings.prognosis
        prognosis = with_limits(prognosis, merged(given.pop("limits", ()), "--limit"))
        laws: tuple[tuple[str, KnownLaw], ...] = given.pop("laws", ())
        prognosis = with_laws(prognosis, laws)

        def taken(kind: Any) -> dict[str, Any]:
            return {item.name: given.pop(item.name) for item in fields(kind) if item.name in given}

        return replace(
            settings,
            trigger=replace(settings.trigger, **taken(TriggerSettings)),
            search=replace(settings.search, **taken(SearchSettings)),
            prognosis=replace(prognosis, service=replace(prognosis.service, **taken(Service))),
            # What is left are those of the archive itself.
            **given,
        )


def _build(**values: Any) -> GivenSettings:
    context = click.get_current_context()
    given = (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)
    return GivenSettings(
        {
            name: value
            for name, value in values.items()
            if context.get_parameter_source(name) in given
        }
    )


_NAMES = (
    "calibration",
    "measured_max_age_s",
    *(item.name for item in fields(TriggerSettings)),
    *(item.name for item in fields(SearchSettings)),
    *(item.name for item in fields(Service)),
    "limits",
    "laws",
)

settings_options = gathered(
    "given", _build, _NAMES, (_CALIBRATION, *WINDOW_OPTIONS, *SEARCH_OPTIONS, *GROWTH_OPTIONS)
)
"""Gives a command the options as ``given``."""
