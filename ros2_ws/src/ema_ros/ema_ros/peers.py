"""Other nodes in the graph, and nodes that have gone."""

from collections import defaultdict
from typing import Final

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

from ema_ros.status import OK, WARN, Task

FRESH_S: Final = 60.0
"""How long a node that has gone is worth a warning [s]."""

UNKNOWN_NODE: Final = "_NODE_NAME_UNKNOWN_"
"""Name of a node known only by its publishers and subscriptions."""

_UNSEEN = {"/rosout", "/parameter_events", "/clock", "/diagnostics"}


class Peers:
    """The nodes that communicate, or communicated, with a node.

    These are the nodes it receives data from, in any namespace, and the subscribers in its own
    namespace. A killed node cannot report its own end, so its peers have to. Tools that subscribe
    from elsewhere are ignored, and so is a node that is present and only inactive.
    """

    def __init__(self) -> None:
        self._present: set[str] = set()
        self._gone: dict[str, float] = {}
        self.unheard: list[str] = []
        """Publishers whose messages do not arrive, as ``unheard_publishers`` gives them."""

    def update(self, in_touch: set[str], alive: set[str], now_s: float) -> list[str]:
        """Note the present nodes, and return the nodes that have gone since the last call."""
        present = in_touch | (alive & (self._present | self._gone.keys()))
        lost = sorted(self._present - present)
        known = {name: since for name, since in self._gone.items() if name not in present}
        # Replaced as a whole: another thread may be reading.
        self._gone = known | dict.fromkeys(lost, now_s)
        self._present = present
        return lost

    def task(self, hardware_id: str, now_s: float) -> Task:
        """Return the status: a warning for a minute after a node has gone, or if one is unheard."""
        fresh = [name for name, since in self._gone.items() if now_s - since < FRESH_S]
        values = {"present": ", ".join(sorted(self._present)), "gone": ", ".join(self._gone)}
        remarks = [f"no contact with {', '.join(fresh)}"] if fresh else []
        if self.unheard:
            remarks.append(f"not received: {', '.join(self.unheard)}")
        if remarks:
            return Task("peers", WARN, "; ".join(remarks), hardware_id, values)
        return Task("peers", OK, f"{len(self._present)} in touch", hardware_id, values)


def nodes_in_touch(node: Node) -> set[str]:
    """Return the full names of the nodes that data flow from, and of near ones that share a topic.

    Near nodes are in the same namespace. Hidden nodes, such as command-line tools, do not count.
    """
    received = {item.topic_name for item in node.subscriptions} - _UNSEEN
    shared = received | {item.topic_name for item in node.publishers} - _UNSEEN
    sources = [item for topic in received for item in node.get_publishers_info_by_topic(topic)]
    near = [
        item
        for topic in shared
        for item in (
            *node.get_publishers_info_by_topic(topic),
            *node.get_subscriptions_info_by_topic(topic),
        )
        if item.node_namespace == node.get_namespace()
    ]
    nodes = {
        f"{item.node_namespace.rstrip('/')}/{item.node_name}"
        for item in (*sources, *near)
        if not item.node_name.startswith("_")
    }
    return nodes - {node.get_fully_qualified_name()}


def unheard_publishers(node: Node) -> list[str]:
    """Return the publishers that no subscription of a node receives for their quality of service.

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
                name = f"{info.node_namespace.rstrip('/')}/{info.node_name}"
                reason = answers[0][1].removeprefix("ERROR: ").rstrip("; ")
                publishers.add(f"{topic} of {name} ({reason})")
    return sorted(publishers)


def nodes_alive(node: Node) -> set[str]:
    """Return the full names of all nodes in the graph."""
    pairs = node.get_node_names_and_namespaces()
    return {f"{namespace.rstrip('/')}/{name}" for name, namespace in pairs}
