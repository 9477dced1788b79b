# SPDX-License-Identifier: Apache-2.0
"""Messages of a graph as plain values, read from a bag of all its topics."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from ema_bags.reader import Bag
from ema_bags.recording import Recorded
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window
from ema_ros.messages import description_from_message, telemetry_from_message
from ema_ros.stamps import stamp_from_message

_TYPES: Final = {
    "ema_interfaces/msg/TelemetryBlock",
    "ema_interfaces/msg/ActuatorDescription",
    "ema_interfaces/msg/FaultEstimate",
    "ema_interfaces/msg/Health",
    "diagnostic_msgs/msg/DiagnosticArray",
    "ema_interfaces/msg/PlaybackState",
    "rosgraph_msgs/msg/Clock",
}
_DROPPED: Final = "dropped: "


@dataclass(frozen=True)
class Block:
    """A block of telemetry; ``sent_ns`` is its publication time by the machine's clock [ns]."""

    actuator_id: str
    stamp_ns: int
    period_s: float
    first_index: int
    samples: int
    sent_ns: int


@dataclass(frozen=True)
class Answer:
    """A ``fault_estimate``: the estimate of a window, or its refusal."""

    actuator_id: str
    window: int
    start_ns: int
    end_ns: int
    valid: bool
    reason: str
    sent_ns: int

    @property
    def dropped(self) -> bool:
        """True if the window was dropped for later ones."""
        return self.reason.startswith(_DROPPED)


@dataclass(frozen=True)
class HealthNote:
    """A message of the topic ``health``."""

    actuator_id: str
    stamp_ns: int
    sent_ns: int


@dataclass(frozen=True)
class StatusNote:
    """A status on ``/diagnostics``."""

    name: str
    values: Mapping[str, str]
    sent_ns: int

    def count(self, key: str) -> int:
        """Return a count in the status; 0 if it has none."""
        return int(self.values.get(key, "0"))


@dataclass(frozen=True)
class FoundWindow:
    """A window in the recorded telemetry; ``sent_ns`` is the time of its last block [ns]."""

    actuator_id: str
    start_ns: int
    end_ns: int
    sent_ns: int


@dataclass
class GraphRecord:
    """Messages of a graph; each list is in the order of publication.

    Attributes
    ----------
    clock_ns
        Times on ``/clock`` [ns]; empty without simulated time.
    jumps_ns
        Times at which a player reported a jump [ns].
    end_ns
        Time of the last message [ns].
    standstills
        Log times of begin and end of each standstill that the recorder reported [ns].
    """

    blocks: list[Block] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)
    healths: list[HealthNote] = field(default_factory=list)
    statuses: list[StatusNote] = field(default_factory=list)
    found: list[FoundWindow] = field(default_factory=list)
    clock_ns: list[int] = field(default_factory=list)
    jumps_ns: list[int] = field(default_factory=list)
    end_ns: int = 0
    standstills: list[tuple[int, int]] = field(default_factory=list)

    def actuators(self) -> list[str]:
        """Return the names of the actuators."""
        items = (*self.blocks, *self.answers, *self.healths)
        return sorted({item.actuator_id for item in items})


def read_graph(path: Path) -> GraphRecord:
    """Read the messages of a graph from a bag.

    Raises
    ------
    ValueError, FileNotFoundError
        If the bag cannot be read.
    """
    bag = Bag(path)
    record = GraphRecord()
    record.standstills = [(gap.start_ns, gap.end_ns) for gap in bag.gaps if not gap.messages]
    record.end_ns = bag.end_ns or 0
    finders = defaultdict[str, WindowFinder](lambda: WindowFinder(TriggerSettings()))
    seen: set[tuple[str, int, int]] = set()
    for item in bag.messages(bag.topics_of(*_TYPES)):
        sent_ns = item.publish_time_ns
        # A recorder that was disconnected receives latched messages again.
        key = (item.topic, sent_ns, hash(str(getattr(item.message, "actuator_id", ""))))
        if item.type_name.endswith(("Health", "FaultEstimate")):
            if key in seen:
                continue
            seen.add(key)
        _note(record, finders, item, sent_ns)
    for items in (record.blocks, record.answers, record.healths, record.statuses, record.found):
        items.sort(key=lambda entry: entry.sent_ns)
    return record


def _note(
    record: GraphRecord, finders: dict[str, WindowFinder], item: Recorded, sent_ns: int
) -> None:
    message, kind = item.message, item.type_name.rpartition("/")[2]
    if kind == "Clock":
        record.clock_ns.append(stamp_from_message(message.clock))
    elif kind == "PlaybackState":
        record.jumps_ns += [sent_ns] if message.jumped else []
    elif kind == "DiagnosticArray":
        record.statuses += (_status(status, sent_ns) for status in message.status)
    elif kind == "Health":
        record.healths.append(
            HealthNote(message.actuator_id, stamp_from_message(message.header.stamp), sent_ns)
        )
    elif kind == "FaultEstimate":
        record.answers.append(_answer(message, sent_ns))
    elif kind == "ActuatorDescription":
        description = description_from_message(message)
        finder = finders[description.actuator_id]
        _add_found(record, finder.describe(description), sent_ns)
    else:
        block = telemetry_from_message(message)
        name = message.actuator_id
        record.blocks.append(
            Block(name, block.stamp_ns, block.sample_period, block.first_index, len(block), sent_ns)
        )
        _add_found(record, finders[name].feed(block), sent_ns)


def _add_found(record: GraphRecord, events: Iterable[Any], sent_ns: int) -> None:
    for event in events:
        if isinstance(event, Segment) and isinstance(event.window, Window):
            window, name = event.window, event.description.actuator_id
            record.found.append(FoundWindow(name, window.start_ns, window.end_ns, sent_ns))


def _status(status: Any, sent_ns: int) -> StatusNote:
    return StatusNote(status.name, {pair.key: pair.value for pair in status.values}, sent_ns)


def _answer(message: Any, sent_ns: int) -> Answer:
    return Answer(
        message.actuator_id,
        message.window,
        stamp_from_message(message.window_start),
        stamp_from_message(message.window_end),
        bool(message.valid),
        message.reason,
        sent_ns,
    )
