# SPDX-License-Identifier: Apache-2.0
"""A recorded topic: its quality of service, publishers and losses."""

import threading
import time
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ema_bags.message_type import message_class, type_hash
from ema_bags.qos import RELIABLE_DEPTH, common_offer, joint_offer
from ema_interfaces.msg import TelemetryBlock

_ENDED_S: Final = 5.0
"""Time without a block after which a run of blocks has ended, if another run has begun [s]."""

_MOST_RUNS: Final = 100
"""Largest number of runs of an actuator; the oldest are forgotten."""


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


@dataclass(eq=False)
class _Run:
    """Blocks of telemetry without a gap, which are of one publisher."""

    next_index: int
    """Index of the sample after the last block."""
    latest_s: float
    """Monotonic time of the last block [s]."""
    before: "_Run | None" = None
    """Run that this run continues after a gap, unless that run continues itself."""
    missing: int = 0
    """Number of blocks in the gap."""


class SampleGaps:
    """Counts missing blocks of telemetry by the index of their samples, for each publisher.

    rclpy does not name the publisher of a message, but the blocks of one publisher form runs
    without a gap. A run that begins after a gap continues an earlier run, and the blocks between
    them are lost. If the earlier run continues, the later one is of another publisher, and no block
    is lost. An index that goes back indicates a restart of the actuator, not a loss.

    Attributes
    ----------
    lost
        Number of missing blocks.
    shared
        Names of actuators with several publishers.
    """

    def __init__(self) -> None:
        self.lost = 0
        self.shared: set[str] = set()
        self._runs: dict[str, list[_Run]] = {}

    def count(self, data: bytes, now_s: float) -> None:
        """Count a serialised block received at a monotonic time [s]."""
        try:
            block: Any = deserialize_message(data, TelemetryBlock)
        except Exception:  # the middleware raises various errors for malformed messages
            return
        first, length = block.first_index, len(block.position)
        if not length:
            return
        runs = self._runs.setdefault(block.actuator_id, [])
        run = next((item for item in reversed(runs) if item.next_index == first), None)
        if run is None:
            lower = [item for item in runs if item.next_index < first]
            before = max(lower, key=lambda item: item.next_index, default=None)
            missing = -(-(first - before.next_index) // length) if before else 0
            run = _Run(first, now_s, before, missing)
            runs.append(run)
            del runs[:-_MOST_RUNS]
        elif run is not runs[-1]:
            self.shared.add(block.actuator_id)
            for item in runs:
                if item.before is run:
                    item.before = None
        run.next_index, run.latest_s = first + length, now_s

    def settle(self, now_s: float) -> None:
        """Count the gaps after runs that have ended; call it regularly."""
        for runs in self._runs.values():
            ended = {id(run) for run in runs[:-1] if now_s - run.latest_s > _ENDED_S}
            for run in runs:
                if run.before is not None and id(run.before) in ended:
                    self.lost += run.missing
                    run.before = None
            runs[:] = [run for run in runs if id(run) not in ended]

    def ignore(self) -> None:
        """Count no gap so far; a sole publisher's gaps are counted by sequence number."""
        for runs in self._runs.values():
            del runs[:-1]
            runs[-1].before = None

    def pause(self) -> None:
        """Ignore the gap after a pause, whose blocks are not recorded."""
        self._runs.clear()


class RecordedTopic:
    """A recorded topic, with a requested quality of service that all its publishers meet.

    Losses are counted by the sequence numbers of its publisher. The numbers of several publishers
    cannot be distinguished: for telemetry, the index of the samples is used instead, which also
    shows whether several publishers send the same ``actuator_id``.

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
        self._present: frozenset[bytes] = frozenset()
        self._samples = SampleGaps() if self.message_class is TelemetryBlock else None
        self.set_publishers(publishers)

    @property
    def lost(self) -> int:
        """Number of lost messages detected so far."""
        return self._gaps.lost + (self._samples.lost if self._samples else 0)

    @property
    def collision(self) -> str:
        """Warning if several publishers send the same ``actuator_id``; else empty."""
        with self._lock:
            names = ", ".join(sorted(self._samples.shared)) if self._samples else ""
        if not names:
            return ""
        nodes = ", ".join(self._nodes)
        return f"several publishers send actuator_id {names} ({nodes}): stop all but one"

    def set_publishers(self, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Set the present publishers; call it regularly."""
        self.has_publisher = bool(publishers)
        self._nodes = sorted(
            f"{item.node_namespace.rstrip('/')}/{item.node_name}" for item in publishers
        )
        self.incompatible = [
            item.node_name
            for item in publishers
            if qos_check_compatible(item.qos_profile, self.request)[0] == QoSCompatibility.ERROR
        ]
        present = frozenset(bytes(item.endpoint_gid) for item in publishers)
        with self._lock:
            if present != self._present:
                self._present = present
                if self._samples:
                    self._samples.shared.clear()
            self._gaps.set_publishers(present)
            if self._samples and len(present) > 1:
                self._samples.settle(time.monotonic())
            elif self._samples:
                self._samples.ignore()

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
