"""What is known of actuators and nodes as metrics, for Prometheus and others."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import accumulate
from typing import Final, NamedTuple

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

from ema_dashboard.documents import Made
from ema_dashboard.known_figures import COMPUTING_BOUNDS_S, ActuatorFigures, KnownFigures
from ema_interfaces.msg import Health
from ema_ros.stamps import stamp_from_message

_HOUR_S: Final = 3600.0
_ACTUATOR: Final = ("namespace", "actuator_id")
_BOUNDS: Final = (*map(str, COMPUTING_BOUNDS_S), "+Inf")


class _Counted(NamedTuple):
    """A counter, and where a status has it."""

    name: str
    documentation: str
    key: str
    task: str = ""


_OF_ACTUATORS: Final = (
    _Counted("ema_samples_lost", "Samples of telemetry that are missing.", "samples lost"),
    _Counted(
        "ema_windows_dropped", "Windows that had to give way to later ones.", "windows dropped"
    ),
)
_OF_NODES: Final = (
    _Counted(
        "ema_monitor_windows_dropped",
        "Windows of all actuators of a monitor that had to give way.",
        *("windows dropped", "input"),
    ),
    _Counted(
        "ema_monitor_refusals_dropped",
        "Refused windows of a monitor that nobody was told of.",
        *("refusals dropped", "input"),
    ),
    _Counted(
        "ema_monitor_follow_ups_dropped",
        "Forecasts and the like that a monitor left out.",
        *("follow-ups dropped", "identification"),
    ),
    _Counted(
        "ema_recorder_messages_lost",
        "Messages that did not reach a recorder.",
        *("lost messages", "recording"),
    ),
    _Counted(
        "ema_recorder_messages_without_room",
        "Messages that a recorder could not write.",
        *("messages without room", "recording"),
    ),
    _Counted("ema_bridge_samples_lost", "Samples missing at a bridge's input.", "lost", "input"),
)


class OwnFigures(NamedTuple):
    """What the dashboard did since it came up."""

    clients: int
    messages: int
    sent_bytes: int
    waiting_bytes: int
    dropped: int
    refused: int


class Metrics(KnownFigures, Collector):
    """Figures of actuators, nodes and this process, as metrics when they are asked for.

    Parameters
    ----------
    namespaces
        As of ``KnownFigures``.
    own
        Returns the figures of the dashboard.
    """

    def __init__(self, namespaces: Iterable[str], own: Callable[[], OwnFigures]) -> None:
        super().__init__(namespaces)
        self._own = own
        # One of its own: a process may have several dashboards.
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(self)
        ProcessCollector(registry=self._registry)

    def exposition(self, _: Mapping[str, str], accept: str) -> Made:
        """Return all metrics, in the format that a client accepts: OpenMetrics or Prometheus's."""
        try:
            encode, content_type = choose_encoder(accept)
        except TypeError:
            # It asks for a version that is no number.
            encode, content_type = choose_encoder("")
        return Made(encode(self._registry), content_type)

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics, those of the process apart."""
        with self.read() as (actuators, nodes):
            found = [*_of_actuators(actuators)]
            for counted in _OF_NODES:
                family = CounterMetricFamily(counted.name, counted.documentation, labels=["node"])
                for node, known in nodes.items():
                    _add(family, (node,), known.tasks.get(counted.task, {}).get(counted.key))
                found.append(family)
            heard = _gauge("ema_node_heard_timestamp", "When a node told.", "seconds", "node")
            for node, known in nodes.items():
                _add(heard, (node,), known.heard_s)
            found.append(heard)
        yield from found
        yield from _of_dashboard(self._own())


def _of_actuators(actuators: Mapping[tuple[str, str], ActuatorFigures]) -> Iterator[Metric]:
    about = InfoMetricFamily("ema_actuator", "The unit that is installed.", labels=_ACTUATOR)
    computing = HistogramMetricFamily(
        "ema_estimate_computing",
        "Time that an estimate took, from its window.",
        labels=_ACTUATOR,
        unit="seconds",
    )
    latency = _gauge(
        "ema_estimate_latency",
        "Time from the end of the latest window to its estimate.",
        "seconds",
        *_ACTUATOR,
    )
    estimates = CounterMetricFamily(
        "ema_estimates", "Estimates by their verdict.", labels=[*_ACTUATOR, "verdict"]
    )
    counters = [
        CounterMetricFamily(one.name, one.documentation, labels=_ACTUATOR) for one in _OF_ACTUATORS
    ]
    health = _HealthMetrics()
    for names, known in actuators.items():
        labels = tuple(map(_text, names))
        unit = {"serial_number": _text(known.serial_number), "model": _text(known.model)}
        about.add_metric(labels, unit)
        if any(known.computing):
            counts = zip(_BOUNDS, accumulate(known.computing), strict=True)
            computing.add_metric(labels, list(counts), known.computing_s)
        _add(latency, labels, known.status.get("latency [s]"))
        for verdict, key in (("valid", "estimates valid"), ("refused", "estimates invalid")):
            _add(estimates, (*labels, verdict), known.status.get(key))
        for family, counted in zip(counters, _OF_ACTUATORS, strict=True):
            _add(family, labels, known.status.get(counted.key))
        if known.health is not None:
            health.add(labels, known.health)
    yield from (about, *health.families, latency, computing, estimates, *counters)


class _HealthMetrics:
    """The metrics of health and life."""

    def __init__(self) -> None:
        self._index = _gauge("ema_health_index", "Health: 1 is as new, 0 at a limit.", "ratio")
        self._level = _gauge("ema_health_level", "Level: 0 OK, 1 WARN, 2 ERROR, 3 STALE.", "")
        self._confidence = _gauge("ema_health_confidence", "Confidence in the health.", "ratio")
        self._life = _gauge(
            "ema_remaining_useful_life",
            "Time of service that is left, by quantile; NaN when it is unknown.",
            "seconds",
            *(*_ACTUATOR, "quantile"),
        )
        self._service = _gauge("ema_service_time", "Time of service so far.", "seconds")
        self._tested = _gauge("ema_health_timestamp", "End of the latest test.", "seconds")
        self.families = (
            *(self._index, self._level, self._confidence),
            *(self._life, self._service, self._tested),
        )

    def add(self, labels: tuple[str, ...], health: Health) -> None:
        """Add those of an actuator."""
        self._index.add_metric(labels, health.health_index)
        self._level.add_metric(labels, health.level)
        self._confidence.add_metric(labels, health.confidence)
        life = health.rul
        for quantile, hours in (
            ("0.05", life.hours_05),
            ("0.5", life.hours_50),
            ("0.95", life.hours_95),
        ):
            self._life.add_metric((*labels, quantile), _HOUR_S * hours if life.known else math.nan)
        self._service.add_metric(labels, _HOUR_S * health.flight_hours)
        self._tested.add_metric(labels, stamp_from_message(health.header.stamp) * 1e-9)


def _of_dashboard(own: OwnFigures) -> Iterator[Metric]:
    for name, documentation, value in (
        ("messages_sent", "Messages sent to clients.", own.messages),
        ("messages_dropped", "Messages dropped for slow clients.", own.dropped),
        ("requests_refused", "Requests refused.", own.refused),
    ):
        yield CounterMetricFamily(f"ema_dashboard_{name}", documentation, value)
    sent = CounterMetricFamily(
        "ema_dashboard_sent_bytes", "Content of the messages sent.", own.sent_bytes, unit="bytes"
    )
    yield sent
    yield GaugeMetricFamily("ema_dashboard_clients", "Clients that are connected.", own.clients)
    yield GaugeMetricFamily(
        "ema_dashboard_waiting_bytes",
        "What waits for clients.",
        own.waiting_bytes,
        unit="bytes",
    )


def _gauge(name: str, documentation: str, unit: str, *labels: str) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, documentation, labels=labels or _ACTUATOR, unit=unit)


def _add(
    family: CounterMetricFamily | GaugeMetricFamily, labels: tuple[str, ...], value: float | None
) -> None:
    if value is not None:
        family.add_metric(labels, value)


def _text(words: str) -> str:
    """Return words of the graph as UTF-8 can write them."""
    return words.encode(errors="replace").decode()
