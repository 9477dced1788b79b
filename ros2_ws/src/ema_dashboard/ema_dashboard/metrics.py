# SPDX-License-Identifier: Apache-2.0
"""Metrics of actuators and nodes, for Prometheus and compatible collectors."""

import math
import threading
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
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
    BaselineStatus,
    FaultEstimate,
    Health,
    NodeStatus,
    TelemetryStatus,
)
from ema_ros.stamps import stamp_from_message

COMPUTING_BOUNDS_S: Final = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Upper bounds of the computing time histogram [s]; the last bucket is unbounded."""

MOST_KEPT: Final = 1000
"""Largest number of actuators and of nodes; the least recently updated are dropped."""

_HOUR_S: Final = 3600.0
_ACTUATOR: Final = ("namespace", "actuator_id")
_BOUNDS: Final = (*map(str, COMPUTING_BOUNDS_S), "+Inf")

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")


_OF_NODES: Final = (
    ("ema_monitor_windows_dropped", "Windows dropped by a monitor because its queue was full.",
     NodeStatus.MONITOR, "windows_dropped"),
    ("ema_monitor_refusals_dropped", "Refused windows not reported by a monitor.",
     NodeStatus.MONITOR, "refusals_dropped"),
    ("ema_monitor_follow_ups_dropped", "Forecasts and similar work skipped by a monitor.",
     NodeStatus.MONITOR, "follow_ups_dropped"),
    ("ema_recorder_messages_lost", "Messages lost before they reached a recorder.",
     NodeStatus.RECORDER, "messages_lost"),
    ("ema_recorder_messages_without_room", "Messages not written by a recorder.",
     NodeStatus.RECORDER, "messages_without_room"),
    ("ema_bridge_samples_lost", "Samples missing at a bridge's input.",
     NodeStatus.BRIDGE, "samples_lost"),
)  # fmt: skip
"""Counters of nodes: name, documentation, and kind of node and field of its status."""

_OF_HEALTH: Final = (
    ("ema_health_index", "Health index: 1 when healthy, 0 at a limit.", "ratio",
     lambda health: health.health_index),
    ("ema_health_level", "Level: 0 OK, 1 WARN, 2 ERROR, 3 STALE.", "",
     lambda health: health.level),
    ("ema_health_confidence", "Confidence in the health.", "ratio",
     lambda health: health.confidence),
    ("ema_service_time", "Service time.", "seconds",
     lambda health: _HOUR_S * health.flight_hours),
    ("ema_health_timestamp", "End of the latest test.", "seconds",
     lambda health: stamp_from_message(health.header.stamp) * 1e-9),
)  # fmt: skip
"""Gauges of actuators: name, documentation, unit, and value of a health."""

_OF_STATUS: Final = (
    ("ema_samples_lost", "Missing samples of telemetry.", {(): "samples_lost"}),
    ("ema_windows_dropped", "Windows dropped because later windows were waiting.",
     {(): "windows_dropped"}),
    ("ema_estimates", "Estimates by verdict.",
     {("valid",): "estimates_valid", ("refused",): "estimates_invalid"}),
)  # fmt: skip
"""Counters of actuators: name, documentation, and fields of TelemetryStatus by verdict."""


@dataclass
class _Actuator:
    """Latest data of an actuator."""

    serial_number: str = ""
    model: str = ""
    health: Health | None = None
    baseline: BaselineStatus | None = None
    status: TelemetryStatus | None = None
    computing: list[int] = field(default_factory=lambda: [0] * (len(COMPUTING_BOUNDS_S) + 1))
    computing_s: float = 0.0


@dataclass
class _Node:
    """Latest status of a node."""

    received_s: float = 0.0
    """Time of its latest status [s]."""
    status: NodeStatus = field(default_factory=NodeStatus)
    """Latest status received while the node was configured."""


class Metrics(Collector):
    """Metrics of actuators, nodes and this process, collected on request.

    Thread-safe.

    Parameters
    ----------
    totals
        Function that returns the totals of the dashboard.
    """

    def __init__(self, totals: Callable[[], Totals]) -> None:
        self._totals = totals
        self._lock = threading.Lock()
        self._actuators: dict[tuple[str, str], _Actuator] = {}
        self._nodes: dict[str, _Node] = {}
        # Not the global registry: a process may have several dashboards.
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(self)
        ProcessCollector(registry=self._registry)

    def note(self, namespace: str, message: Any) -> None:
        """Update the metrics of an actuator with a description, estimate, health or baseline."""
        key = namespace.rstrip("/") or "/", message.actuator_id
        with self._lock:
            actuator = _latest(self._actuators, key, _Actuator)
            if actuator.serial_number != message.serial_number:
                actuator.serial_number = message.serial_number
                actuator.health = actuator.baseline = None
            if isinstance(message, ActuatorDescription):
                actuator.model = message.model
            elif isinstance(message, Health):
                actuator.health = message
            elif isinstance(message, BaselineStatus):
                actuator.baseline = message
            elif isinstance(message, FaultEstimate):
                taken_s = message.computing_time
                if math.isfinite(taken_s) and taken_s >= 0.0:
                    actuator.computing[bisect_left(COMPUTING_BOUNDS_S, taken_s)] += 1
                    actuator.computing_s += taken_s

    def note_node(self, namespace: str, status: NodeStatus) -> None:
        """Update the metrics of a node, and of its actuators, with its status."""
        with self._lock:
            node = _latest(self._nodes, status.node, _Node)
            node.received_s = time.time()
            if status.kind != NodeStatus.OTHER:
                node.status = status
            for telemetry in status.telemetry:
                key = namespace.rstrip("/") or "/", telemetry.actuator_id
                _latest(self._actuators, key, _Actuator).status = telemetry

    def rewind(self, time_ns: int) -> None:
        """Discard health later than ``time_ns``, to which the ROS time has jumped back."""
        with self._lock:
            for actuator in self._actuators.values():
                health = actuator.health
                if health and stamp_from_message(health.header.stamp) > time_ns:
                    actuator.health = None

    def exposition(self, _: Mapping[str, str], accept: str) -> Made:
        """Return all metrics in a format that the client accepts: OpenMetrics or Prometheus."""
        try:
            encode, content_type = choose_encoder(accept)
        except TypeError:
            # The requested version is not a number.
            encode, content_type = choose_encoder("")
        return Made(encode(self._registry), content_type)

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics except the metrics of the process."""
        with self._lock:
            metrics = [*_of_actuators(self._actuators), *_of_nodes(self._nodes)]
        yield from metrics
        yield from _of_dashboard(self._totals())


def _of_nodes(nodes: Mapping[str, _Node]) -> Iterator[Metric]:
    for metric, documentation, kind, counter in _OF_NODES:
        family = CounterMetricFamily(metric, documentation, labels=["node"])
        for name, node in nodes.items():
            if node.status.kind == kind:
                family.add_metric((_text(name),), getattr(node.status, counter))
        yield family
    received = _gauge(
        "ema_node_heard_timestamp", "Time of the latest status of a node.", "seconds", "node"
    )
    for name, node in nodes.items():
        received.add_metric((_text(name),), node.received_s)
    yield received


def _of_actuators(actuators: Mapping[tuple[str, str], _Actuator]) -> Iterator[Metric]:
    labelled = [(tuple(map(_text, names)), actuator) for names, actuator in actuators.items()]
    healths = [(labels, item.health) for labels, item in labelled if item.health is not None]
    about = InfoMetricFamily(
        "ema_actuator", "Serial number of the installed unit.", labels=_ACTUATOR
    )
    for labels, actuator in labelled:
        unit = {"serial_number": _text(actuator.serial_number), "model": _text(actuator.model)}
        about.add_metric(labels, unit)
    yield about
    for name, documentation, unit, value in _OF_HEALTH:
        family = _gauge(name, documentation, unit)
        for labels, health in healths:
            family.add_metric(labels, value(health))
        yield family
    yield from _of_baselines(
        [(labels, item.baseline) for labels, item in labelled if item.baseline]
    )
    life = _gauge(
        "ema_remaining_useful_life",
        "Remaining useful life by quantile; NaN if unknown.",
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
        for labels, actuator in labelled:
            for label, counter in keys.items():
                if actuator.status is not None:
                    family.add_metric((*labels, *label), getattr(actuator.status, counter))
        yield family
    latency = _gauge(
        "ema_estimate_latency", "Time from the end of the latest window to its estimate.", "seconds"
    )
    computing = HistogramMetricFamily(
        "ema_estimate_computing", "Computing time of an estimate.", labels=_ACTUATOR, unit="seconds"
    )
    for labels, actuator in labelled:
        if actuator.status is not None:
            latency.add_metric(labels, actuator.status.latency)
        if any(actuator.computing):
            counts = zip(_BOUNDS, accumulate(actuator.computing), strict=True)
            computing.add_metric(labels, list(counts), actuator.computing_s)
    yield from (latency, computing)


def _of_baselines(baselines: Sequence[tuple[tuple[str, ...], BaselineStatus]]) -> Iterator[Metric]:
    learning = _gauge("ema_learning", "Whether healthy records are still collected: 1 or 0.", "")
    records = _gauge("ema_baseline_records", "Healthy records of a joint.", "")
    smallest = _gauge(
        "ema_baseline_smallest_change",
        "Smallest relative change of friction that would show; NaN if unknown.",
        "ratio",
        *(*_ACTUATOR, "day"),
    )
    for labels, status in baselines:
        learning.add_metric(labels, status.state == BaselineStatus.LEARNING)
        records.add_metric(labels, status.records)
        smallest.add_metric((*labels, "same"), status.detectable_same_day)
        smallest.add_metric((*labels, "other"), status.detectable_other_day)
    yield from (learning, records, smallest)


def _of_dashboard(totals: Totals) -> Iterator[Metric]:
    for name, documentation, value in (
        ("messages_sent", "Messages sent to clients.", totals.messages),
        ("messages_dropped", "Messages dropped for slow clients.", totals.dropped),
        ("requests_refused", "Requests refused.", totals.refused),
        ("sent_bytes", "Size of the messages sent.", totals.sent_bytes),
    ):
        unit = "bytes" if name == "sent_bytes" else ""
        yield CounterMetricFamily(f"ema_dashboard_{name}", documentation, value, unit=unit)
    yield GaugeMetricFamily("ema_dashboard_clients", "Connected clients.", totals.clients)
    yield GaugeMetricFamily(
        "ema_dashboard_waiting_bytes",
        "Size of the messages waiting for clients.",
        totals.waiting_bytes,
        unit="bytes",
    )


def _gauge(name: str, documentation: str, unit: str, *labels: str) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, documentation, labels=labels or _ACTUATOR, unit=unit)


def _text(text: str) -> str:
    """Return a string from the graph without characters that UTF-8 cannot encode."""
    return text.encode(errors="replace").decode()


def _latest(items: dict[_Key, _Value], key: _Key, new: Callable[[], _Value]) -> _Value:
    """Return an item, creating it if missing, and mark it as most recently updated.

    With more than ``MOST_KEPT`` items, the least recently updated item is deleted.
    """
    items[key] = item = items.pop(key) if key in items else new()
    if len(items) > MOST_KEPT:
        del items[next(iter(items))]
    return item
