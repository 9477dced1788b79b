# SPDX-License-Identifier: Apache-2.0
"""Topics that the dashboard shows, with their quality of service."""

from collections.abc import Iterable
from typing import Any, Final, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from ema_interfaces.msg import UnitHistory
from ema_ros import topics

UNIT_HISTORY: Final = "unit_history"
DIAGNOSTICS: Final = "/diagnostics"
CLOCK: Final = "/clock"

_KNOWN: Final = {
    **topics.ACTUATOR_TOPICS,
    **topics.SYSTEM_TOPICS,
    **topics.MONITOR_TOPICS,
    **topics.PLAYER_TOPICS,
    **topics.NODE_TOPICS,
}


class KnownTopic(NamedTuple):
    """A topic that the dashboard shows."""

    name: str
    """Full name."""
    namespace: str
    """Namespace; empty for topics outside the namespaces."""
    relative: str
    """Name in the namespace."""
    message_class: Any
    request: QoSProfile | None
    """Quality of service of the subscription; None for topics of the dashboard itself."""
    followed: bool
    """Whether the topic is always received; other topics only while a client shows them."""
    kept: bool
    """Whether later clients receive the latest message of each actuator."""


def known_topics(namespaces: Iterable[str]) -> list[KnownTopic]:
    """Return the topics of the namespaces and topics outside any namespace."""
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    shown = [
        KnownTopic(DIAGNOSTICS, "", "", DiagnosticArray, topics.STATE, False, False),
        KnownTopic(CLOCK, "", "", Clock, best_effort, True, False),
    ]
    for namespace in namespaces:
        prefix = namespace.rstrip("/")
        for relative, (kind, offer) in _KNOWN.items():
            latched = offer.durability == DurabilityPolicy.TRANSIENT_LOCAL
            kept = latched or relative == topics.FAULT_ESTIMATE
            qos = topics.LATCHED_BY_MANY if latched else offer
            if relative == topics.HEALTH:
                qos = topics.ALIVE_BY_MANY
            name = f"{prefix}/{relative}"
            followed = kept or relative in topics.NODE_TOPICS
            shown.append(KnownTopic(name, namespace, relative, kind, qos, followed, kept))
        name = f"{prefix}/{UNIT_HISTORY}"
        shown.append(KnownTopic(name, namespace, UNIT_HISTORY, UnitHistory, None, False, True))
    return shown
