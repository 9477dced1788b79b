# SPDX-License-Identifier: Apache-2.0
"""Node that receives the health of the actuators in several namespaces."""

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, cast

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from ema_cli.processes.listener import Listener
from ema_cli.show.health_table import LatestHealths, Row
from ema_interfaces.msg import (
    BaselineStatus,
    FaultEstimate,
    Health,
    NodeStatus,
    PlaybackState,
    TelemetryStatus,
)
from ema_ros.liveliness import MonitorLiveliness
from ema_ros.stamps import stamp_from_message
from ema_ros.topics import (
    ALIVE_BY_MANY,
    BASELINE,
    FAULT_ESTIMATE,
    HEALTH,
    LATCHED_BY_MANY,
    NODE_STATUS,
    PLAYBACK_STATE,
    STREAM,
)

_CLOCK: Final = "/clock"
_BEST_EFFORT: Final = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class Completion:
    """Detects that a player has ended and the monitors have identified all played data.

    Each monitor reports once a second and on change. An actuator is complete if, after the end, two
    successive reports have the same counts and every window has an estimate.

    Attributes
    ----------
    is_complete
        Whether all played data are identified.
    """

    def __init__(self) -> None:
        self.is_complete = False
        self._has_ended = False
        self._last: dict[tuple[str, str], TelemetryStatus] = {}
        # Reported actuators, and the actuators among them without pending data.
        self._reported: set[tuple[str, str]] = set()
        self._settled: set[tuple[str, str]] = set()

    def end(self) -> None:
        """Record that the player has ended."""
        if not self._has_ended:
            self._has_ended = True
            self._last.clear()

    def add_report(self, place: str, telemetry: Iterable[TelemetryStatus]) -> None:
        """Add the counts that a monitor reports for the actuators of a namespace."""
        actuators = {(place, item.actuator_id): item for item in telemetry}
        self._reported |= actuators.keys()
        if not self._has_ended or not actuators:
            return
        for key, counts in actuators.items():
            is_still, self._last[key] = _counts(counts) == _counts(self._last.get(key)), counts
            answered = counts.estimates_valid + counts.estimates_invalid
            if is_still and counts.windows == answered:
                self._settled.add(key)
            else:
                self._settled.discard(key)
        self.is_complete |= self._settled >= self._reported


def _counts(status: TelemetryStatus | None) -> tuple[int, ...]:
    """Return the counts that stay constant if no data are pending; empty without a status."""
    if status is None:
        return ()
    return status.blocks, status.windows, status.estimates_valid, status.estimates_invalid


class HealthListener(Listener):
    """Collects health and node status messages from several namespaces; a context manager.

    Parameters
    ----------
    places
        Full namespaces of the monitors.
    name
        Name of the node.
    further
        Message type and quality of service of further topics, keyed by topic.
    take
        Called with topic and message for the further topics and for node statuses.

    Attributes
    ----------
    changed
        Event that is set when new data are received.
    completion
        State of the identification of played data.
    """

    def __init__(
        self,
        places: list[str],
        name: str,
        further: Mapping[str, tuple[type, QoSProfile]] | None = None,
        take: Callable[[str, Any], None] = lambda _topic, _message: None,
    ) -> None:
        topics: dict[str, tuple[type, QoSProfile]] = {_CLOCK: (Clock, _BEST_EFFORT)}
        self._places: dict[str, str] = {}
        self._monitors: set[str] = set()
        self.completion = Completion()
        for place in places:
            topics[f"{place.rstrip('/')}/{PLAYBACK_STATE}"] = PlaybackState, LATCHED_BY_MANY
            for relative, kind, qos in (
                (HEALTH, Health, ALIVE_BY_MANY),
                (BASELINE, BaselineStatus, LATCHED_BY_MANY),
                (FAULT_ESTIMATE, FaultEstimate, STREAM),
                (NODE_STATUS, NodeStatus, STREAM),
            ):
                topic = f"{place.rstrip('/')}/{relative}"
                topics[topic] = kind, qos
                self._places[topic] = place
        self.changed = threading.Event()
        self._lock = threading.Lock()
        self._healths = LatestHealths()
        self._simulated_ns: int | None = None
        self._further, self._take_further = dict(further or {}), take
        self._liveliness = {place: MonitorLiveliness(place) for place in places}
        events = {
            f"{place.rstrip('/')}/{HEALTH}": liveliness.events
            for place, liveliness in self._liveliness.items()
        }
        super().__init__(name, topics | self._further, self._note, events)

    def _note(self, topic: str, message: Any) -> None:
        """Process a received message."""
        now_s = time.monotonic()
        is_further = topic in self._further
        if is_further or type(message) is NodeStatus:
            self._take_further(topic, message)
        if is_further:
            return
        with self._lock:
            if topic == _CLOCK:
                self._simulated_ns = stamp_from_message(cast(Clock, message).clock)
                return
            if isinstance(message, PlaybackState):
                if message.status == PlaybackState.ENDED:
                    self.completion.end()
                return
            place = self._places[topic]
            if isinstance(message, NodeStatus):
                self._monitors |= {place} if message.kind == NodeStatus.MONITOR else set()
                self.completion.add_report(place, message.telemetry)
                return
            if isinstance(message, Health):
                self._healths.add_health(place, message, now_s, self._clock_ns())
            elif isinstance(message, BaselineStatus):
                self._healths.add_baseline(place, message)
            else:
                self._healths.add_estimate(place, message, now_s)
        self.changed.set()

    def has_monitor(self) -> bool:
        """Return whether a monitor has published its status."""
        with self._lock:
            return bool(self._monitors)

    def rows(self) -> list[Row]:
        """Return a row per actuator, worst first."""
        for liveliness in self._liveliness.values():
            liveliness.update(self._node)
        with self._lock:
            is_real = self._simulated_ns is None
            return self._healths.rows(
                time.monotonic(), self._clock_ns(), self._is_silent, is_real=is_real
            )

    def _is_silent(self, place: str, author: str) -> bool:
        return self._liveliness[place].is_silent(author)

    def _clock_ns(self) -> int:
        return time.time_ns() if self._simulated_ns is None else self._simulated_ns
