"""What a prognosis rests on."""

from dataclasses import dataclass, field

from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.duty.scenario import AS_FLOWN, Scenario
from ema_monitor.prognosis.fleet_growth import FleetGrowth
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.service import Service


@dataclass(frozen=True)
class PrognosisSettings:
    """What a prognosis rests on."""

    limits: HealthLimits = field(default_factory=HealthLimits)
    """Where the life of a fault ends."""
    requirements: RequirementLimits = field(default_factory=RequirementLimits)
    """What must still be performed."""
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    """What is assumed of growth."""
    service: Service = field(default_factory=Service)
    """What is assumed of use."""
    fleet: FleetGrowth | None = None
    """Growth evidence of other units; None without any."""
    damage: DamageSettings = field(default_factory=DamageSettings)
    """How duty does damage."""
    scenario: Scenario = AS_FLOWN
    """Future duty; as in the past by default."""
    good_for_s: float = 0.0
    """How long a level holds after its test [s]; 0 of a record, whose level is that at its end."""
    level_confirmations: int = 2
    """Tests in a row that lower a level."""
    has_clock: bool = True
    """Whether stamps are of a clock; otherwise tests are ordered and dated by their reception."""
