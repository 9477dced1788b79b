# SPDX-License-Identifier: Apache-2.0
"""Node that only subscribes, in a separate thread."""

import os
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, Final, Self

import rclpy
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from ema_bags.message_type import type_name
from ema_cli.processes.stop_request import StopRequest
from ema_ros.topics import NAMESPACE

_DISCOVERY_S: Final = 2.0


class Listener:
    """Node that subscribes to topics and passes on their messages; a context manager.

    Parameters
    ----------
    name
        Name of the node.
    topics
        Message type and quality of service, keyed by topic.
    take
        Called in the node's thread with topic and message.
    events
        Event callbacks of the subscriptions, keyed by topic.
    """

    def __init__(
        self,
        name: str,
        topics: Mapping[str, tuple[type, QoSProfile]],
        take: Callable[[str, Any], None],
        events: Mapping[str, SubscriptionEventCallbacks] | None = None,
    ) -> None:
        self._name = name
        self._topics = topics
        self._take = take
        self._events = events or {}
        self._ending = threading.Event()

    def __enter__(self) -> Self:
        self._context = Context()
        rclpy.init(
            args=["--ros-args", "--enclave", f"/{self._name}/{self._name}"],
            context=self._context,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self._node = Node(self._name, namespace=f"/{self._name}", context=self._context)
        for topic, (message_class, qos) in self._topics.items():
            self._node.create_subscription(
                message_class,
                topic,
                partial(self._take, topic),
                qos,
                event_callbacks=self._events.get(topic),
            )
        self._thread = threading.Thread(target=self._spin, name=self._name, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def sees(self, node_name: str, namespace: str = NAMESPACE) -> bool:
        """Return whether a node is in the ROS graph."""
        return node_name in self.nodes_in(namespace)

    def nodes_in(self, namespace: str) -> set[str]:
        """Return the names of the nodes of a namespace in the ROS graph."""
        pairs = self._node.get_node_names_and_namespaces()
        return {name for name, place in pairs if place == namespace}

    def topics_of(self, message_class: type) -> list[str]:
        """Return the topics in the ROS graph that have publishers of a message class."""
        wanted = type_name(message_class)
        return sorted(
            topic
            for topic, types in self._node.get_topic_names_and_types()
            if wanted in types and self._node.count_publishers(topic)
        )

    def call(self, service_class: type, name: str, request: Any) -> Any:
        """Call a service and return the future of the response."""
        return self._node.create_client(service_class, name).call_async(request)

    def _spin(self) -> None:
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._node)
        while not self._ending.is_set():
            try:
                executor.spin_once(timeout_sec=0.1)
            except ExternalShutdownException:
                return
        executor.shutdown()


def refuse_running(nodes: Iterable[str], enclave: str, stop: StopRequest) -> None:
    """Raise ValueError if a node with one of the full names is running.

    If there is none, the check takes 2 s, or until a stop is requested.
    """
    wanted = {tuple(node.rsplit("/", 1)) for node in nodes}
    with Listener(enclave, {}, lambda *_: None) as listener:
        deadline = time.monotonic() + _DISCOVERY_S
        while time.monotonic() < deadline and not stop:
            for place, name in sorted(wanted):
                if listener.sees(name, place):
                    raise ValueError(
                        f"a node {place}/{name} is already running in domain "
                        f"{os.environ.get('ROS_DOMAIN_ID', '0')}: stop it, or set another "
                        "ROS_DOMAIN_ID"
                    )
            time.sleep(0.05)
