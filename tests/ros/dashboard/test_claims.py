# SPDX-License-Identifier: Apache-2.0
"""What a monitor said is shown for as long as it is good and the monitor is heard."""

import pytest

from ema_core.levels import OK, STALE
from ema_interfaces.msg import Health, NodeStatus
from ema_ros import claims, topics
from ema_ros.stamps import stamp_to_message

from ...waiting import wait_for
from .session import DashboardSession


def claimed(level: int, good_for_s: float, now_ns: int) -> Health:
    message = Health(actuator_id="flap", serial_number="7", level=level, author="/ema/monitor")
    message.header.stamp = message.measured = stamp_to_message(now_ns)
    message.good_until = stamp_to_message(now_ns + round(good_for_s * 1e9))
    return message


@pytest.mark.parametrize("how", ["silent", "expired"])
def test_who_comes_after_a_monitor_has_gone_receives_nothing_that_it_stated(
    session: DashboardSession, monkeypatch: pytest.MonkeyPatch, how: str
):
    monkeypatch.setattr(claims, "SILENT_S", 1.0)
    output = session.source.create_publisher(Health, "health", topics.LATCHED)
    status = session.source.create_publisher(NodeStatus, "node_status", topics.STATE)
    report = NodeStatus(node="/ema/monitor")
    node = session.dashboard()
    viewer = session.view(node, "/ema/health")

    def is_shown(level: int, *, reported: bool = False) -> bool:
        if reported:
            status.publish(report)
        received = viewer.received["/ema/health"]
        return bool(received) and received[-1][1].level == level

    wait_for(lambda: status.publish(report) or node._claims._reported_s, "the monitor is heard")
    now_ns = session.source.get_clock().now().nanoseconds
    output.publish(claimed(OK, 1000.0 if how == "silent" else 0.5, now_ns))
    if how == "silent":
        wait_for(lambda: is_shown(OK, reported=True), "OK while it reports")
    wait_for(lambda: is_shown(STALE), "STALE")
    late = session.view(node, "/ema/health").wait_for("/ema/health")
    assert {(message.level, message.last_level) for message in late} == {(STALE, OK)}
    lines = node._metrics.exposition({}, "").content.decode().splitlines()
    [line] = [line for line in lines if line.startswith("ema_health_level{")]
    assert line.endswith("3.0")
    if how == "silent":
        wait_for(lambda: is_shown(OK, reported=True), "OK once it reports again")
