# SPDX-License-Identifier: Apache-2.0
"""A recorded topic: its quality of service, publishers and losses."""

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
    """Counts the gaps in the sequence numbers of a topic with a single publisher.

    The numbers of several publishers cannot be distinguished, so that nothing is counted. A gap
    counts if the publisher is the same before and after it, or has gone: a second publisher that
    has just started is not a loss. A publisher that returns after an interruption continues its
    numbers.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._publishers: frozenset[Hashable] = frozenset()
        self._last: int | None = None
        self._unconfirmed = 0

    def count(self, number: int | None) -> None:
        """Count a message by its sequence number; None if the middleware has none."""
        if number is None:
            return
        if self._last is not None and number > self._last:
            self._unconfirmed += number - self._last - 1
        self._last = number

    def set_publishers(self, publishers: frozenset[Hashable]) -> None:
        """Set the present publishers; call it regularly."""
        if publishers and publishers != self._publishers:
            self._publishers, self._last = publishers, None
        elif len(self._publishers) == 1:
            self.lost += self._unconfirmed
        self._unconfirmed = 0

    def pause(self) -> None:
        """Ignore the gap after a pause, whose messages are not recorded."""
        self._last, self._unconfirmed = None, 0


class SampleGaps:
    """Counts missing blocks of telemetry by the index of their samples.

    An index that goes back indicates a restart of the actuator, not a loss.
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
        """Ignore the gap after a pause, whose blocks are not recorded."""
        self._next.clear()


class RecordedTopic:
    """A recorded topic, with a requested quality of service that all its publishers meet.

    Losses are counted by the sequence numbers of its publisher. The numbers of several publishers
    cannot be distinguished: for telemetry, the index of the samples is used instead.

    Parameters
    ----------
    types
        Names of its message types.
    publishers
        Its publishers, at least one.

    Attributes
    ----------
    offer
        Recorded quality of service of its publishers.
    request
        Requested quality of service of its subscription.
    is_received
        Whether the node has a subscription to it.
    incompatible
        Publishing nodes with an incompatible quality of service: nothing is received from them.

    Raises
    ------
    ValueError
        If the topic has several types, or its type is not installed or differs from the installed
        version.
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
        """Number of lost messages detected so far."""
        by_index = self._samples.lost if self._samples and self._had_several else 0
        return max(self._gaps.lost, by_index)

    def set_publishers(self, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Set the present publishers; call it regularly."""
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
        """Ignore the gap until publishers are set again, while nothing is recorded."""
        with self._lock:
            self._gaps.pause()
            if self._samples:
                self._samples.pause()

    def count(self, data: bytes, sequence_number: int | None) -> None:
        """Count a serialised message; the number is None if the middleware has none."""
        with self._lock:
            self._gaps.count(sequence_number)
            if self._samples:
                self._samples.count(data)


def _installed_class(types: Sequence[str], publishers: Sequence[TopicEndpointInfo]) -> Any:
    if len(types) != 1:
        raise ValueError(f"the topic has several types: {', '.join(types)}")
    (name,) = types
    message_type, installed = message_class(name), type_hash(name)
    for item in publishers:
        offered = str(item.topic_type_hash)
        if offered.startswith("RIHS") and offered != installed:
            raise ValueError(
                f"{name} of {item.node_name} differs from the installed version: {offered}, "
                f"installed is {installed}"
            )
    return message_type
