# SPDX-License-Identifier: Apache-2.0
"""Status of one monitored actuator on ``/diagnostics``."""

from collections.abc import Iterable
from typing import Final

from ema_core.description import ActuatorDescription
from ema_core.labels import label_of
from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN
from ema_core.quantity import is_finite_number
from ema_core.wording import beside_limit
from ema_interfaces.msg import TelemetryStatus
from ema_monitor.health import FaultHealth
from ema_monitor.joint.comparison import Comparison
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.quantities import FAULTS_OF_RECORDS
from ema_monitor.reason_texts import text_of
from ema_ros.status import (
    CHECK_FUNCTION,
    DIAGNOSTICS_ACTIVE,
    FAILURE,
    MAINTENANCE_REQUIRED,
    NORMAL,
    OFF_SPEC,
    Task,
)

_LARGEST_COUNT: Final = 2**64 - 1
"""Largest count that fits a message; jumping sample numbers may add up to more."""


def telemetry_status(unit: ActuatorStatus, dropped: int = 0) -> TelemetryStatus:
    """Return an actuator's counts as a message; ``dropped`` is its number of dropped windows."""
    return TelemetryStatus(
        actuator_id=unit.actuator_id,
        serial_number=unit.description.serial_number if unit.description else "",
        blocks=unit.finder.blocks,
        samples_lost=min(unit.runs.lost_samples, _LARGEST_COUNT),
        windows=unit.finder.windows,
        windows_dropped=dropped,
        estimates_valid=unit.valid,
        estimates_invalid=unit.invalid,
        latency=unit.latency_s,
    )


def unit_tasks(unit: ActuatorStatus, waiting: int, dropped: int = 0) -> list[Task]:
    """Return the status tasks of telemetry, health, and every fault and requirement.

    ``waiting`` is the number of queued windows of all actuators, and ``dropped`` the number of
    dropped windows of this actuator.
    """
    health, life = unit.health.outlook.health, unit.health.outlook.rul
    values = {
        "health index": health.health_index,
        "confidence": health.confidence,
        "service hours [h]": unit.health.outlook.flight_hours,
        "remaining life 5 % [h]": life.hours_05,
        "remaining life 50 % [h]": life.hours_50,
        "remaining life 95 % [h]": life.hours_95,
    }
    faults = _shown_by(unit.description, health.faults)
    rated = (*faults, *health.requirements)
    values |= {f"{label_of(item.name)}{_unit(item, ' [{}]')}": item.value for item in rated}
    if unit.health.comparison is not None:
        values |= _figures_of(unit.health.comparison)
    level, last_level = health.level, unit.health.outlook.known_level
    is_stale = level == STALE
    summary = "unknown" if is_stale else LEVEL_NAMES[level]
    if is_stale and last_level != STALE:
        summary = f"unknown, last {LEVEL_NAMES[last_level]}"
    if unit.health.outlook.dominant_fault:
        summary += f": {label_of(unit.health.outlook.dominant_fault)}"
    if is_stale and unit.learning:
        summary = unit.learning
    elif health.reason:
        summary += f" ({health.reason})"
    items = [(item, OFF_SPEC) for item in health.requirements]
    items += [(item, FAILURE) for item in faults]
    worst = [end for item, end in items if item.level == ERROR]
    return [
        _telemetry_task(unit, waiting, dropped),
        Task(
            f"{unit.actuator_id} health",
            level,
            summary,
            unit.hardware_id,
            values,
            _category(level, worst[-1] if worst else FAILURE, is_stale),
        ),
        *(_item_task(unit, item, end) for item, end in items),
    ]


def _shown_by(
    description: ActuatorDescription | None, faults: Iterable[FaultHealth]
) -> list[FaultHealth]:
    """Return the faults that tests of this actuator can detect."""
    if description is None or description.is_modelled:
        return list(faults)
    return [item for item in faults if item.name in FAULTS_OF_RECORDS.values()]


def _figures_of(comparison: Comparison) -> dict[str, float]:
    """Return the change and the smallest detectable change of each quantity, by status key."""
    values: dict[str, float] = {}
    for quantity in comparison.quantities:
        scale, unit = (100.0, "%") if quantity.unit == "-" else (1.0, quantity.unit)
        name = label_of(quantity.name)
        values[f"{name} change [{unit}]"] = scale * quantity.change
        values[f"{name} smallest change [{unit}]"] = scale * quantity.smallest_change
    return values


def _telemetry_task(unit: ActuatorStatus, waiting: int, dropped: int) -> Task:
    finder, category = unit.finder, ""
    if unit.is_listed and unit.description is None and not finder.blocks:
        level, message = WARN, "listed, but nothing received so far"
    elif unit.description is None:
        level, category = ERROR, CHECK_FUNCTION
        waiting_text = "no description of the actuator: its telemetry cannot be used yet"
        message = "; ".join(filter(None, [waiting_text, unit.collision, unit.defects]))
    elif unit.collision:
        level, message = WARN, unit.collision
    elif unit.alternation or unit.defects:
        level, message = WARN, "; ".join(filter(None, [unit.alternation, unit.defects]))
    elif not finder.blocks:
        level, message = WARN, "no telemetry so far"
    elif unit.tally.reason:
        level, message = WARN, str(unit.tally)
    elif obstacle := finder.obstacle:
        missing_text = "no record so far" if finder.finds_records else "no window can be complete"
        level, message = WARN, f"{missing_text}: {text_of(obstacle)}"
    else:
        level, message = OK, f"{unit.valid} valid estimates"
    if unit.is_silent and finder.blocks:
        level, message = STALE, f"telemetry has stopped; {message}"
    if unit.is_calibrating:
        category = DIAGNOSTICS_ACTIVE
    status = telemetry_status(unit, dropped)
    counts = {
        "blocks": status.blocks,
        "samples lost": status.samples_lost,
        "defects": unit.defect_count,
        "windows": status.windows,
        "windows waiting": waiting,
        "windows dropped": status.windows_dropped,
        "estimates valid": status.estimates_valid,
        "estimates invalid": status.estimates_invalid,
        "latency [s]": status.latency,
    }
    if finder.finds_records:
        counts["pieces too short for a record"] = finder.passed_over
    elif unit.tally.stretches or finder.passed_over:
        counts |= {
            "stretches combined": unit.tally.combined,
            "stretches without news": unit.tally.skipped,
            "stretches refused": unit.tally.refused,
            "stretches dropped": unit.tally.dropped,
            "stretches with too little travel": finder.passed_over,
            "combinations without estimate": unit.tally.fruitless,
        }
    name = f"{unit.actuator_id} telemetry"
    return Task(name, level, message, unit.hardware_id, counts, category)


def _item_task(unit: ActuatorStatus, item: FaultHealth, end: str) -> Task:
    is_known = is_finite_number(item.value)
    is_stale = not is_known or unit.health.outlook.health.level == STALE
    level = STALE if is_stale else item.level
    unit_suffix = _unit(item, " {}")
    message = "not known"
    if is_known:
        value, limit = beside_limit(item.value, item.limit, 4)
        warning = f"warning limit {item.warn_limit:.4g}{unit_suffix}, " if level == WARN else ""
        message = f"{value}{unit_suffix}, {warning}limit {limit}{unit_suffix}"
    if is_finite_number(item.held):
        message = f"{item.held:.4g}{unit_suffix} in the latest test, before {message}"
    elif level != STALE and item.unconfirmed is not None:
        message += f"; {LEVEL_NAMES[item.unconfirmed]} once later tests confirm it"
    name = f"{unit.actuator_id} {label_of(item.name)}"
    in_unit = _unit(item, " [{}]")
    values = {f"{key}{in_unit}": getattr(item, key) for key in ("value", "sigma", "limit")}
    category = _category(level, end, level == STALE)
    return Task(name, level, message, unit.hardware_id, values, category)


def _unit(item: FaultHealth, form: str) -> str:
    """Return the unit of a requirement, formatted by ``form``; empty for a fault or share."""
    unit = RequirementLimits.unit(item.name)
    return "" if unit == "1" else form.format(unit)


def _category(level: int, end: str, is_unknown: bool) -> str:
    """Return the NAMUR NE 107 category of a level; ``end`` is the category for ERROR."""
    if is_unknown:
        return CHECK_FUNCTION
    return {OK: NORMAL, WARN: MAINTENANCE_REQUIRED}.get(level, end)
