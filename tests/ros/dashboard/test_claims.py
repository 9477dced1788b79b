# SPDX-License-Identifier: Apache-2.0
"""Claims of a monitor are shown while they are valid and the monitor is alive."""

import pytest

from ema_core.levels import OK, STALE
from ema_interfaces.msg import Health, NodeStatus
from ema_ros import topics
from ema_ros.stamps import stamp_to_message

from ...waiting import wait_for
from .session import DashboardSession


def claimed(level: int, good_for_s: float, now_ns: int) -> Health:
    message = Health(actuator_id="flap", serial_number="7", level=level, author="/ema/monitor")
    message.header.stamp = message.tested = stamp_to_message(now_ns)
    message.good_until = stamp_to_message(now_ns + round(good_for_s * 1e9))
    return message


@pytest.mark.parametrize("how", ["silent", "expired"])
def test_late_client_receives_stale_after_a_monitor_has_gone(session: DashboardSession, how: str):
    output = session.source.create_publisher(Health, "health", topics.ALIVE)
    status = session.source.create_publisher(NodeStatus, "node_status", topics.STATE)
    node = session.dashboard()
    viewer = session.view(node, "/ema/health")

    def is_shown(level: int) -> bool:
        # The status of a monitor, published by another node, does not keep the monitor alive.
        status.publish(NodeStatus(node="/ema/monitor", kind=NodeStatus.MONITOR))
        received = viewer.received["/ema/health"]
        return bool(received) and received[-1][1].level == level

    now_ns = session.source.get_clock().now().nanoseconds
    stated = claimed(OK, 1000.0 if how == "silent" else 0.5, now_ns)
    output.publish(stated)
    if how == "silent":
        wait_for(lambda: is_shown(OK), "OK while it is alive")
        session.source.destroy_publisher(output)
    wait_for(lambda: is_shown(STALE), "STALE")
    late = session.view(node, "/ema/health").wait_for("/ema/health")
    assert {(message.level, message.last_level) for message in late} == {(STALE, OK)}
    lines = node._metrics.exposition({}, "").content.decode().splitlines()
    [line] = [line for line in lines if line.startswith("ema_health_level{")]
    assert line.endswith("3.0")
    if how == "silent":
        output = session.source.create_publisher(Health, "health", topics.ALIVE)
        wait_for(lambda: is_shown(OK), "OK once it is alive again")
