"""Options of a prognosis, shared by the commands that make one."""

import math
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import click

from ema_cli.errors import Assignments, merged
from ema_cli.gathered_options import gathered
from ema_core.wording import as_identifier, unknown_name
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.advisory import Costs
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.duty.scenario import Scenario, read_scenarios
from ema_monitor.prognosis.fleet import Fleet
from ema_monitor.prognosis.growth.settings import FORM as FORM_OF_LAW
from ema_monitor.prognosis.growth.settings import KnownLaw, known_law
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings

FORM: Final = f"FAULT={FORM_OF_LAW}"


class KnownLawType(click.ParamType):
    """``fault=law``, with the median rate and the second figure of the law where they are known."""

    name = FORM

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[str, KnownLaw]:
        """Return fault and law."""
        if not isinstance(value, str):
            return value
        fault, _, law = value.partition("=")
        fault = as_identifier(fault)
        try:
            return fault, known_law(fault, law)
        except ValueError as error:
            self.fail(f"{value!r}: {error}", param, ctx)


def _finite(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value:g} is not a number of hours", ctx, param)
    return value


GROWTH_OPTIONS: Final = (
    click.option(
        "--hours-per-cycle",
        default=Service.hours_per_cycle,
        help="Flight hours that a test cycle stands for, whatever usage the bags hold; 0: usage "
        "counts them.",
    ),
    click.option(
        "--duty",
        default=Service.duty,
        help="Growth of the faults in a future flight hour, relative to a past one.",
    ),
    click.option(
        "--removal-risk",
        default=Service.removal_risk,
        help="Probability of a failure before the removal that is accepted.",
    ),
    click.option(
        "--known-law",
        "laws",
        type=KnownLawType(),
        multiple=True,
        help=f"A law that is known, {FORM}, e.g. friction=exponential; those not named are "
        "averaged over all laws.",
    ),
    click.option(
        "--limit",
        "limits",
        type=Assignments(as_identifier),
        multiple=True,
        help="Where life ends, e.g. friction=0.4 or bandwidth=15; as the monitor's parameters "
        "limits.NAME and requirements.NAME.",
    ),
)
"""What health and life rest on, beside the tests."""


def _prior_or_archive(
    context: click.Context, parameter: click.Parameter, path: Path | None
) -> Path | None:
    """Return the path of a file; `ema report` takes the folder of an archive as well."""
    if path is not None and path.is_dir() and context.command.name != "report":
        raise click.BadParameter(f"{path} is a folder", context, parameter)
    return path


_OPTIONS = (
    *GROWTH_OPTIONS,
    click.option(
        "--fleet",
        "fleet_file",
        type=click.Path(path_type=Path, exists=True),
        callback=_prior_or_archive,
        help="How other units of the model grew, a file of `ema learn`.",
    ),
    click.option(
        "--scenarios",
        "scenario_file",
        type=click.Path(path_type=Path, exists=True, dir_okay=False),
        help="Future duties under which to predict the life too, a YAML file.",
    ),
    click.option(
        "--growth-per",
        type=click.Choice(["damage", "hours"]),
        default=DamageSettings.growth_per,
        help="What growth is counted by, where the duty that was flown is known.",
    ),
    click.option(
        "--damage",
        "damages",
        type=Assignments(as_identifier),
        multiple=True,
        help="How duty does damage, e.g. wear_exponent=3,activation_energy=0.8; as the monitor's "
        "parameters damage.NAME.",
    ),
    click.option(
        "--end-hours",
        type=click.FloatRange(min=0.0),
        callback=_finite,
        help="Service hour at which a fault truly reached its limit, for the picture, where life "
        "goes on beyond the bags.",
    ),
    click.option(
        "--at",
        "at_hours",
        type=click.FloatRange(min=0.0),
        callback=_finite,
        help="Service hour at which the prognosis is made: later tests are left out.",
    ),
    click.option(
        "--cost",
        "costs",
        type=Assignments(as_identifier),
        multiple=True,
        help="What an advice rests on, e.g. removal=2000,failure=50000,lead_time=20; "
        "as the monitor's parameters costs.NAME. Without costs no advice is given.",
    ),
    click.option("--cost-unit", default="", help="Unit of the costs, in words."),
)


@dataclass(frozen=True)
class PrognosisOptions:
    """What the options say.

    Attributes
    ----------
    costs
        What an advice rests on; None when none are given.
    end_hours
        Service hour at which a fault truly reached its limit, if that is after the bags [h].
    at_hours
        Service hour at which the prognosis is made [h]; after the last test when None.
    archive
        Folder of an archive that was given as the fleet; None when none was.
    scenarios
        Future duties under which the life is predicted, too.
    """

    settings: PrognosisSettings
    costs: Costs | None
    end_hours: float | None
    at_hours: float | None
    archive: Path | None = None
    scenarios: tuple[Scenario, ...] = ()


def _build(
    *,
    limits: tuple[list[tuple[str, float]], ...],
    laws: tuple[tuple[str, KnownLaw], ...],
    fleet_file: Path | None,
    scenario_file: Path | None,
    growth_per: str,
    damages: tuple[list[tuple[str, float]], ...],
    duty: float,
    hours_per_cycle: float,
    removal_risk: float,
    end_hours: float | None,
    at_hours: float | None,
    costs: tuple[list[tuple[str, float]], ...],
    cost_unit: str,
) -> PrognosisOptions:
    settings = _settings(
        merged(limits, "--limit"), laws, Service(duty, hours_per_cycle, removal_risk)
    )
    archive = fleet_file if fleet_file is not None and fleet_file.is_dir() else None
    if fleet_file is not None and archive is None:
        settings = replace(settings, fleet=Fleet.read(fleet_file))
    settings = replace(settings, damage=_damage(growth_per, merged(damages, "--damage")))
    return PrognosisOptions(
        settings,
        _costs(merged(costs, "--cost"), cost_unit),
        end_hours,
        at_hours,
        archive,
        read_scenarios(scenario_file) if scenario_file is not None else (),
    )


def _damage(growth_per: str, given: dict[str, float]) -> DamageSettings:
    """Return how duty does damage; ValueError for an unknown name or a value out of its range."""
    known = [item.name for item in fields(DamageSettings) if item.name != "growth_per"]
    for name in given:
        if name not in known:
            raise ValueError(f"--damage: {unknown_name('figure', name, known)}")
    return DamageSettings(growth_per, **given)


def _costs(given: dict[str, float], unit: str) -> Costs | None:
    """Return the costs; None when none are given.

    Raises
    ------
    ValueError
        When one is unknown or out of its range.
    """
    known = [item.name for item in fields(Costs) if item.name != "unit"]
    for name in given:
        if name not in known:
            raise ValueError(f"--cost: {unknown_name('cost', name, known)}")
    return Costs(**given, unit=unit) if given else None


def _settings(
    limits: dict[str, float], laws: tuple[tuple[str, KnownLaw], ...], service: Service
) -> PrognosisSettings:
    """Return what the options say.

    Raises
    ------
    ValueError
        When a limit is unknown or out of its range, or a fault has two laws.
    """
    return with_laws(with_limits(PrognosisSettings(service=service), limits), laws)


def with_limits(settings: PrognosisSettings, limits: dict[str, float]) -> PrognosisSettings:
    """Return settings with other limits of faults and requirements, those that are named.

    Raises
    ------
    ValueError
        When a limit is unknown or out of its range.
    """
    of_faults, of_requirements = (
        [item.name for item in fields(kind)] for kind in (HealthLimits, RequirementLimits)
    )
    for name in limits:
        if name not in (*of_faults, *of_requirements):
            known = (*of_faults, *of_requirements)
            raise ValueError(f"--limit: {unknown_name('limit', name, known)}")
    given = limits.items()
    return replace(
        settings,
        limits=replace(settings.limits, **{n: v for n, v in given if n in of_faults}),
        requirements=replace(
            settings.requirements, **{n: v for n, v in given if n in of_requirements}
        ),
    )


def with_laws(
    settings: PrognosisSettings, laws: tuple[tuple[str, KnownLaw], ...]
) -> PrognosisSettings:
    """Return settings in which the laws of some faults are known, in place of others of them.

    Raises
    ------
    ValueError
        When a fault has two laws.
    """
    if len(dict(laws)) < len(laws):
        raise ValueError("--known-law: a fault has more than one law")
    known = {**settings.tracker.laws, **dict(laws)}
    return replace(settings, tracker=replace(settings.tracker, laws=known))


prognosis_options = gathered(
    "prognosis",
    _build,
    (
        "limits",
        "laws",
        "fleet_file",
        "scenario_file",
        "growth_per",
        "damages",
        "duty",
        "hours_per_cycle",
        "removal_risk",
        "end_hours",
        "at_hours",
        "costs",
        "cost_unit",
    ),
    _OPTIONS,
)
"""Gives a command the options as ``prognosis``."""
