"""What a monitor said is shown for as long as it is good and the monitor is heard."""

from collections.abc import Sequence

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from ema_core.levels import OK, STALE
from ema_interfaces.msg import Health
from ema_ros import topics
from ema_ros.stamps import stamp_to_message

from ...waiting import wait_for
from .session import DashboardSession


def claimed(level: int, good_for_s: float, now_ns: int) -> Health:
    message = Health(actuator_id="flap", serial_number="7", level=level, author="/ema/monitor")
    message.header.stamp = message.measured = stamp_to_message(now_ns)
    message.good_until = stamp_to_message(now_ns + round(good_for_s * 1e9))
    return message


def levels(messages: Sequence[tuple[int, Health]]) -> list[tuple[int, int]]:
    return [(message.level, message.last_level) for _, message in messages]


@pytest.mark.slow
@pytest.mark.parametrize("how", ["silent", "expired"])
def test_who_comes_after_a_monitor_has_gone_is_told_nothing_that_it_said(
    session: DashboardSession, how: str
):
    output = session.source.create_publisher(Health, "health", topics.LATCHED)
    status = session.source.create_publisher(DiagnosticArray, "/diagnostics", topics.STATE)
    node = session.dashboard()
    viewer = session.view(node, "/ema/health")
    wait_for(lambda: "/diagnostics" in node._inputs, "the dashboard listens")
    report = DiagnosticArray(status=[DiagnosticStatus(name="/ema/monitor: flap health")])
    wait_for(lambda: status.publish(report) or node._claims._heard_s, "the monitor is heard")
    now_ns = session.source.get_clock().now().nanoseconds
    output.publish(claimed(OK, 1000.0 if how == "silent" else 0.5, now_ns))
    viewer.wait_for("/ema/health", 2)
    assert levels(viewer.heard["/ema/health"]) == [(OK, STALE), (STALE, OK)]
    late = session.view(node, "/ema/health")
    late.wait_for("/ema/health")
    assert levels(late.heard["/ema/health"]) == [(STALE, OK)]
    lines = node._metrics.exposition({}, "").content.decode().splitlines()
    [line] = [line for line in lines if line.startswith("ema_health_level{")]
    assert line.endswith("3.0")
    if how == "silent":
        status.publish(report)
        viewer.wait_for("/ema/health", 3)
        assert viewer.heard["/ema/health"][-1][1].level == OK
