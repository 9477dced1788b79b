# SPDX-License-Identifier: Apache-2.0
"""Settings of a prognosis."""

from dataclasses import dataclass, field
from types import NoneType

from ema_core.expecting import require_type
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.duty.scenario import AS_FLOWN, Scenario
from ema_monitor.prognosis.fleet_growth import FleetGrowth
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.service import Service


@dataclass(frozen=True)
class PrognosisSettings:
    """Settings of the health assessment and the prognosis of a unit.

    Raises
    ------
    ValueError
        If limits, assumptions or a scenario have a wrong type.
    """

    limits: HealthLimits = field(default_factory=HealthLimits)
    """Fault limits at which life ends."""
    requirements: RequirementLimits = field(default_factory=RequirementLimits)
    """Limits of the required performance."""
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    """Assumptions about growth and measurement noise."""
    service: Service = field(default_factory=Service)
    """Assumptions about the usage of the unit."""
    fleet: FleetGrowth | None = None
    """Growth evidence of other units; None if there is none."""
    damage: DamageSettings = field(default_factory=DamageSettings)
    """Settings that relate damage to duty."""
    scenario: Scenario = AS_FLOWN
    """Future duty; as in the past by default."""
    good_for_s: float = 0.0
    """Validity of a level after its test [s]; 0 for a record, whose level does not expire."""
    level_confirmations: int = 2
    """Number of consecutive tests that lower a level."""
    has_clock: bool = True
    """Whether stamps come from a clock; otherwise tests are ordered and dated by reception."""

    def __post_init__(self) -> None:
        require_type("limits", self.limits, HealthLimits)
        require_type("requirements", self.requirements, RequirementLimits)
        require_type("tracker", self.tracker, TrackerSettings)
        require_type("service", self.service, Service)
        require_type("fleet", self.fleet, (FleetGrowth, NoneType))
        require_type("damage", self.damage, DamageSettings)
        require_type("scenario", self.scenario, Scenario)
