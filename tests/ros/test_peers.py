# SPDX-License-Identifier: Apache-2.0
"""A node reports peers that have disappeared; peers are nodes that share a topic with it."""

import contextlib
from collections import Counter
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from ema_ros.managed_node import ManagedNode
from ema_ros.peers import FRESH_S, Peers, incompatible_publishers, nodes_in_touch
from ema_ros.status import ERROR, OK, WARN

from ..waiting import wait_for
from .spinning import Spinning, ros_context


def test_disappeared_node_is_logged_once_and_a_warning_for_a_minute():
    peers = Peers("/ema/own")
    both = {"/ema/actuator", "/ema/recorder"}
    assert peers.update(both, Counter(both), 0.0) == []
    task = peers.task("unit", 0.0)
    assert (task.level, task.message) == (OK, "in contact with 2 nodes")
    assert task.values["present"] == "/ema/actuator, /ema/recorder"
    assert peers.update({"/ema/recorder"}, Counter({"/ema/recorder"}), 1.0) == ["/ema/actuator"]
    assert peers.update({"/ema/recorder"}, Counter({"/ema/recorder"}), 2.0) == []
    task = peers.task("unit", 1.0 + FRESH_S - 1e-6)
    assert (task.level, task.message) == (WARN, "lost contact with /ema/actuator")
    task = peers.task("unit", 1.0 + FRESH_S)
    assert (task.level, task.message) == (OK, "in contact with 1 node")
    assert task.values == {
        **{"present": "/ema/recorder", "gone": "/ema/actuator"},
        "nodes of the same name": 0,
    }


def test_returned_node_is_reported_again_when_it_disappears_again():
    peers = Peers("/ema/own")
    peers.update({"/ema/a", "/ema/b"}, Counter({"/ema/a", "/ema/b"}), 0.0)
    assert peers.update(set(), Counter(), 1.0) == ["/ema/a", "/ema/b"]
    assert peers.update({"/ema/a"}, Counter({"/ema/a"}), 2.0) == []
    assert peers.task("unit", 2.0).message == "lost contact with /ema/b"
    assert peers.update(set(), Counter(), 50.0) == ["/ema/a"]
    # By then /ema/b has been gone for more than a minute, /ema/a has not.
    assert peers.task("unit", 61.5).message == "lost contact with /ema/a"


def test_inactive_node_is_not_reported_as_gone():
    peers = Peers("/ema/own")
    peers.update({"/ema/a"}, Counter({"/ema/a"}), 0.0)
    assert peers.update(set(), Counter({"/ema/a", "/ema/stranger"}), 1.0) == []
    assert peers.task("unit", 1.0).values["present"] == "/ema/a"
    assert peers.update(set(), Counter({"/ema/stranger"}), 2.0) == ["/ema/a"]


def test_nodes_in_touch_share_namespace_and_a_topic(make_node: Callable[..., Node]):
    def node(name: str, namespace: str = "/ema") -> Node:
        return make_node(name, namespace=namespace)

    tested = node("own")
    tested.create_publisher(String, "out", 1)
    tested.create_subscription(String, "in", lambda _: None, 1)
    tested.create_subscription(String, "/clock", lambda _: None, 1)
    subscriber, publisher, sibling, unrelated, tool = (
        *(node(name) for name in ("subscriber", "publisher", "sibling", "unrelated")),
        node("tool", "/"),
    )
    subscriber.create_subscription(String, "out", lambda _: None, 1)
    publisher.create_publisher(String, "in", 1)
    sibling.create_publisher(String, "out", 1)
    unrelated.create_publisher(String, "elsewhere", 1)
    unrelated.create_publisher(String, "/clock", 1)
    tool.create_subscription(String, "/ema/out", lambda _: None, 1)

    def until(expected: set[str]) -> None:
        wait_for(lambda: nodes_in_touch(tested) == expected, f"{expected} alone")

    until({"/ema/subscriber", "/ema/publisher", "/ema/sibling"})
    publisher.destroy_node()
    until({"/ema/subscriber", "/ema/sibling"})


def test_incompatible_publisher_is_named_while_it_exists(make_node: Callable[..., Node]):
    tested, radio = make_node("own", namespace="/ema"), make_node("radio", namespace="/ema")
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    tested.create_subscription(String, "strict", lambda _: None, 1)
    # Two subscriptions with different demands: it is enough if one of them receives.
    tested.create_subscription(String, "either", lambda _: None, latched)
    tested.create_subscription(String, "either", lambda _: None, best_effort)
    publishers = [
        radio.create_publisher(String, name, best_effort) for name in ("strict", "either")
    ]
    publishers.append(radio.create_publisher(String, "strict", 1))
    named = "/ema/strict of /ema/radio (Best effort publisher and reliable subscription)"
    wait_for(lambda: tested.count_publishers("strict") == 2, "the publishers")
    wait_for(lambda: tested.count_publishers("either") == 1, "the publishers")
    assert incompatible_publishers(tested) == [named]
    peers = Peers("/ema/own")
    peers.incompatible = incompatible_publishers(tested)
    task = peers.task("unit", 0.0)
    assert (task.level, task.message) == (WARN, f"incompatible publishers: {named}")
    radio.destroy_publisher(publishers[0])
    wait_for(lambda: not incompatible_publishers(tested), "no incompatible publisher")


def test_two_nodes_with_the_same_name_both_report_an_error(graph: Spinning):
    def managed(graph: Spinning, name: str = "monitor", namespace: str = "/ema") -> Any:
        return graph.add(ManagedNode(name, namespace=namespace, context=graph.context))

    def status() -> DiagnosticStatus:
        return reported["/ema/monitor: peers"]

    reported = graph.statuses()
    first, unaffected = (
        managed(graph),
        (managed(graph, "monitor_1"), managed(graph, namespace="/b")),
    )
    with ros_context() as context, contextlib.closing(Spinning(context)) as other_graph:
        second = managed(other_graph)
        for node in (first, second):
            wait_for(lambda node=node: node._peers.task("", 0.0).level == ERROR, "the error")
        wait_for(lambda: status().level[0] == ERROR, "the status")
        assert "2 nodes are named /ema/monitor: stop all but one" in status().message
        assert not any(node._peers.collision for node in unaffected)
    wait_for(lambda: not first._peers.collision and status().level[0] != ERROR, "the end of it")
