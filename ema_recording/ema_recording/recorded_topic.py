"""A topic that is recorded: what is requested of its publishers, who they are, what is lost."""

import threading
from collections.abc import Sequence
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ema_recording.message_type import message_class, type_hash
from ema_recording.qos import RELIABLE_DEPTH, CommonOffer, joint_offer
from ema_recording.sequence_gaps import SequenceGaps


class RecordedTopic:
    """A topic that is recorded, with the request that all its publishers meet, as rosbag2 has it.

    Parameters
    ----------
    types
        Names of the types that the graph tells for it.
    publishers
        Its publishers, at least one.

    Attributes
    ----------
    message_class
        Class of its messages.
    offer
        What its publishers offer.
    subscription
        Its subscription, while there is one.
    has_publisher
        Whether anybody publishes.
    unheard
        Nodes that came later and offer less than is requested: they are not heard.

    Raises
    ------
    ValueError
        When it cannot be recorded: it has several types, or one that is not installed or is
        another version than the installed one.
    """

    def __init__(self, types: Sequence[str], publishers: Sequence[TopicEndpointInfo]) -> None:
        offers = [item.qos_profile for item in publishers]
        self.message_class = _installed_class(types, publishers)
        self.offer = joint_offer(offers)
        self.subscription: Subscription | None = None
        self._request = CommonOffer.of(offers)
        self._lock = threading.Lock()
        self._gaps = SequenceGaps()
        self.see(publishers)

    @property
    def request(self) -> QoSProfile:
        """What its subscription requests."""
        return self._request.profile(RELIABLE_DEPTH)

    @property
    def lost(self) -> int:
        """Number of messages that are known to be lost."""
        return self._gaps.lost

    def see(self, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Take note of who publishes now; to be called regularly."""
        self.has_publisher = bool(publishers)
        self.unheard = [
            item.node_name
            for item in publishers
            if not CommonOffer.of([item.qos_profile]).meets(self._request)
        ]
        with self._lock:
            self._gaps.take_publishers(frozenset(bytes(item.endpoint_gid) for item in publishers))

    def take(self, sequence_number: int | None) -> None:
        """Take note of a message; None where the middleware gives no number."""
        with self._lock:
            self._gaps.take(sequence_number)


def _installed_class(types: Sequence[str], publishers: Sequence[TopicEndpointInfo]) -> Any:
    if len(types) != 1:
        raise ValueError(f"it has several types: {', '.join(types)}")
    (name,) = types
    found, installed = message_class(name), type_hash(name)
    for item in publishers:
        told = str(item.topic_type_hash)
        if told.startswith("RIHS") and told != installed:
            raise ValueError(
                f"{name} of {item.node_name} is another version ({told}) than the installed one "
                f"({installed})"
            )
    return found
