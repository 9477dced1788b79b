# SPDX-License-Identifier: Apache-2.0
"""Status of a node on ``/diagnostics``, in the format of ``diagnostic_updater``."""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from ema_core.levels import ERROR, OK, STALE, WARN

__all__ = ["ERROR", "OK", "STALE", "WARN", "Task", "fault_code", "hardware_name", "status_message"]

LONGEST_CODE: Final = 64
"""Largest number of characters of a fault code."""

NORMAL: Final = "NORMAL"
FAILURE: Final = "FAILURE"
CHECK_FUNCTION: Final = "CHECK_FUNCTION"
OFF_SPEC: Final = "OFF_SPEC"
MAINTENANCE_REQUIRED: Final = "MAINTENANCE_REQUIRED"
DIAGNOSTICS_ACTIVE: Final = "DIAGNOSTICS_ACTIVE"
"""Categories of NAMUR NE 107, and ``NORMAL`` if no category applies."""

_BY_LEVEL: Final = {OK: NORMAL, WARN: CHECK_FUNCTION, ERROR: FAILURE, STALE: CHECK_FUNCTION}


@dataclass(frozen=True)
class Task:
    """Status of one task of a node."""

    name: str
    """Name of the task, which never changes."""
    level: int
    """``OK``, ``WARN``, ``ERROR`` or ``STALE`` of ``ema_core.levels``; ``STALE`` if it is unknown
    or outdated."""
    message: str
    hardware_id: str
    """Name of the unit, from ``hardware_name``."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """Values by name; names include the unit, as in ``lag [s]``."""
    category: str = ""
    """Category of NAMUR NE 107; empty for the default category of the level."""


def status_message(node_name: str, task: Task) -> DiagnosticStatus:
    """Return a task as a message; ``node_name`` is the node's full name."""
    name = f"{node_name}: {task.name}"
    values = {
        **task.values,
        "fault_code": fault_code(name),
        "ne107": task.category or _BY_LEVEL[task.level],
    }
    return DiagnosticStatus(
        level=bytes([task.level]),
        name=name,
        message=task.message,
        hardware_id=task.hardware_id,
        values=[KeyValue(key=key, value=_plain(value)) for key, value in values.items()],
    )


def fault_code(name: str) -> str:
    """Return the fault code of a status, derived from its name and as unique as the name.

    The code is independent of the level, so that fault collectors detect when a fault ends.

    It consists of capitals, digits and single underscores: ``EMA_MONITOR_FLAP_FRICTION`` for
    ``/ema/monitor: flap friction``. A code that is too long is truncated, and ends in a digest of
    the name.
    """
    code = re.sub(r"[^A-Z0-9]+", "_", name.upper()).strip("_")
    if len(code) <= LONGEST_CODE:
        return code
    digest = hashlib.blake2s(name.encode(), digest_size=4).hexdigest().upper()
    return f"{code[: LONGEST_CODE - len(digest) - 1].rstrip('_')}_{digest}"


def hardware_name(namespace: str, actuator_id: str, serial_number: str = "") -> str:
    """Return a unit's name in the status: telemetry namespace, actuator and serial number."""
    parts = (namespace.rstrip("/"), actuator_id, serial_number)
    return "/".join(parts if serial_number else parts[:2])


def _plain(value: Any) -> str:
    """Return a value as a string for plotting tools: numbers as plain decimals."""
    return f"{value:.9g}" if isinstance(value, float) else str(value)
