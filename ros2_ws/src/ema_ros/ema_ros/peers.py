# SPDX-License-Identifier: Apache-2.0
"""Peers of a node in the graph, and detection of peers that have disappeared."""

from collections import Counter, defaultdict
from typing import Final

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ema_core.wording import counted
from ema_ros.status import ERROR, OK, WARN, Task

FRESH_S: Final = 60.0
"""Duration of the warning about a disappeared node [s]."""

UNKNOWN_NODE: Final = "_NODE_NAME_UNKNOWN_"
"""Name of a node whose publishers and subscriptions are discovered before its name."""

_UNSEEN = {"/rosout", "/parameter_events", "/clock", "/diagnostics"}


class Peers:
    """Nodes that communicate, or have communicated, with a node.

    Peers are the publishers of received data in any namespace, and the subscribers in the namespace
    of the node. A killed node cannot report its end, so its peers do. Subscribers in other
    namespaces, such as tools, are ignored, and so are inactive nodes.

    Parameters
    ----------
    name
        Full name of the node.

    Attributes
    ----------
    incompatible
        Publishers whose messages are not received (``incompatible_publishers``).
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._namesakes = 0
        self._present: set[str] = set()
        self._gone: dict[str, float] = {}
        self.incompatible: list[str] = []

    @property
    def collision(self) -> str:
        """Error text if another node has the same full name; else empty."""
        if not self._namesakes:
            return ""
        return (
            f"{self._namesakes + 1} nodes are named {self._name}: stop all but one, or rename them "
            "with -r __node:=NAME; a killed node disappears when its DDS lease expires"
        )

    def update(self, in_touch: set[str], alive: Counter[str], now_s: float) -> list[str]:
        """Store the current nodes. Return the nodes that have disappeared since the last call.

        Parameters
        ----------
        in_touch
            Full names of the peers.
        alive
            Number of nodes in the graph by full name.
        now_s
            Monotonic time [s].
        """
        self._namesakes = max(alive[self._name] - 1, 0)
        present = in_touch | (alive.keys() & (self._present | self._gone.keys()))
        lost = sorted(self._present - present)
        absent = {name: since for name, since in self._gone.items() if name not in present}
        # Replaced as a whole, because another thread may read it.
        self._gone = absent | dict.fromkeys(lost, now_s)
        self._present = present
        return lost

    def task(self, hardware_id: str, now_s: float) -> Task:
        """Return the status of the peers.

        It is ERROR while another node has the same name, and WARN for a minute after a loss, or
        while a publisher is incompatible.
        """
        fresh = [name for name, since in self._gone.items() if now_s - since < FRESH_S]
        values = {
            "present": ", ".join(sorted(self._present)),
            "gone": ", ".join(self._gone),
            "nodes of the same name": self._namesakes,
        }
        remarks = [self.collision] if self.collision else []
        remarks += [f"lost contact with {', '.join(fresh)}"] if fresh else []
        if self.incompatible:
            remarks.append(f"incompatible publishers: {', '.join(self.incompatible)}")
        if remarks:
            level = ERROR if self.collision else WARN
            return Task("peers", level, "; ".join(remarks), hardware_id, values)
        return Task(
            "peers",
            OK,
            f"in contact with {counted(len(self._present), 'node')}",
            hardware_id,
            values,
        )


def nodes_in_touch(node: Node) -> set[str]:
    """Return the full names of nodes that publish to a node or share a topic nearby.

    Nearby nodes are in the same namespace. Hidden nodes, such as command-line tools, are ignored.
    """
    received = {item.topic_name for item in node.subscriptions} - _UNSEEN
    shared = received | {item.topic_name for item in node.publishers} - _UNSEEN
    sources = [item for topic in received for item in node.get_publishers_info_by_topic(topic)]
    nearby = [
        item
        for topic in shared
        for item in (
            *node.get_publishers_info_by_topic(topic),
            *node.get_subscriptions_info_by_topic(topic),
        )
        if item.node_namespace == node.get_namespace()
    ]
    nodes = {
        full_node_name(item) for item in (*sources, *nearby) if not item.node_name.startswith("_")
    }
    return nodes - {node.get_fully_qualified_name()}


def nodes_publishing(node: Node, topic: str) -> set[str]:
    """Return the full names of the nodes that publish a topic; ``topic`` is its full name.

    The name of a node that is not yet discovered ends in ``UNKNOWN_NODE``.
    """
    return {full_node_name(item) for item in node.get_publishers_info_by_topic(topic)}


def incompatible_publishers(node: Node) -> list[str]:
    """Return publishers whose QoS matches no subscription of a node.

    Each is named with its topic, its node and the reason given by the middleware.
    """
    wanted: dict[str, list[QoSProfile]] = defaultdict(list)
    for item in node.subscriptions:
        wanted[item.topic_name].append(item.qos_profile)
    publishers = set()
    for topic, profiles in wanted.items():
        for info in node.get_publishers_info_by_topic(topic):
            answers = [qos_check_compatible(info.qos_profile, profile) for profile in profiles]
            if all(verdict == QoSCompatibility.ERROR for verdict, _ in answers):
                reason = answers[0][1].removeprefix("ERROR: ").rstrip("; ")
                publishers.add(f"{topic} of {full_node_name(info)} ({reason})")
    return sorted(publishers)


def nodes_alive(node: Node) -> Counter[str]:
    """Return the number of nodes in the graph by full name."""
    pairs = node.get_node_names_and_namespaces()
    return Counter(f"{namespace.rstrip('/')}/{name}" for name, namespace in pairs)


def full_node_name(item: TopicEndpointInfo) -> str:
    """Return the full name of the node of a publisher or subscription."""
    return f"{item.node_namespace.rstrip('/')}/{item.node_name}"
