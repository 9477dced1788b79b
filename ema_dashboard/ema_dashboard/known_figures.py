"""The latest figures of actuators and nodes, for who asks for them at intervals."""

import math
import threading
import time
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus

from ema_interfaces.msg import ActuatorDescription, FaultEstimate, Health
from ema_ros.stamps import stamp_from_message

COMPUTING_BOUNDS_S: Final = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Upper bounds of the classes in which computing times are counted [s]; there is one beyond."""

MOST_KEPT: Final = 1000
"""Actuators, and nodes, of which figures are kept; those heard of longest ago make room."""

NODE_TASKS: Final = ("identification", "input", "recording")
"""Tasks of nodes whose figures are kept; of others it is known that the node lives."""

_TELEMETRY: Final = " telemetry"  # ends the name of the status of an actuator's telemetry

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")


@dataclass
class ActuatorFigures:
    """What is known of an actuator.

    Attributes
    ----------
    health
        The latest; None when there is none yet.
    status
        Figures of the status of its telemetry, by their keys.
    computing
        Number of estimates in each class of computing time.
    computing_s
        Sum of the computing times [s].
    """

    serial_number: str = ""
    model: str = ""
    health: Health | None = None
    status: dict[str, float] = field(default_factory=dict)
    computing: list[int] = field(default_factory=lambda: [0] * (len(COMPUTING_BOUNDS_S) + 1))
    computing_s: float = 0.0


@dataclass
class NodeFigures:
    """What a node has told of itself.

    Attributes
    ----------
    heard_s
        When it was heard last, of the system's clock [s].
    tasks
        Figures of its tasks by their keys, by the name of the task.
    """

    heard_s: float
    tasks: dict[str, dict[str, float]] = field(default_factory=dict)


class KnownFigures:
    """Keeps the latest figures of actuators and nodes; any thread may call it.

    Parameters
    ----------
    namespaces
        Those whose nodes are of interest.
    """

    def __init__(self, namespaces: Iterable[str]) -> None:
        self._prefixes = tuple(f"{name.rstrip('/')}/" for name in namespaces)
        self._lock = threading.Lock()
        self._actuators: dict[tuple[str, str], ActuatorFigures] = {}
        self._nodes: dict[str, NodeFigures] = {}

    @contextmanager
    def read(
        self,
    ) -> Iterator[tuple[Mapping[tuple[str, str], ActuatorFigures], Mapping[str, NodeFigures]]]:
        """Yield actuators by namespace and name, and nodes by their full names; none changes."""
        with self._lock:
            yield self._actuators, self._nodes

    def note_description(self, namespace: str, message: ActuatorDescription) -> None:
        """Take what an actuator is."""
        with self._lock:
            self._unit(namespace, message).model = message.model

    def note_estimate(self, namespace: str, message: FaultEstimate) -> None:
        """Take how long an estimate took."""
        with self._lock:
            known, taken_s = self._unit(namespace, message), message.computing_time
            if math.isfinite(taken_s) and taken_s >= 0.0:
                known.computing[bisect_left(COMPUTING_BOUNDS_S, taken_s)] += 1
                known.computing_s += taken_s

    def note_health(self, namespace: str, message: Health) -> None:
        """Take the health of an actuator."""
        with self._lock:
            self._unit(namespace, message).health = message

    def note_status(self, status: DiagnosticStatus) -> None:
        """Take the status of a task of a node."""
        node, _, task = status.name.partition(": ")
        if not node.startswith(self._prefixes):
            return
        is_telemetry = task.endswith(_TELEMETRY)
        figures = _numbers(status) if is_telemetry or task in NODE_TASKS else {}
        with self._lock:
            known = _latest(self._nodes, node, lambda: NodeFigures(0.0))
            known.heard_s = time.time()
            if task in NODE_TASKS:
                known.tasks[task] = figures
            elif is_telemetry:
                key = node.rpartition("/")[0] or "/", task.removesuffix(_TELEMETRY)
                _latest(self._actuators, key, ActuatorFigures).status = figures

    def rewind(self, time_ns: int) -> None:
        """Forget health that is later than a time to which the graph has jumped back [ns]."""
        with self._lock:
            for known in self._actuators.values():
                if known.health and stamp_from_message(known.health.header.stamp) > time_ns:
                    known.health = None

    def _unit(self, namespace: str, message: Any) -> ActuatorFigures:
        """Return what is known of the actuator of a message, nothing where the unit is another."""
        key = namespace.rstrip("/") or "/", message.actuator_id
        known = _latest(self._actuators, key, ActuatorFigures)
        if known.serial_number != message.serial_number:
            known.serial_number, known.health = message.serial_number, None
        return known


def _latest(items: dict[_Key, _Value], key: _Key, new: Callable[[], _Value]) -> _Value:
    """Return an item, a new one if there is none, as the one heard of last."""
    items[key] = item = items.pop(key) if key in items else new()
    if len(items) > MOST_KEPT:
        del items[next(iter(items))]
    return item


def _numbers(status: DiagnosticStatus) -> dict[str, float]:
    found = {}
    for item in status.values:
        with suppress(ValueError):
            found[item.key] = float(item.value)
    return found
