"""A recorded topic: the requested quality of service, its publishers, and its losses."""

import threading
from collections.abc import Hashable, Sequence
from typing import Any

from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ema_bags.message_type import message_class, type_hash
from ema_bags.qos import RELIABLE_DEPTH, common_offer, joint_offer
from ema_interfaces.msg import TelemetryBlock


class SequenceGaps:
    """Counts the gaps in the sequence numbers of a topic that has one publisher.

    The numbers of several publishers cannot be distinguished, so that nothing is counted. A gap
    counts once the publisher is the same after it as before it, or has gone: a second publisher
    that has just started is not a loss. A publisher that returns after either side stood still
    continues its numbers.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._publishers: frozenset[Hashable] = frozenset()
        self._last: int | None = None
        self._unconfirmed = 0

    def count(self, number: int | None) -> None:
        """Count a message by its sequence number; None where the middleware gives none."""
        if number is None:
            return
        if self._last is not None and number > self._last:
            self._unconfirmed += number - self._last - 1
        self._last = number

    def set_publishers(self, publishers: frozenset[Hashable]) -> None:
        """Set the publishers of the moment; to be called regularly."""
        if publishers and publishers != self._publishers:
            self._publishers, self._last = publishers, None
        elif len(self._publishers) == 1:
            self.lost += self._unconfirmed
        self._unconfirmed = 0

    def pause(self) -> None:
        """Do not expect numbers to continue: messages during a pause are not recorded."""
        self._last, self._unconfirmed = None, 0


class SampleGaps:
    """Counts the blocks of telemetry that are missing by the index of their samples.

    An index that goes back means that the actuator was restarted: nothing is missing.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._next: dict[str, int] = {}

    def count(self, data: bytes) -> None:
        """Count a serialised block that was received."""
        try:
            block: Any = deserialize_message(data, TelemetryBlock)
        except Exception:  # the middleware raises various errors for malformed messages
            return
        length = len(block.position)
        missing = block.first_index - self._next.get(block.actuator_id, block.first_index)
        if length and missing > 0:
            self.lost += -(-missing // length)
        self._next[block.actuator_id] = block.first_index + length

    def pause(self) -> None:
        """Do not expect indices to continue from the last one."""
        self._next.clear()


class RecordedTopic:
    """A topic that is recorded, with the request that all its publishers meet, as rosbag2 has it.

    Losses are counted by the sequence numbers of its publisher. The numbers of several publishers
    cannot be distinguished: for telemetry, the index of the samples is used instead.

    Parameters
    ----------
    publishers
        Its publishers, at least one.

    Attributes
    ----------
    offer
        What its publishers offer.
    request
        What its subscription requests.
    is_received
        Whether the node has a subscription to it.
    incompatible
        Publishing nodes with an incompatible quality of service: nothing is received from them.

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
        self.is_received = False
        self.request = common_offer(offers, RELIABLE_DEPTH)
        self._lock = threading.Lock()
        self._gaps = SequenceGaps()
        self._samples = SampleGaps() if self.message_class is TelemetryBlock else None
        self._had_several = False
        self.set_publishers(publishers)

    @property
    def lost(self) -> int:
        """Number of messages that are known to be lost."""
        by_index = self._samples.lost if self._samples and self._had_several else 0
        return max(self._gaps.lost, by_index)

    def set_publishers(self, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Set the publishers of the moment; to be called regularly."""
        self.has_publisher = bool(publishers)
        self.incompatible = [
            item.node_name
            for item in publishers
            if qos_check_compatible(item.qos_profile, self.request)[0] == QoSCompatibility.ERROR
        ]
        with self._lock:
            self._had_several |= len(publishers) > 1
            self._gaps.set_publishers(frozenset(bytes(item.endpoint_gid) for item in publishers))

    def pause(self) -> None:
        """Note that nothing is recorded until publishers are set again."""
        with self._lock:
            self._gaps.pause()
            if self._samples:
                self._samples.pause()

    def count(self, data: bytes, sequence_number: int | None) -> None:
        """Count a serialised message; None where the middleware gives no number."""
        with self._lock:
            self._gaps.count(sequence_number)
            if self._samples:
                self._samples.count(data)


def _installed_class(types: Sequence[str], publishers: Sequence[TopicEndpointInfo]) -> Any:
    if len(types) != 1:
        raise ValueError(f"it has several types: {', '.join(types)}")
    (name,) = types
    message_type, installed = message_class(name), type_hash(name)
    for item in publishers:
        offered = str(item.topic_type_hash)
        if offered.startswith("RIHS") and offered != installed:
            raise ValueError(
                f"{name} of {item.node_name} is another version ({offered}) than the installed one "
                f"({installed})"
            )
    return message_type
