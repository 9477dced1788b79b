# SPDX-License-Identifier: Apache-2.0
"""Published messages reach the clients of the dashboard unchanged."""

import array
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from ema_bags.message_type import type_name
from ema_bags.schema import schema_text
from ema_dashboard.known_topics import known_topics
from ema_interfaces.msg import Health, TelemetryBlock, WindowFit
from ema_ros import topics

from ...waiting import wait_for

PUBLISHED = {
    **topics.ACTUATOR_TOPICS,
    **topics.SYSTEM_TOPICS,
    **topics.MONITOR_TOPICS,
    **topics.PLAYER_TOPICS,
    **topics.NODE_TOPICS,
}
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def health(actuator_id: str, index: float = 0.75, sec: int = 10) -> Health:
    message = Health(actuator_id=actuator_id, serial_number="1", level=1, health_index=index)
    message.header.stamp.sec = sec
    message.dominant_fault = "friction"
    message.rul.hours_50 = 123.25
    message.cycles = 2**63
    return message


def plain(value: Any) -> Any:
    """Return a message, decoded by ROS or by its schema, as plain values."""
    if hasattr(value, "get_fields_and_field_types"):
        names = value.get_fields_and_field_types()
        return {name: plain(getattr(value, name)) for name in names}
    if hasattr(value, "__slots__") and not isinstance(value, str | bytes | array.array):
        return {name: plain(getattr(value, name)) for name in value.__slots__ if name[0] != "_"}
    if isinstance(value, bytes) and len(value) == 1:
        return value[0]
    if isinstance(value, str | int | float | bool):
        return value
    return [plain(item) for item in value]


def test_every_topic_is_a_channel_with_the_schema_of_its_messages(session):
    for name, (kind, qos) in PUBLISHED.items():
        session.source.create_publisher(kind, name, qos)
    session.source.create_publisher(Clock, "/clock", BEST_EFFORT)
    viewer = session.view(session.dashboard())
    expected = {topic.name: topic.message_class for topic in known_topics(["/ema"])}
    assert {*PUBLISHED, "unit_history"} == {
        name.removeprefix("/ema/") for name in expected if name.startswith("/ema/")
    }
    wait_for(lambda: viewer.channels.keys() >= expected.keys(), "all channels")
    for name, kind in expected.items():
        channel = viewer.channels[name]
        assert channel["encoding"] == "cdr"
        assert channel["schemaEncoding"] == "ros2msg"
        assert channel["schemaName"] == type_name(kind)
        assert channel["schema"] == schema_text(type_name(kind))
    assert viewer.reported[0]["capabilities"] == []  # clients change nothing


def test_values_arrive_as_they_were_published(session):
    telemetry = session.source.create_publisher(TelemetryBlock, "telemetry", topics.STREAM)
    fit = session.source.create_publisher(WindowFit, "window_fit", topics.LATCHED)
    output = session.source.create_publisher(Health, "health", topics.ALIVE)
    status = session.source.create_publisher(DiagnosticArray, "/diagnostics", 10)
    names = ("/ema/telemetry", "/ema/window_fit", "/ema/health", "/diagnostics")
    viewer = session.view(session.dashboard(), *names)
    for publisher in (telemetry, status):  # received only while a client subscribes
        wait_for(lambda publisher=publisher: publisher.get_subscription_count(), "subscription")
    samples = array.array("d", [0.1, -1e300, 5e-324])
    block = TelemetryBlock(actuator_id="flap", sample_period=1e-4, first_index=2**62)
    block.position = block.speed = block.current = block.command = samples
    window = WindowFit(actuator_id="flap", current=array.array("f", [0.5, -0.25]))
    array_of_status = DiagnosticArray(status=[DiagnosticStatus(level=b"\x02", name="a: b")])
    for publisher, message in (
        (telemetry, block),
        (fit, window),
        (output, health("flap")),
        (status, array_of_status),
    ):
        publisher.publish(message)
    for name, message in zip(names, (block, window, health("flap"), array_of_status), strict=True):
        # Compare texts, as NaN differs from NaN. The dashboard also publishes on /diagnostics.
        viewer.wait_until_received(
            name, lambda received, sent=message: str(plain(received)) == str(plain(sent))
        )


def test_late_client_alone_receives_the_latest_message_of_each_actuator(session):
    outputs = [session.source.create_publisher(Health, "health", topics.ALIVE) for _ in range(2)]
    node = session.dashboard()
    early = session.view(node, "/ema/health")
    messages = (health("left", 0.5), health("left", 0.25), health("right", 0.75))
    for number, message in enumerate(messages):
        outputs[number // 2].publish(message)
        # A message that arrives during the subscription may be delivered twice, but is not lost.
        early.wait_until_received(
            "/ema/health",
            lambda received, sent=messages[number]: str(plain(received)) == str(plain(sent)),
        )
    before = len(early.received["/ema/health"])
    late = session.view(node, "/ema/health")
    latest = {(item.actuator_id, item.health_index) for item in late.wait_for("/ema/health", 2)}
    assert latest == {("left", 0.25), ("right", 0.75)}
    outputs[1].publish(health("right", 0.125))
    late.wait_for("/ema/health", 3)
    assert len(early.wait_for("/ema/health", before + 1)) == before + 1
    late.unsubscribe_from("/ema/health")
    late.subscribe_to("/ema/health")
    late.wait_for("/ema/health", 5)


def test_telemetry_is_received_only_while_a_client_subscribes(session):
    output = session.source.create_publisher(TelemetryBlock, "telemetry", topics.STREAM)
    node = session.dashboard()
    viewer = session.view(node)
    wait_for(lambda: "/ema/telemetry" in viewer.channels, "the channel")
    assert output.get_subscription_count() == 0
    viewer.subscribe_to("/ema/telemetry")
    wait_for(output.get_subscription_count, "a subscription")
    viewer.close()
    wait_for(lambda: not output.get_subscription_count(), "the subscription to end")


def test_several_namespaces_are_shown(session):
    second_source = session.node("other", namespace="/second")
    for node, index in ((session.source, 0.25), (second_source, 0.5)):
        node.create_publisher(Health, "health", topics.ALIVE).publish(health("flap", index))
    viewer = session.view(
        session.dashboard(namespaces=["/ema", "/second"]), "/ema/health", "/second/health"
    )
    # A message that arrives during the subscription may be delivered twice.
    first, second = viewer.wait_for("/ema/health")[0], viewer.wait_for("/second/health")[0]
    assert (first.health_index, second.health_index) == (0.25, 0.5)


def test_log_times_follow_the_clock_and_a_jump_back_drops_later_messages(session):
    clock = session.source.create_publisher(Clock, "/clock", BEST_EFFORT)
    outputs = [session.source.create_publisher(Health, "health", topics.ALIVE) for _ in range(2)]
    node = session.dashboard()
    viewer = session.view(node, "/clock", "/ema/health")

    def tick(sec: int) -> None:
        time = Clock()
        time.clock.sec = sec
        received = viewer.received["/clock"]

        def ticked() -> bool:
            clock.publish(time)
            return bool(received) and received[-1][1].clock.sec == sec

        wait_for(ticked, f"/clock at {sec} s")

    tick(50)
    outputs[0].publish(health("left", sec=10))
    outputs[1].publish(health("right", sec=40))
    viewer.wait_for("/ema/health", 2)
    assert {time_ns for time_ns, _ in viewer.received["/ema/health"]} == {50 * 10**9}
    tick(20)
    late = session.view(node, "/ema/health")
    outputs[1].publish(health("right", 0.5, sec=15))

    def received() -> set[int]:
        return {message.header.stamp.sec for _, message in late.received["/ema/health"]}

    wait_for(lambda: received() >= {10, 15}, "what is left and what is new")
    assert received() == {10, 15}
