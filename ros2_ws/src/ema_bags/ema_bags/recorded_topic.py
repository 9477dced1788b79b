# SPDX-License-Identifier: Apache-2.0
"""A recorded topic: its quality of service, publishers and losses."""

import threading
import time
from collections import defaultdict
from collections.abc import Hashable, Sequence
from typing import Any

from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ema_bags.message_type import message_class, type_hash
from ema_bags.qos import RELIABLE_DEPTH, common_offer, joint_offer
from ema_core.sample_runs import SampleRuns, several_publishers
from ema_interfaces.msg import TelemetryBlock
from ema_ros.peers import full_node_name


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
        """Begin a pause: messages missed during it do not count as lost."""
        self._last, self._unconfirmed = None, 0


class SampleGaps:
    """Counts missing blocks of telemetry by the index of their samples, for each publisher.

    See ``SampleRuns``.
    """

    def __init__(self) -> None:
        self._runs: defaultdict[str, SampleRuns] = defaultdict(SampleRuns)

    @property
    def lost(self) -> int:
        """Number of missing blocks."""
        return sum(runs.lost_blocks for runs in self._runs.values())

    @property
    def shared(self) -> list[str]:
        """Names of actuators with several publishers, sorted."""
        return sorted(name for name, runs in self._runs.items() if runs.are_several)

    def count(self, data: bytes, now_s: float) -> None:
        """Count a serialised block received at a monotonic time [s]."""
        try:
            block: Any = deserialize_message(data, TelemetryBlock)
        except Exception:  # the middleware raises various errors for malformed messages
            return
        if length := len(block.position):
            self._runs[block.actuator_id].add(block.first_index, length, now_s)

    def settle(self, now_s: float) -> None:
        """Count the gaps after runs that have ended; call it regularly."""
        for runs in self._runs.values():
            runs.settle(now_s)

    def ignore(self) -> None:
        """Discard the gaps so far; with a single publisher, sequence numbers count gaps."""
        for runs in self._runs.values():
            runs.ignore()

    def pause(self) -> None:
        """Begin a pause: blocks missed during it do not count as missing."""
        for runs in self._runs.values():
            runs.pause()


class RecordedTopic:
    """A recorded topic, with a requested quality of service that all its publishers meet.

    Losses are counted by the sequence numbers of its publisher. The numbers of several publishers
    cannot be distinguished: for telemetry, the index of the samples is used instead, which also
    shows whether several publishers send the same ``actuator_id``.

    Parameters
    ----------
    types
        Names of the topic's message types.
    publishers
        Publishers of the topic, at least one.

    Attributes
    ----------
    offer
        Quality of service of the publishers, as recorded.
    request
        Quality of service of the subscription.
    is_received
        Whether the node has a subscription to the topic.
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
        self.set_publishers(publishers)

    @property
    def lost(self) -> int:
        """Number of lost messages detected so far."""
        with self._lock:
            return self._gaps.lost + (self._samples.lost if self._samples else 0)

    @property
    def collision(self) -> str:
        """Warning if several publishers send the same ``actuator_id``; else empty."""
        with self._lock:
            names = self._samples.shared if self._samples else []
        return several_publishers(names, self._nodes) if names else ""

    def set_publishers(self, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Set the present publishers; call it regularly."""
        self.has_publisher = bool(publishers)
        self._nodes = {full_node_name(item) for item in publishers}
        self.incompatible = [
            item.node_name
            for item in publishers
            if qos_check_compatible(item.qos_profile, self.request)[0] == QoSCompatibility.ERROR
        ]
        present = frozenset(bytes(item.endpoint_gid) for item in publishers)
        with self._lock:
            self._gaps.set_publishers(present)
            if self._samples and len(present) > 1:
                self._samples.settle(time.monotonic())
            elif self._samples:
                self._samples.ignore()

    def pause(self) -> None:
        """Begin a pause: messages missed during it do not count as lost."""
        with self._lock:
            self._gaps.pause()
            if self._samples:
                self._samples.pause()

    def count(self, data: bytes, sequence_number: int | None) -> None:
        """Count a serialised message; the number is None if the middleware has none."""
        with self._lock:
            self._gaps.count(sequence_number)
            if self._samples:
                self._samples.count(data, time.monotonic())


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
