"""Health in a few lines, and messages of which nothing is known."""

import math
from array import array
from typing import Any

from ema_core.levels import LEVEL_NAMES
from ema_interfaces.msg import FaultEstimate, Health, HealthSummary

_ALL: int = 255


def summary_of(health: Health) -> HealthSummary:
    """Return a health in a few lines."""
    life = health.rul.hours_50 if health.rul.known else math.nan
    words = LEVEL_NAMES[health.level]
    if health.dominant_fault:
        words += f": {health.dominant_fault.replace('_', ' ')}"
    parts = [words]
    if math.isfinite(life):
        parts.append(f"remaining life {life:.4g} flight hours")
    if health.reason:
        parts.append(health.reason)
    return HealthSummary(
        header=health.header,
        actuator_id=health.actuator_id,
        serial_number=health.serial_number,
        level=health.level,
        last_level=health.last_level,
        good_until=health.good_until,
        author=health.author,
        health_index=health.health_index,
        dominant_fault=health.dominant_fault,
        rul_50=life,
        text="; ".join(parts),
    )


def unknown_estimate(actuator_id: str, reason: str) -> FaultEstimate:
    """Return the estimate of an answer that has none: every figure is NaN."""
    message = _without_figures(FaultEstimate())
    message.actuator_id, message.reason = actuator_id, reason
    message.verdict, message.unobservable = FaultEstimate.REFUSED, _ALL
    return message


def unknown_health(actuator_id: str, reason: str) -> Health:
    """Return the health of an answer that has none: every figure is NaN."""
    message = _without_figures(Health())
    message.actuator_id, message.reason = actuator_id, reason
    message.level = Health.STALE
    for life in (message.rul, message.rul_faults, message.rul_requirements):
        life.reason = reason
    return message


def _without_figures(message: Any) -> Any:
    """Return a message with NaN in each floating-point field, those of its parts included."""
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if isinstance(value, float):
            setattr(message, name, math.nan)
        elif hasattr(value, "dtype"):
            value[:] = math.nan
        elif isinstance(value, array) and value.typecode == "d":
            setattr(message, name, array("d", [math.nan] * len(value)))
        elif hasattr(value, "get_fields_and_field_types"):
            _without_figures(value)
    return message
