"""What is known of actuators and nodes as metrics, for Prometheus and others."""

import math
import threading
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any, Final, TypeVar

from prometheus_client import CollectorRegistry, ProcessCollector
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
)
from prometheus_client.exposition import choose_encoder
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from ema_dashboard.contents import Made
from ema_dashboard.hub import Totals
from ema_interfaces.msg import (
    ActuatorDescription,
    FaultEstimate,
    Health,
    NodeStatus,
    TelemetryStatus,
)
from ema_ros.stamps import stamp_from_message

COMPUTING_BOUNDS_S: Final = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Upper bounds of the classes in which computing times are counted [s]; there is one beyond."""

MOST_KEPT: Final = 1000
"""Most actuators, and most nodes, with figures; the least recently updated are dropped."""

_HOUR_S: Final = 3600.0
_ACTUATOR: Final = ("namespace", "actuator_id")
_BOUNDS: Final = (*map(str, COMPUTING_BOUNDS_S), "+Inf")

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")


_OF_NODES: Final = (
    ("ema_monitor_windows_dropped", "Windows of all actuators of a monitor that had to give way.",
     NodeStatus.MONITOR, "windows_dropped"),
    ("ema_monitor_refusals_dropped", "Refused windows that a monitor did not report.",
     NodeStatus.MONITOR, "refusals_dropped"),
    ("ema_monitor_follow_ups_dropped", "Forecasts and the like that a monitor left out.",
     NodeStatus.MONITOR, "follow_ups_dropped"),
    ("ema_recorder_messages_lost", "Messages that did not reach a recorder.",
     NodeStatus.RECORDER, "messages_lost"),
    ("ema_recorder_messages_without_room", "Messages that a recorder could not write.",
     NodeStatus.RECORDER, "messages_without_room"),
    ("ema_bridge_samples_lost", "Samples missing at a bridge's input.",
     NodeStatus.BRIDGE, "samples_lost"),
)  # fmt: skip
"""Counters of nodes: name, documentation, and kind of node and field of its status."""

_OF_HEALTH: Final = (
    ("ema_health_index", "Health: 1 is as new, 0 at a limit.", "ratio",
     lambda health: health.health_index),
    ("ema_health_level", "Level: 0 OK, 1 WARN, 2 ERROR, 3 STALE.", "",
     lambda health: health.level),
    ("ema_health_confidence", "Confidence in the health.", "ratio",
     lambda health: health.confidence),
    ("ema_service_time", "Time of service so far.", "seconds",
     lambda health: _HOUR_S * health.flight_hours),
    ("ema_health_timestamp", "End of the latest test.", "seconds",
     lambda health: stamp_from_message(health.header.stamp) * 1e-9),
)  # fmt: skip
"""Gauges of actuators: name, documentation, unit, and value of a health."""

_OF_STATUS: Final = (
    ("ema_samples_lost", "Samples of telemetry that are missing.", {(): "samples_lost"}),
    ("ema_windows_dropped", "Windows that had to give way to later ones.",
     {(): "windows_dropped"}),
    ("ema_estimates", "Estimates by their verdict.",
     {("valid",): "estimates_valid", ("refused",): "estimates_invalid"}),
)  # fmt: skip
"""Counters of actuators: name, documentation, and fields of TelemetryStatus by verdict."""


@dataclass
class _Actuator:
    """What is known of an actuator."""

    serial_number: str = ""
    model: str = ""
    health: Health | None = None
    status: TelemetryStatus | None = None
    computing: list[int] = field(default_factory=lambda: [0] * (len(COMPUTING_BOUNDS_S) + 1))
    computing_s: float = 0.0


@dataclass
class _Node:
    """Latest status of a node while it was configured, and when any was received last [s]."""

    heard_s: float = 0.0
    status: NodeStatus = field(default_factory=NodeStatus)


class Metrics(Collector):
    """Figures of actuators, nodes and this process, as metrics when they are asked for.

    Any thread may call it.

    Parameters
    ----------
    own
        Returns the figures of the dashboard.
    """

    def __init__(self, own: Callable[[], Totals]) -> None:
        self._own = own
        self._lock = threading.Lock()
        self._actuators: dict[tuple[str, str], _Actuator] = {}
        self._nodes: dict[str, _Node] = {}
        # One of its own: a process may have several dashboards.
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(self)
        ProcessCollector(registry=self._registry)

    def note(self, namespace: str, message: Any) -> None:
        """Take a description, an estimate or a health."""
        key = namespace.rstrip("/") or "/", message.actuator_id
        with self._lock:
            known = _latest(self._actuators, key, _Actuator)
            if known.serial_number != message.serial_number:
                known.serial_number, known.health = message.serial_number, None
            if isinstance(message, ActuatorDescription):
                known.model = message.model
            elif isinstance(message, Health):
                known.health = message
            elif isinstance(message, FaultEstimate):
                taken_s = message.computing_time
                if math.isfinite(taken_s) and taken_s >= 0.0:
                    known.computing[bisect_left(COMPUTING_BOUNDS_S, taken_s)] += 1
                    known.computing_s += taken_s

    def note_node(self, namespace: str, status: NodeStatus) -> None:
        """Take the status of a node."""
        with self._lock:
            node = _latest(self._nodes, status.node, _Node)
            node.heard_s = time.time()
            if status.kind != NodeStatus.OTHER:
                node.status = status
            for telemetry in status.telemetry:
                key = namespace.rstrip("/") or "/", telemetry.actuator_id
                _latest(self._actuators, key, _Actuator).status = telemetry

    def rewind(self, time_ns: int) -> None:
        """Forget health that is later than a time to which the graph has jumped back [ns]."""
        with self._lock:
            for known in self._actuators.values():
                if known.health and stamp_from_message(known.health.header.stamp) > time_ns:
                    known.health = None

    def exposition(self, _: Mapping[str, str], accept: str) -> Made:
        """Return all metrics, in the format that a client accepts: OpenMetrics or Prometheus's."""
        try:
            encode, content_type = choose_encoder(accept)
        except TypeError:
            # It asks for a version that is not a number.
            encode, content_type = choose_encoder("")
        return Made(encode(self._registry), content_type)

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics except those of the process."""
        with self._lock:
            metrics = [*_of_actuators(self._actuators), *_of_nodes(self._nodes)]
        yield from metrics
        yield from _of_dashboard(self._own())


def _of_nodes(nodes: Mapping[str, _Node]) -> Iterator[Metric]:
    for name, documentation, kind, counter in _OF_NODES:
        family = CounterMetricFamily(name, documentation, labels=["node"])
        for node, known in nodes.items():
            if known.status.kind == kind:
                family.add_metric((_text(node),), getattr(known.status, counter))
        yield family
    heard = _gauge("ema_node_heard_timestamp", "When a node last reported.", "seconds", "node")
    for node, known in nodes.items():
        heard.add_metric((_text(node),), known.heard_s)
    yield heard


def _of_actuators(actuators: Mapping[tuple[str, str], _Actuator]) -> Iterator[Metric]:
    named = [(tuple(map(_text, names)), known) for names, known in actuators.items()]
    healths = [(labels, known.health) for labels, known in named if known.health is not None]
    about = InfoMetricFamily("ema_actuator", "The unit that is installed.", labels=_ACTUATOR)
    for labels, known in named:
        unit = {"serial_number": _text(known.serial_number), "model": _text(known.model)}
        about.add_metric(labels, unit)
    yield about
    for name, documentation, unit, value in _OF_HEALTH:
        family = _gauge(name, documentation, unit)
        for labels, health in healths:
            family.add_metric(labels, value(health))
        yield family
    life = _gauge(
        "ema_remaining_useful_life",
        "Time of service that is left, by quantile; NaN when it is unknown.",
        "seconds",
        *(*_ACTUATOR, "quantile"),
    )
    for labels, health in healths:
        rul = health.rul
        quantiles = {"0.05": rul.hours_05, "0.5": rul.hours_50, "0.95": rul.hours_95}
        for name, hours in quantiles.items():
            life.add_metric((*labels, name), _HOUR_S * hours if rul.known else math.nan)
    yield life
    for name, documentation, keys in _OF_STATUS:
        verdict = ["verdict"] if len(keys) > 1 else []
        family = CounterMetricFamily(name, documentation, labels=[*_ACTUATOR, *verdict])
        for labels, known in named:
            for label, counter in keys.items():
                if known.status is not None:
                    family.add_metric((*labels, *label), getattr(known.status, counter))
        yield family
    latency = _gauge(
        "ema_estimate_latency", "Time from the end of the latest window to its estimate.", "seconds"
    )
    computing = HistogramMetricFamily(
        "ema_estimate_computing",
        "Time that an estimate took, from its window.",
        labels=_ACTUATOR,
        unit="seconds",
    )
    for labels, known in named:
        if known.status is not None:
            latency.add_metric(labels, known.status.latency)
        if any(known.computing):
            counts = zip(_BOUNDS, accumulate(known.computing), strict=True)
            computing.add_metric(labels, list(counts), known.computing_s)
    yield from (latency, computing)


def _of_dashboard(own: Totals) -> Iterator[Metric]:
    for name, documentation, value in (
        ("messages_sent", "Messages sent to clients.", own.messages),
        ("messages_dropped", "Messages dropped for slow clients.", own.dropped),
        ("requests_refused", "Requests refused.", own.refused),
        ("sent_bytes", "Content of the messages sent.", own.sent_bytes),
    ):
        unit = "bytes" if name == "sent_bytes" else ""
        yield CounterMetricFamily(f"ema_dashboard_{name}", documentation, value, unit=unit)
    yield GaugeMetricFamily("ema_dashboard_clients", "Clients that are connected.", own.clients)
    yield GaugeMetricFamily(
        "ema_dashboard_waiting_bytes", "What waits for clients.", own.waiting_bytes, unit="bytes"
    )


def _gauge(name: str, documentation: str, unit: str, *labels: str) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, documentation, labels=labels or _ACTUATOR, unit=unit)


def _text(words: str) -> str:
    """Return words of the graph as UTF-8 can write them."""
    return words.encode(errors="replace").decode()


def _latest(items: dict[_Key, _Value], key: _Key, new: Callable[[], _Value]) -> _Value:
    """Return an item, a new one if there is none, marked as most recently updated."""
    items[key] = item = items.pop(key) if key in items else new()
    if len(items) > MOST_KEPT:
        del items[next(iter(items))]
    return item
