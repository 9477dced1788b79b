# SPDX-License-Identifier: Apache-2.0
"""Collection of messages, and recognition of the joints on their topics."""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.doubts import Doubt, DoubtKind
from ema_bags.inputs.guess import Guess
from ema_bags.inputs.joint_messages import is_payload, is_read, read_message
from ema_bags.inputs.joint_sources import EFFORT_UNIT, JointSources, Offer, joint_sources
from ema_bags.inputs.mapping import AngleSource
from ema_bags.inputs.recognition import Hint, Recognizer
from ema_bags.inputs.series import NO_STAMP, Series, value_at


class _Row(NamedTuple):
    stamp_ns: int
    arrival_ns: int
    form: Hashable
    values: NDArray[np.float64]


@dataclass
class _Topic:
    kind: str
    rows: list[_Row] = field(default_factory=list)
    columns: dict[Hashable, list[tuple[str, str]]] = field(default_factory=dict)
    """Joint and field path of each value of a row, by form."""


@dataclass(frozen=True, eq=False)
class _Samples:
    """Samples of one joint on one topic."""

    topic: str
    kind: str
    joint: str
    series: Series
    """Values by field path."""

    @property
    def offer(self) -> Offer:
        """The fields with at least two finite values."""
        finite = {path: _finite(values) for path, values in self.series.values.items()}
        present = {path: values for path, values in finite.items() if len(values) > 1}
        constant = {path for path, values in present.items() if float(np.ptp(values)) == 0.0}
        return Offer(self.topic, self.kind, self.joint, present.keys() - constant, constant)


@dataclass(frozen=True, eq=False)
class TopicJoint:
    """A joint recognised on topics."""

    guess: Guess
    """Recognised mapping of the joint."""

    by_topic: Mapping[str, Series]
    """Mapped series of the joint, by topic."""

    travel: float
    """Travel of the position, in the unit of the topic."""


class JointTopics:
    """Collects messages of a robot, live or recorded, and recognises its joints.

    Joints may appear in any order and on several topics: ``sensor_msgs/msg/JointState``,
    ``control_msgs/msg/DynamicJointState``, the controller states of ros2_control, and commands as
    ``std_msgs`` numbers. A topic named ``payload`` has the payload of the robot in its namespace.
    """

    def __init__(self) -> None:
        self._topics: dict[str, _Topic] = {}

    @property
    def topics(self) -> dict[str, str]:
        """Message type by topic, for the topics with messages."""
        return {name: topic.kind for name, topic in self._topics.items()}

    def add(self, topic: str, kind: str, message: Any, sent_ns: int, received_ns: int) -> None:
        """Add a message, unless it can have neither joints nor a payload.

        Parameters
        ----------
        topic, kind
            Topic and message type.
        message
            The message.
        sent_ns, received_ns
            Publication time (0 if unknown) and reception time [ns].
        """
        if not is_read(topic, kind):
            return
        collected = self._topics.setdefault(topic, _Topic(kind))
        reading = read_message(kind, message)
        if reading.form not in collected.columns:
            collected.columns[reading.form] = reading.columns()
        header = getattr(message, "header", None)
        stamp = NO_STAMP
        if header is not None:
            stamp = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec or NO_STAMP
        collected.rows.append(_Row(stamp, sent_ns or received_ns, *reading[:2]))

    def joints(self, effort_unit: str = EFFORT_UNIT) -> list[TopicJoint]:
        """Return the recognised joints, in the order in which they appear.

        Parameters
        ----------
        effort_unit
            Unit of the effort, unless the field name denotes a current.
        """
        samples = [item for name in self._topics for item in self._samples(name)]
        of_topics = {(item.topic, item.joint): item for item in samples}
        offers = _without_repeated([item for item in samples if item.joint])
        payloads = {item.topic for item in samples if is_payload(item.topic, item.kind)}
        joints = [
            _joint(sources, of_topics, effort_unit)
            for sources in joint_sources(offers, payloads=payloads)
        ]
        numbers = [item for item in samples if not item.joint and item.topic not in payloads]
        return _with_commands(joints, numbers)

    def _samples(self, name: str) -> Iterator[_Samples]:
        """Yield the samples of each joint of a topic."""
        topic = self._topics[name]
        parts: dict[str, list[Series]] = {}
        for form, rows in groupby(topic.rows, lambda row: row.form):
            block = list(rows)
            stamps = np.array([row.stamp_ns for row in block], dtype=np.int64)
            arrivals = np.array([row.arrival_ns for row in block], dtype=np.int64)
            table = np.array([row.values for row in block], dtype=float).T
            by_joint: dict[str, dict[str, NDArray[np.float64]]] = {}
            for (joint, path), values in zip(topic.columns[form], table, strict=True):
                # If a name occurs twice, the first value is used.
                by_joint.setdefault(joint, {}).setdefault(path, np.ascontiguousarray(values))
            for joint, columns in by_joint.items():
                parts.setdefault(joint, []).append(Series(stamps, arrivals, columns))
        for joint, series in parts.items():
            yield _Samples(name, topic.kind, joint, _joined(series))


def _joined(parts: Sequence[Series]) -> Series:
    """Concatenate series; fields that a part lacks become NaN."""
    paths = dict.fromkeys(path for part in parts for path in part.values)
    return Series(
        np.concatenate([part.stamps_ns for part in parts]),
        np.concatenate([part.arrivals_ns for part in parts]),
        {
            path: np.concatenate(
                [part.values.get(path, np.full(len(part), np.nan)) for part in parts]
            )
            for path in paths
        },
    )


def _without_repeated(samples: Sequence[_Samples]) -> list[Offer]:
    """Return the offers of all topics, except states that repeat the positions of another topic.

    Topics in different namespaces repeat each other if their positions have equal extremes.
    """
    offers: list[Offer] = []
    seen: dict[tuple[str, float, float], Offer] = {}
    for item in samples:
        offer = item.offer
        path = offer.path_of("position") if offer.is_state else ""
        if path:
            values = _finite(item.series.values[path])
            key = item.joint, float(np.min(values)), float(np.max(values))
            first = seen.setdefault(key, offer)
            if first is not offer and first.namespace != offer.namespace:
                continue
        offers.append(offer)
    return offers


def _joint(
    sources: JointSources, samples: Mapping[tuple[str, str], _Samples], effort_unit: str
) -> TopicJoint:
    """Return a joint with its mapping, doubts and series."""
    name = sources.key.joint
    mapping = sources.mapping(effort_unit)
    doubts: list[Doubt] = []
    if mapping.current is not None:
        doubts.append(Doubt(DoubtKind.EFFORT_KIND, "current", mapping.current.source))
    doubts += [
        Doubt(DoubtKind.NOT_FOUND, quantity)
        for quantity in ("speed", "current")
        if quantity not in sources.paths
    ]
    by_topic: dict[str, Series] = {}
    for quantity, (topic, path) in sources.paths.items():
        series = samples[topic, "" if quantity == "payload" else name].series
        values = {quantity: series.values[path]}
        if topic in by_topic:
            values = {**by_topic[topic].values, **values}
        by_topic[topic] = Series(series.stamps_ns, series.arrivals_ns, values)
    travel = float(np.ptp(_finite(by_topic[sources.home].values["position"])))
    return TopicJoint(Guess(mapping, tuple(doubts), sources.key.actuator), by_topic, travel)


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return values[np.isfinite(values)]


def _with_commands(joints: Sequence[TopicJoint], numbers: Sequence[_Samples]) -> list[TopicJoint]:
    """Assign numbers without joint names to the joints that follow them.

    If no joint follows a number, the number may still be the command of the joint that moves most.
    """
    options = [(item, path) for item in numbers for path in item.series.values]
    is_command = {item.topic: "command" in item.topic.lower() for item, _ in options}
    options.sort(key=lambda option: not is_command[option[0].topic])
    completed = []
    farthest = max(joints, key=lambda joint: joint.travel, default=None)
    for joint in joints:
        if joint.guess.mapping.command is not None:
            completed.append(joint)
            continue
        followed = _followed(joint, options)
        if followed is not None:
            completed.append(_commanded(joint, followed, ()))
        elif options and joint is farthest:
            item, path = options[0]
            guessed = Doubt(DoubtKind.ELEMENT_GUESSED, "command", path)
            by_name = Doubt(DoubtKind.NAME_ALONE, "command", f"{item.topic} {path}")
            completed.append(_commanded(joint, options[0], (guessed, by_name)))
        else:
            doubt = Doubt(DoubtKind.NO_COMMAND, "command")
            guess = joint.guess
            guess = replace(guess, doubts=(*guess.doubts, doubt))
            completed.append(TopicJoint(guess, joint.by_topic, joint.travel))
    return completed


def _followed(
    joint: TopicJoint, options: Sequence[tuple[_Samples, str]]
) -> tuple[_Samples, str] | None:
    """Return the published number that a joint's position follows; None if there is none."""
    primary = joint.by_topic[joint.guess.mapping.position.topic]
    at = primary.arrivals_ns
    if len(at) < 2 or not options:
        return None
    columns = {"position": primary.values["position"]}
    for number, (item, path) in enumerate(options):
        columns[str(number)] = value_at(item.series, path, at, holds=True)
    period = 1e-9 * float(np.median(np.diff(at)))
    recognizer = Recognizer(
        columns, period, lambda name: Hint(frozenset({"position"}), is_commanded=name != "position")
    )
    for candidates in recognizer.joints():
        command = candidates.columns.get("command")
        if candidates.columns["position"].name == "position" and command and command.is_confirmed:
            return options[int(command.name)]
    return None


def _commanded(
    joint: TopicJoint, option: tuple[_Samples, str], doubts: Iterable[Doubt]
) -> TopicJoint:
    item, path = option
    mapping, guess = joint.guess.mapping, joint.guess
    # A setpoint without a stamp holds until the next message.
    command = AngleSource(path, item.topic, between="hold")
    mapping = replace(mapping, command=command)
    series = Series(
        item.series.stamps_ns, item.series.arrivals_ns, {"command": item.series.values[path]}
    )
    return TopicJoint(
        Guess(mapping, (*guess.doubts, *doubts), guess.joint),
        {**joint.by_topic, item.topic: series},
        joint.travel,
    )
