# SPDX-License-Identifier: Apache-2.0
"""Subscription to topics with both latched and volatile publishers."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from ema_ros.topics import LATCHED_BY_MANY, STREAM

_REMEMBERED: Final = 1000
_BEST_EFFORT: Final = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


def subscribe_latched(
    node: Node,
    message_class: Any,
    topic: str,
    callback: Callable[[Any], None],
    callback_group: CallbackGroup,
) -> None:
    """Subscribe to a topic with any mix of publishers; deliver each message once.

    Several subscriptions are needed: a transient local subscription does not match publishers with
    default quality of service, a volatile subscription misses earlier latched messages, and neither
    matches best-effort publishers.

    Parameters are as in ``rclpy.node.Node.create_subscription``; messages have an
    ``actuator_id``.
    """
    delivered: deque[tuple[Any, ...]] = deque(maxlen=_REMEMBERED)

    def receive(message: Any, information: Mapping[str, Any]) -> None:
        # All deliveries of a message have the same source time stamp.
        stamp = message.header.stamp
        key = (information["source_timestamp"], stamp.sec, stamp.nanosec, message.actuator_id)
        if key not in delivered:
            delivered.append(key)
            callback(message)

    receive_each: Callable[..., None] = receive
    quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
    for qos in (LATCHED_BY_MANY, STREAM, _BEST_EFFORT):
        node.create_subscription(
            message_class,
            topic,
            receive_each,
            qos,
            callback_group=callback_group,
            event_callbacks=quiet,
        )
