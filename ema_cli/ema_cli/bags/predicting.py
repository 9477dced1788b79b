# SPDX-License-Identifier: Apache-2.0
"""Command options for the prognosis of a unit, in addition to the identification options."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Final, Self

import click

from ema_cli.bags.identifying import ALGORITHM_OPTION, Identifying
from ema_cli.options import assignments_option
from ema_cli.parameters import Command, Parameters, names_of
from ema_core.wording import as_identifier, unknown_name
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.advice import Costs
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.duty.scenario import Scenario, read_scenarios
from ema_monitor.prognosis.fleet_growth import FleetGrowth
from ema_monitor.prognosis.growth.tracker_settings import FORM, KnownLawTexts, TrackerSettings
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings

FAULT_LIMITS: Final = ((HealthLimits, "limits."),)
LIMITS: Final = (*FAULT_LIMITS, (RequirementLimits, "requirements."))
"""Dataclasses of the parameters that limit faults and performance, with their prefixes."""

PROGNOSIS_SECTIONS: Final = (
    *LIMITS,
    (TrackerSettings, "tracker."),
    (KnownLawTexts, "known_law."),
    (Service, ""),
    (DamageSettings, "damage."),
)
"""Dataclasses of the prognosis parameters, with their prefixes."""

LIMIT_OPTION: Final = assignments_option(
    "--limit", "limits", "End-of-life limit: friction=0.4, bandwidth=15 [Hz]."
)
GROWTH_OPTIONS: Final[tuple[Callable[[Command], Command], ...]] = (
    click.option(
        "--hours-per-cycle", type=float, help="Service hours per test; 0: from usage messages."
    ),
    click.option("--duty", type=float, help="Growth in a future hour, relative to a past one."),
    click.option(
        "--known-law",
        "laws",
        multiple=True,
        metavar="FAULT=LAW",
        help=f"Known growth law of a fault: {FORM}.",
    ),
    LIMIT_OPTION,
)
"""Options for the inputs to health and life other than tests."""


def _finite(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value:g} is not a number of hours", ctx, param)
    return value


@dataclass(frozen=True)
class Predicting(Identifying):
    """Command options that set the identification and prognosis of a unit."""

    OPTIONS: ClassVar[tuple[Callable[[Command], Command], ...]] = (
        *Identifying.OPTIONS,
        ALGORITHM_OPTION,
        *GROWTH_OPTIONS,
        click.option(
            "--fleet",
            "fleet_file",
            type=click.Path(path_type=Path, exists=True),
            help="Growth of other units: a file of `ema learn-fleet`.",
        ),
        click.option(
            "--scenarios",
            "scenario_file",
            type=click.Path(path_type=Path, exists=True, dir_okay=False),
            help="YAML file of future duties for separate forecasts.",
        ),
        click.option(
            "--at",
            "at_hours",
            type=click.FloatRange(min=0.0),
            callback=_finite,
            metavar="HOURS",
            help="Ignore tests after this service hour.",
        ),
        assignments_option(
            "--cost", "cost_figures", "Costs from which to advise: removal=1,failure=25."
        ),
    )
    SECTIONS: ClassVar[tuple[tuple[Any, str], ...]] = (
        *Identifying.SECTIONS,
        *PROGNOSIS_SECTIONS,
        (Costs, "costs."),
    )

    prognosis: PrognosisSettings = PrognosisSettings()  # noqa: RUF009 - frozen
    costs: Costs | None = None
    """Costs from which to advise on removal; None for no advice."""
    at_hours: float | None = None
    """Service hour of the prognosis [h]; None for the last test."""
    archive: Path | None = None
    """Folder of the archive that provides the fleet; None without an archive."""
    scenarios: tuple[Scenario, ...] = ()
    """Additional future duties for which the life is predicted."""

    @classmethod
    def of(cls, parameters: Parameters, **options: Any) -> Self:
        """Build the settings from options and parameters. Raises ValueError for invalid values."""
        parameters = with_growth(
            parameters, options.pop("limits"), options.pop("laws"), options.pop("cost_figures")
        )
        fleet_file = options.pop("fleet_file") or parameters.path("fleet_file")
        scenario_file = options.pop("scenario_file")
        is_archive = fleet_file is not None and fleet_file.is_dir()
        settings = prognosis_over(PrognosisSettings(), parameters)
        if fleet_file is not None and not is_archive:
            settings = replace(settings, fleet=FleetGrowth.read(fleet_file))
        costs = parameters.over(Costs(), "costs.")
        return super().of(
            parameters,
            **options,
            prognosis=settings,
            costs=None if costs == Costs() else costs,
            archive=fleet_file if is_archive else None,
            scenarios=read_scenarios(scenario_file) if scenario_file is not None else (),
        )


def with_growth(
    parameters: Parameters,
    limits: Mapping[str, float],
    laws: tuple[str, ...] = (),
    costs: Mapping[str, float] = MappingProxyType({}),
    limited: Sequence[tuple[Any, str]] = LIMITS,
) -> Parameters:
    """Return parameters extended by the limits, growth laws and costs in options.

    ``limited`` are the dataclasses, with prefix, whose fields can have limits.

    Raises
    ------
    click.UsageError
        If a name is unknown, or a fault has several laws.
    """
    values: dict[str, Any] = {}
    by_limit = {name.partition(".")[2]: name for name in names_of(limited)}
    by_cost = {item.name: f"costs.{item.name}" for item in fields(Costs) if item.name != "unit"}
    for kind, figures, names in (("limit", limits, by_limit), ("cost", costs, by_cost)):
        for name, value in figures.items():
            if name not in names:
                raise click.UsageError(f"--{kind}: {unknown_name(kind, name, names)}")
            values[names[name]] = value
    kinds = [item.name for item in fields(KnownLawTexts)]
    for written in laws:
        name, _, law = written.partition("=")
        kind = as_identifier(name)
        if kind not in kinds:
            raise click.UsageError(f"--known-law {written!r}: {unknown_name('fault', name, kinds)}")
        if f"known_law.{kind}" in values:
            raise click.UsageError("--known-law: expected one law per fault")
        values[f"known_law.{kind}"] = law
    return parameters.with_options(**values)


def prognosis_over(settings: PrognosisSettings, parameters: Parameters) -> PrognosisSettings:
    """Return settings of a prognosis, overridden by parameters."""
    laws = parameters.over(KnownLawTexts(), "known_law.").laws()
    tracker = parameters.over(settings.tracker, "tracker.")
    return replace(
        settings,
        limits=parameters.over(settings.limits, "limits."),
        requirements=parameters.over(settings.requirements, "requirements."),
        tracker=replace(tracker, laws={**tracker.laws, **laws}) if laws else tracker,
        service=parameters.over(settings.service),
        damage=parameters.over(settings.damage, "damage."),
    )
