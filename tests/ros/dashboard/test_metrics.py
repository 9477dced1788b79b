# SPDX-License-Identifier: Apache-2.0
"""The dashboard exposes metrics of actuators and nodes, and the Grafana layout queries them."""

import json
import math
import re
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest
from ament_index_python.packages import get_package_share_directory
from prometheus_client import parser as plain_text
from prometheus_client.metrics_core import Metric
from prometheus_client.openmetrics import parser as open_metrics
from rosgraph_msgs.msg import Clock

from ema_dashboard.hub import Totals
from ema_dashboard.metrics import MOST_KEPT, Metrics
from ema_interfaces.msg import (
    ActuatorDescription,
    BaselineStatus,
    FaultEstimate,
    Health,
    NodeStatus,
    TelemetryStatus,
)
from ema_ros import topics

from ...waiting import wait_for
from .session import DashboardSession

OPEN_METRICS = "application/openmetrics-text; version=1.0.0"
GRAFANA = Path(get_package_share_directory("ema_dashboard"), "layouts", "grafana.json")
OWN = Totals(2, 30, 4000, 50, 6, 7)
BASE_UNITS = ("_seconds", "_ratio", "_bytes", "_info", "_total", "_bucket", "_count", "_sum")
LABELS = (
    "namespace",
    "actuator_id",
    "serial_number",
    "model",
    "quantile",
    "day",
    "verdict",
    "le",
    "node",
)
WITHOUT_UNIT = {
    *("ema_health_level", "ema_dashboard_clients", "ema_learning", "ema_baseline_records")
}


def parsed(text: bytes, accept: str = OPEN_METRICS) -> dict[str, Metric]:
    """Return the metric families in a text, parsed by the client of its format, by name."""
    parser = open_metrics if accept == OPEN_METRICS else plain_text
    return {family.name: family for family in parser.text_string_to_metric_families(text.decode())}


def values(families: dict[str, Metric]) -> dict[tuple[str, ...], float]:
    """Return values by name of the sample and values of its labels, in the order of LABELS."""
    return {
        (sample.name, *(sample.labels[name] for name in LABELS if name in sample.labels)): (
            sample.value
        )
        for family in families.values()
        for sample in family.samples
    }


def health(actuator_id: str = "flap", serial: str = "7", sec: int = 50) -> Health:
    message = Health(actuator_id=actuator_id, serial_number=serial, level=1, health_index=0.75)
    message.header.stamp.sec, message.flight_hours, message.confidence = sec, 100.0, 0.5
    message.rul.known, message.rul.hours_05, message.rul.hours_50 = True, 10.0, 20.0
    message.rul.hours_95 = math.inf
    return message


def estimate(computing_s: float, actuator_id: str = "flap", serial: str = "7") -> FaultEstimate:
    return FaultEstimate(actuator_id=actuator_id, serial_number=serial, computing_time=computing_s)


TELEMETRY_STATUS = TelemetryStatus(
    actuator_id="flap",
    samples_lost=3,
    windows_dropped=2,
    estimates_valid=5,
    estimates_invalid=1,
    latency=0.25,
)
BASELINE_STATUS = BaselineStatus(
    actuator_id="flap",
    serial_number="7",
    records=4,
    detectable_same_day=0.05,
    detectable_other_day=0.2,
)
NODE_STATUS = (
    NodeStatus(
        node="/ema/monitor",
        kind=NodeStatus.MONITOR,
        telemetry=[TELEMETRY_STATUS],
        windows_dropped=4,
        follow_ups_dropped=1,
    ),
    NodeStatus(
        node="/ema/recorder", kind=NodeStatus.RECORDER, messages_lost=8, messages_without_room=9
    ),
    NodeStatus(node="/ema/bridge", kind=NodeStatus.BRIDGE, samples_lost=11),
)


@pytest.fixture
def metrics() -> Metrics:
    """Return metrics that have received a message of each kind."""
    noted = Metrics(lambda: OWN)
    noted.note("/ema", ActuatorDescription(actuator_id="flap", serial_number="7", model="F-1"))
    for computing_s in (0.01, 0.07, 0.09, 99.0, math.nan):
        noted.note("/ema", estimate(computing_s))
    noted.note("/ema", health())
    noted.note("/ema", BASELINE_STATUS)
    for status in NODE_STATUS:
        noted.note_node("/ema", status)
    return noted


def exposed(metrics: Metrics, accept: str = OPEN_METRICS) -> dict[str, Metric]:
    return parsed(metrics.exposition({}, accept).content, accept)


def test_metrics_of_a_graph_reach_a_client(session: DashboardSession, web):
    healths = session.source.create_publisher(Health, "health", topics.ALIVE)
    estimates = session.source.create_publisher(FaultEstimate, "fault_estimate", topics.STATE)
    statuses = session.source.create_publisher(NodeStatus, "node_status", topics.STATE)
    clock = session.source.create_publisher(Clock, "/clock", 1)
    node = session.dashboard()

    def read() -> dict[tuple[str, ...], float]:
        headers = {"Accept": OPEN_METRICS}
        return values(parsed(web.get(f"{node.address}metrics", headers=headers)[2]))

    healths.publish(health())
    index = ("ema_health_index_ratio", "/ema", "flap")
    wait_for(lambda: read().get(index) == 0.75, "health")
    # A message that is not latched is lost before the subscription.
    wait_for(lambda: estimates.get_subscription_count(), "a subscription")
    estimates.publish(estimate(0.3))
    count = ("ema_estimate_computing_seconds_count", "/ema", "flap")
    wait_for(lambda: read().get(count) == 1, "the estimate")
    wait_for(lambda: statuses.get_subscription_count(), "a subscription")
    for status in NODE_STATUS:
        statuses.publish(status)
    wait_for(lambda: ("ema_windows_dropped_total", "/ema", "flap") in read(), "the status")
    assert read()["ema_node_heard_timestamp_seconds", "/ema/monitor"] > 1.7e9
    wait_for(lambda: clock.get_subscription_count(), "a subscription")
    seconds = cycle((60, 40))

    def has_jumped_back() -> bool:
        # Messages are sent by best effort and may be lost.
        clock.publish(_clock(next(seconds)))
        return index not in read()

    wait_for(has_jumped_back, "health of the future is forgotten")


def _clock(sec: int) -> Clock:
    message = Clock()
    message.clock.sec = sec
    return message


def test_metrics_are_the_values_of_messages_in_base_units(metrics):
    samples = values(exposed(metrics))
    flap = ("/ema", "flap")
    assert samples["ema_actuator_info", *flap, "7", "F-1"] == 1
    assert samples["ema_health_index_ratio", *flap] == 0.75
    assert samples["ema_health_confidence_ratio", *flap] == 0.5
    assert samples["ema_health_level", *flap] == 1
    life = "ema_remaining_useful_life_seconds"
    lives = [samples[life, *flap, quantile] for quantile in ("0.05", "0.5", "0.95")]
    assert lives == [36_000.0, 72_000.0, math.inf]
    assert samples["ema_service_time_seconds", *flap] == 360_000.0
    assert samples["ema_health_timestamp_seconds", *flap] == 50.0
    assert samples["ema_learning", *flap] == 1
    assert samples["ema_baseline_records", *flap] == 4
    assert samples["ema_baseline_smallest_change_ratio", *flap, "same"] == 0.05
    assert samples["ema_baseline_smallest_change_ratio", *flap, "other"] == 0.2
    assert samples["ema_estimate_latency_seconds", *flap] == 0.25
    assert samples["ema_estimates_total", *flap, "valid"] == 5
    assert samples["ema_estimates_total", *flap, "refused"] == 1
    assert samples["ema_samples_lost_total", *flap] == 3
    assert samples["ema_windows_dropped_total", *flap] == 2
    assert samples["ema_monitor_windows_dropped_total", "/ema/monitor"] == 4
    assert samples["ema_monitor_refusals_dropped_total", "/ema/monitor"] == 0
    assert samples["ema_monitor_follow_ups_dropped_total", "/ema/monitor"] == 1
    assert samples["ema_recorder_messages_lost_total", "/ema/recorder"] == 8
    assert samples["ema_recorder_messages_without_room_total", "/ema/recorder"] == 9
    assert samples["ema_bridge_samples_lost_total", "/ema/bridge"] == 11
    dashboard = [
        samples[f"ema_dashboard_{name}",]
        for name in ("clients", "messages_sent_total", "sent_bytes_total", "waiting_bytes")
    ]
    assert dashboard == [2, 30, 4000, 50]
    assert samples["ema_dashboard_messages_dropped_total",] == 6
    assert samples["process_resident_memory_bytes",] > 1e6


@pytest.mark.parametrize("accept", [OPEN_METRICS, "text/plain"])
def test_metrics_follow_the_conventions_for_names(metrics, accept):
    families = exposed(metrics, accept)
    assert len(families) > 20
    for family in families.values():
        assert family.documentation.endswith("."), family.name
        for sample in family.samples:
            name = sample.name
            assert re.fullmatch(r"(ema|process)(_[a-z]+)+", name)
            if name.startswith("ema") and name not in WITHOUT_UNIT:
                assert name.endswith(BASE_UNITS), name
            assert (family.type == "counter") == name.endswith("_total"), name


def test_node_that_is_cleaned_up_keeps_its_counts(metrics):
    metrics.note_node("/ema", NodeStatus(node="/ema/recorder"))
    assert values(exposed(metrics))["ema_recorder_messages_lost_total", "/ema/recorder"] == 8


def test_another_unit_has_no_health_yet(metrics):
    metrics.note("/ema", estimate(0.1, serial="8"))
    samples = values(exposed(metrics))
    assert ("ema_actuator_info", "/ema", "flap", "8", "F-1") in samples
    assert ("ema_health_index_ratio", "/ema", "flap") not in samples
    assert samples["ema_estimate_computing_seconds_count", "/ema", "flap"] == 5


def test_hostile_names_do_not_break_the_format_or_exhaust_memory(metrics):
    evil = 'a"} 1\nema_health_level{x="\\\udc80'
    metrics.note("/ema", health(evil))
    samples = values(exposed(metrics))
    assert samples["ema_health_level", "/ema", evil.replace("\udc80", "?")] == 1
    for number in range(2 * MOST_KEPT):
        metrics.note("/ema", health(f"actuator{number}"))
        bridge = NodeStatus(node=f"{evil}{number}", kind=NodeStatus.BRIDGE, samples_lost=1)
        metrics.note_node("/ema", bridge)
    names = [name for name, *_ in values(exposed(metrics))]
    assert names.count("ema_health_level") == MOST_KEPT
    assert names.count("ema_node_heard_timestamp_seconds") == MOST_KEPT


@pytest.mark.parametrize("accept", ["", "application/openmetrics-text; version=x", "a;=,;"])
def test_clients_of_other_formats_get_plain_text(metrics, accept):
    made = metrics.exposition({}, accept)
    assert made.content_type.startswith("text/plain; version=0.0.4")
    assert "ema_health_level" in parsed(made.content, "text/plain")


def panels() -> list[dict[str, Any]]:
    return json.loads(GRAFANA.read_text(encoding="utf-8"))["panels"]


def queries() -> list[str]:
    content = json.loads(GRAFANA.read_text(encoding="utf-8"))
    variables = [item["definition"] for item in content["templating"]["list"][1:]]
    return [*variables, *(target["expr"] for panel in panels() for target in panel["targets"])]


def test_grafana_queries_existing_metrics_and_labels(metrics):
    labels = {
        sample.name: set(sample.labels)
        for family in exposed(metrics).values()
        for sample in family.samples
    }
    asked = set()
    for query in queries():
        selected = re.findall(r"\b((?:ema|process)_\w+)(?:\{([^}]*)\})?", query)
        assert selected, query
        for name, selectors in selected:
            assert name in labels, query
            asked.add(name)
            assert set(re.findall(r"(\w+)=", selectors)) <= labels[name], query
        (grouped,) = re.findall(r" by \(([^)]*)\)", query) or [""]
        assert set(grouped.split(", ")) - {""} <= labels[selected[0][0]], query
    # Each counter of losses is shown.
    assert {name for name in labels if "_lost" in name or "_dropped" in name} <= asked
