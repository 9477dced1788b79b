# SPDX-License-Identifier: Apache-2.0
"""Publishers of a player, and waiting for their subscribers."""

import threading
from collections.abc import Iterable
from typing import Final

from rclpy.duration import Duration
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from ema_bags.message_type import message_class
from ema_bags.played_bag import CLOCK, PlayedBag
from ema_bags.recording import Recorded
from ema_bags.telemetry import HEALTH_TYPE, TELEMETRY_TYPE
from ema_ros.peers import UNKNOWN_NODE

_POLL_S: Final = 0.05
_LATCHED_S: Final = 0.2
_SETTLE_S: Final = 1.0  # the publisher detects a match before the subscription does
_ACKNOWLEDGE_S: Final = 5.0


class PlayerOutputs:
    """Publishers of all played topics and of ``/clock``."""

    def __init__(self, node: Node, played: PlayedBag) -> None:
        self._node = node
        self.publishers: dict[str, Publisher] = {}
        for name, topic in list(played.topics.items()):
            kind = message_class(topic.type_name)
            try:
                self.publishers[name] = node.create_publisher(kind, name, played.offers[name])
            except Exception as error:  # impossible name, or another type in the graph
                reason = " ".join(str(error).split()).partition(", at ")[0]
                played.leave_out(name, reason)
        self._telemetry = [
            name for name, topic in played.topics.items() if topic.type_name == TELEMETRY_TYPE
        ]
        clock_qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._clock = node.create_publisher(Clock, CLOCK, clock_qos)

    def publish(self, item: Recorded) -> None:
        """Publish a message."""
        self.publishers[item.topic].publish(item.message)

    def publish_latched(self, items: Iterable[Recorded]) -> None:
        """Publish latched messages, each after the previous one on its topic is acknowledged.

        The wait for an acknowledgement is at most 0.2 s.
        """
        for item in items:
            self.publishers[item.topic].wait_for_all_acked(Duration(seconds=_LATCHED_S))
            self.publish(item)

    def publish_clock(self, stamp_ns: int) -> None:
        """Publish a time [ns] on ``/clock``."""
        self._clock.publish(Clock(clock=Time(nanoseconds=stamp_ns).to_msg()))

    def missing(self) -> str:
        """Return the topics that lack an expected subscription, as a string; "" if none does.

        Each telemetry topic should have a subscription; without telemetry, any one topic.
        """
        subscribed = {
            name
            for name, publisher in self.publishers.items()
            if publisher.get_subscription_count()
        }
        if self._telemetry:
            return ", ".join(name for name in self._telemetry if name not in subscribed)
        return "" if subscribed else f"any of {', '.join(self.publishers)}"

    def await_subscribers(self, stop: threading.Event, wait_s: float) -> None:
        """Wait at most ``wait_s`` [s] for subscriptions, then until no new ones appear."""
        waits = round(wait_s / _POLL_S)
        while waits and self.missing() and not stop.wait(_POLL_S):
            waits -= 1
        # A recorder discovers the publishers, and subscribes to one topic after the other.
        quiet, previous = 0, -1
        while quiet < round(_SETTLE_S / _POLL_S) and not self.missing() and not stop.wait(_POLL_S):
            count = sum(item.get_subscription_count() for item in self.publishers.values())
            quiet, previous = quiet + 1 if count == previous else 0, count

    def await_acknowledgement(self, stop: threading.Event) -> list[str]:
        """Wait up to 5 s for acknowledgements; return the topics where some are missing."""
        waits = round(_ACKNOWLEDGE_S / _POLL_S)
        pending = list(self.publishers.items())
        while pending and waits and not stop.is_set():
            if pending[-1][1].wait_for_all_acked(Duration(seconds=_POLL_S)):
                pending.pop()
            else:
                waits -= 1
        return [name for name, _ in pending]

    def live_monitors(self) -> list[str]:
        """Return a warning for each monitor that ignores ``/clock``.

        Such a monitor mistakes played data for new tests.
        """
        listeners = {
            (item.node_name, item.node_namespace)
            for name in self._telemetry
            for item in self._node.get_subscriptions_info_by_topic(name)
            if item.node_name != UNKNOWN_NODE
        }
        remarks = []
        for name, namespace in sorted(listeners):
            try:
                published = self._node.get_publisher_names_and_types_by_node(name, namespace)
                subscribed = self._node.get_subscriber_names_and_types_by_node(name, namespace)
            except NodeNameNonExistentError:
                continue  # the node has just ended
            is_monitor = any(HEALTH_TYPE in types for _, types in published)
            if is_monitor and CLOCK not in dict(subscribed):
                remarks.append(
                    f"{namespace.rstrip('/')}/{name} does not follow /clock and treats played "
                    "data as new tests: start it with use_sim_time:=true"
                )
        return remarks
