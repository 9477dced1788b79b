# SPDX-License-Identifier: Apache-2.0
"""Reports on a unit, as plain values with the fields of the corresponding ROS messages.

The node publishes reports and commands print them, without further computation.
"""

import math
from dataclasses import asdict, dataclass

from ema_core.description import UnitKey
from ema_core.event_kinds import MOST_COUNT
from ema_monitor.health import FaultHealth
from ema_monitor.prognosis.duty.scenario import Scenario
from ema_monitor.prognosis.event_texts import text_of
from ema_monitor.prognosis.events import UnitEvent
from ema_monitor.prognosis.growth.check import TrackRecord
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.sentences import cause_of_level, reason_of, removal_text


@dataclass(frozen=True)
class Stamp:
    """Fields of ``builtin_interfaces/msg/Time``."""

    sec: int
    nanosec: int

    @classmethod
    def of(cls, stamp_ns: int) -> "Stamp":
        """Return the stamp for a time in nanoseconds."""
        return cls(*divmod(int(stamp_ns), 1_000_000_000))

    @property
    def ns(self) -> int:
        """The time [ns]."""
        return 1_000_000_000 * self.sec + self.nanosec


@dataclass(frozen=True)
class Header:
    """Fields of ``std_msgs/msg/Header``."""

    stamp: Stamp
    frame_id: str = ""


@dataclass(frozen=True)
class EventReport:
    """Fields of ``ema_interfaces/msg/UnitEvent``."""

    stamp: Stamp
    flight_hours: float
    kind: str
    text: str
    count: int

    @classmethod
    def of(cls, event: UnitEvent) -> "EventReport":
        """Return the report of an event."""
        return cls(
            Stamp.of(event.stamp_ns),
            event.flight_hours,
            event.kind.value,
            text_of(event.occurrence),
            min(event.occurrence.count, MOST_COUNT),
        )


@dataclass(frozen=True)
class LifeReport:
    """Fields of ``ema_interfaces/msg/RemainingUsefulLife``, in service hours and test cycles."""

    known: bool
    hours_05: float
    hours_50: float
    hours_95: float
    cycles_05: float
    cycles_50: float
    cycles_95: float
    criterion: str
    reason: str

    @classmethod
    def of(cls, life: RemainingLife, hours_per_cycle: float) -> "LifeReport":
        """Return the report of a remaining life."""
        return cls(
            **asdict(life),
            cycles_05=life.hours_05 / hours_per_cycle,
            cycles_50=life.hours_50 / hours_per_cycle,
            cycles_95=life.hours_95 / hours_per_cycle,
        )


@dataclass(frozen=True)
class ItemReport:
    """Fields of ``ema_interfaces/msg/FaultHealth``, for a fault or a requirement."""

    name: str
    level: int
    value: float
    sigma: float
    limit: float
    limit_is_lower: bool
    trend: float
    score_rms: float
    score_rms_ahead: float
    widening: float
    unit: str
    rul: LifeReport


@dataclass(frozen=True)
class HealthReport:
    """Fields of ``ema_interfaces/msg/Health``."""

    header: Header
    actuator_id: str
    serial_number: str
    level: int
    last_level: int
    tested: Stamp
    received: Stamp
    good_until: Stamp
    author: str
    health_index: float
    severity: int
    confidence: float
    dominant_fault: str
    faults: tuple[ItemReport, ...]
    requirements: tuple[ItemReport, ...]
    rul_faults: LifeReport
    rul_requirements: LifeReport
    rul: LifeReport
    flight_hours: float
    cycles: int
    growth_factor: float
    assumption: str
    cause: str
    removal: str
    removal_risk: float
    removal_hours: float
    removal_cycles: float
    removal_days: float
    events: tuple[EventReport, ...]
    reason: str


@dataclass(frozen=True)
class ScenarioReport:
    """Fields of ``ema_interfaces/msg/ScenarioLife``."""

    name: str
    rul: LifeReport
    days_05: float
    days_50: float
    days_95: float
    dominant_fault: str
    removal_hours: float
    removal_cycles: float
    removal_days: float
    assumption: str


def health_report(outlook: Outlook, unit: UnitKey) -> HealthReport:
    """Return the report on health and remaining life of a unit after a test."""
    health, removal = outlook.health, outlook.removal
    lives = (outlook.rul_faults, outlook.rul_requirements, outlook.rul)
    rul_faults, rul_requirements, rul = (
        LifeReport.of(life, outlook.hours_per_cycle) for life in lives
    )
    return HealthReport(
        header=Header(Stamp.of(outlook.stamp_ns)),
        actuator_id=unit[0],
        serial_number=unit[1],
        level=health.level,
        last_level=outlook.known_level,
        tested=Stamp.of(outlook.claim.tested_ns),
        received=Stamp.of(outlook.claim.received_ns),
        good_until=Stamp.of(outlook.claim.good_until_ns),
        author=outlook.claim.author,
        health_index=health.health_index,
        severity=health.severity,
        confidence=health.confidence,
        dominant_fault=outlook.dominant_fault,
        faults=tuple(_item(item, "1", outlook) for item in health.faults),
        requirements=tuple(
            _item(item, RequirementLimits.unit(item.name), outlook) for item in health.requirements
        ),
        rul_faults=rul_faults,
        rul_requirements=rul_requirements,
        rul=rul,
        flight_hours=outlook.flight_hours,
        cycles=outlook.cycles,
        growth_factor=outlook.future.factor,
        assumption=outlook.assumption,
        cause=cause_of_level(outlook),
        removal=removal_text(outlook),
        removal_risk=removal.risk,
        removal_hours=removal.hours,
        removal_cycles=removal.cycles,
        removal_days=removal.days,
        events=tuple(map(EventReport.of, outlook.events)),
        reason=reason_of(outlook),
    )


def _item(item: FaultHealth, unit: str, outlook: Outlook) -> ItemReport:
    past = outlook.track_records.get(item.name, TrackRecord())
    return ItemReport(
        name=item.name,
        level=item.level,
        value=item.value,
        sigma=item.sigma,
        limit=item.limit,
        limit_is_lower=item.limit_is_lower,
        trend=outlook.trends.get(item.name, math.nan),
        score_rms=past.one_step,
        score_rms_ahead=past.ahead,
        widening=past.widening,
        unit=unit,
        rul=LifeReport.of(outlook.lives.get(item.name, outlook.rul), outlook.hours_per_cycle),
    )


def scenario_report(scenario: Scenario, outlook: Outlook) -> ScenarioReport:
    """Return the report on the remaining life under a scenario, from its outlook."""
    life, removal = outlook.rul, outlook.removal
    quantiles = (life.hours_05, life.hours_50, life.hours_95)
    days_05, days_50, days_95 = (hours / removal.hours_a_day for hours in quantiles)
    return ScenarioReport(
        name=scenario.name,
        rul=LifeReport.of(life, outlook.hours_per_cycle),
        days_05=days_05,
        days_50=days_50,
        days_95=days_95,
        dominant_fault=outlook.dominant_fault if life.known else "",
        removal_hours=removal.hours,
        removal_cycles=removal.cycles,
        removal_days=removal.days,
        assumption=outlook.assumption,
    )
