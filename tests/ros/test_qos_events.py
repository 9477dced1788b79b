"""What another process is told by the middleware of the quality of service of our nodes."""

from collections import defaultdict
from typing import Any

import pytest
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy

from ema_ros.topics import ACTUATOR_TOPICS, MONITOR_TOPICS, NAMESPACE, SYSTEM_TOPICS

from .graph import Graph

WANTS_TOO_MUCH = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OFFERS_LEAST = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
OF_THE_ACTUATOR = {"telemetry", "joint_states"}
MADE_BY_THE_MONITOR = {"fault_estimate"}


def is_latched(qos: QoSProfile) -> bool:
    return qos.durability == DurabilityPolicy.TRANSIENT_LOCAL


@pytest.mark.slow
def test_each_topic_tells_a_subscriber_that_wants_more_than_is_offered():
    offered = {**ACTUATOR_TOPICS, **MONITOR_TOPICS}
    refused: dict[str, set[QoSPolicyKind]] = defaultdict(set)
    with Graph() as graph:

        def subscribe(topic: str) -> Any:
            return graph.node.create_subscription(
                offered[topic][0],
                f"{NAMESPACE}/{topic}",
                lambda _: None,
                WANTS_TOO_MUCH,
                event_callbacks=SubscriptionEventCallbacks(
                    incompatible_qos=lambda info: refused[topic].add(info.last_policy_kind)
                ),
            )

        kept = [subscribe(topic) for topic in offered]
        graph.start("monitor")
        graph.start("actuator")
        volatile = {topic for topic, (_, qos) in offered.items() if not is_latched(qos)}
        assert volatile == OF_THE_ACTUATOR | MADE_BY_THE_MONITOR
        graph.wait_for(lambda: volatile <= set(refused), "the events")
        graph.wait_for(lambda: len(graph.estimates) > 1, "estimates all the same")
        assert dict(refused) == {topic: {QoSPolicyKind.DURABILITY} for topic in volatile}
        for node, topics in (("actuator", OF_THE_ACTUATOR), ("monitor", MADE_BY_THE_MONITOR)):
            told = [
                line for line in graph.log(node).read_text().split("\n") if "DURABILITY" in line
            ]
            assert all(any(f"'{topic}'" in line for line in told) for topic in topics), told
        assert kept


@pytest.mark.slow
def test_what_publishes_too_little_for_telemetry_is_told_and_named_in_the_status():
    read = {
        topic: message
        for topic, (message, _) in {**ACTUATOR_TOPICS, **SYSTEM_TOPICS}.items()
        if topic not in ("simulated_faults", "joint_states")
    }
    strict = {topic for topic in read if topic in ("telemetry", "measured_causes")}
    matched: set[str] = set()
    refused: dict[str, set[QoSPolicyKind]] = defaultdict(set)
    with Graph() as graph:

        def publish(topic: str) -> Any:
            return graph.node.create_publisher(
                read[topic],
                f"{NAMESPACE}/{topic}",
                OFFERS_LEAST,
                event_callbacks=PublisherEventCallbacks(
                    incompatible_qos=lambda info: refused[topic].add(info.last_policy_kind),
                    matched=lambda _: matched.add(topic),
                ),
            )

        kept = [publish(topic) for topic in read]
        graph.start("monitor")
        graph.wait_for(lambda: matched == set(read) - strict, "what is latched to be received")
        graph.wait_for(lambda: strict <= set(refused), "the events")
        assert {topic: refused[topic] for topic in strict} == {
            topic: {QoSPolicyKind.RELIABILITY} for topic in strict
        }

        def peers() -> tuple[int, str]:
            return graph.status.get("/ema/monitor: peers", (0, "", {}))[:2]

        graph.wait_for(
            lambda: (
                peers()
                == (
                    1,
                    "not received: "
                    + ", ".join(
                        f"{NAMESPACE}/{topic} of /test/observer "
                        "(Best effort publisher and reliable subscription)"
                        for topic in sorted(strict)
                    ),
                )
            ),
            "the warning",
        )
        for publisher in kept:
            graph.node.destroy_publisher(publisher)
        graph.wait_for(lambda: peers()[0] == 0, "the end of the warning")
