"""Status of a node on ``/diagnostics``."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from ema_core.levels import ERROR, OK, STALE, WARN

__all__ = ["ERROR", "OK", "STALE", "WARN", "Task", "status_message"]


@dataclass(frozen=True)
class Task:
    """Status of one task of a node.

    Attributes
    ----------
    name
        Name of the task, always the same.
    level
        ``OK``, ``WARN``, ``ERROR`` or ``STALE`` of ``ema_core.levels``.
    hardware_id
        Serial number of the unit concerned.
    values
        Figures by name; the unit is part of the name, as in ``lag [s]``.
    """

    name: str
    level: int
    message: str
    hardware_id: str
    values: Mapping[str, Any] = field(default_factory=dict)


def status_message(node_name: str, task: Task) -> DiagnosticStatus:
    """Return a task as a message."""
    values = [KeyValue(key=key, value=_plain(value)) for key, value in task.values.items()]
    return DiagnosticStatus(
        level=bytes([task.level]),
        name=f"{node_name}: {task.name}",
        message=task.message,
        hardware_id=task.hardware_id,
        values=values,
    )


def _plain(value: Any) -> str:
    """Return a value as a text that plotting tools read: numbers as plain decimals."""
    return f"{value:.9g}" if isinstance(value, float) else str(value)
