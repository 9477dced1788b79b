"""The topics that the dashboard shows, and how each is shown."""

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
    """A topic that is shown, by its full name and, in a namespace, its name there.

    ``request`` is the quality of service of the subscription, None for topics that the dashboard
    makes itself. A followed topic is received all the time, others only while a client looks at
    them; of one that is kept, later clients get the latest message of each actuator.
    """

    name: str
    namespace: str
    relative: str
    message_class: Any
    request: QoSProfile | None
    followed: bool
    kept: bool


def known_topics(namespaces: Iterable[str]) -> list[KnownTopic]:
    """Return the shown topics of some namespaces, and topics outside of any namespace."""
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    shown = [
        KnownTopic(DIAGNOSTICS, "", "", DiagnosticArray, topics.STATE, False, False),
        KnownTopic(CLOCK, "", "", Clock, best_effort, True, False),
    ]
    for namespace in namespaces:
        place = namespace.rstrip("/")
        for relative, (kind, offer) in _KNOWN.items():
            latched = offer.durability == DurabilityPolicy.TRANSIENT_LOCAL
            kept = latched or relative == topics.FAULT_ESTIMATE
            qos = topics.LATCHED_BY_MANY if latched else offer
            name = f"{place}/{relative}"
            followed = kept or relative in topics.NODE_TOPICS
            shown.append(KnownTopic(name, namespace, relative, kind, qos, followed, kept))
        name = f"{place}/{UNIT_HISTORY}"
        shown.append(KnownTopic(name, namespace, UNIT_HISTORY, UnitHistory, None, False, True))
    return shown
