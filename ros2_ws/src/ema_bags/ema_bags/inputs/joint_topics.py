# SPDX-License-Identifier: Apache-2.0
"""Recognition of the joints on topics: collected messages, and the mapping of each joint."""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.doubts import Doubt, DoubtKind
from ema_bags.inputs.guess import Guess
from ema_bags.inputs.joint_finder import CONTROLLER_STATE, JOINT_STATE, actuator_name, is_command
from ema_bags.inputs.mapping import (
    AngleSource,
    Clock,
    ColumnMapping,
    CurrentSource,
    SpeedSource,
    TemperatureSource,
)
from ema_bags.inputs.recognition import Hint, Recognizer
from ema_bags.inputs.series import NO_STAMP, Series, value_at

DYNAMIC_JOINT_STATE: Final = "control_msgs/msg/DynamicJointState"
PID_STATE: Final = "control_msgs/msg/SingleDOFStateStamped"
NUMBERS: Final = frozenset(
    f"std_msgs/msg/{kind}"
    for kind in ("Float64", "Float32", "Float64MultiArray", "Float32MultiArray")
)
KINDS: Final = frozenset((JOINT_STATE, DYNAMIC_JOINT_STATE, CONTROLLER_STATE, PID_STATE, *NUMBERS))
"""Message types from which joints are recognised."""

_COMMANDED: Final = "commanded joint state"
"""Kind of a joint state topic that is named like a command, such as ``joint_commands``."""

_ARRAYS: Final = {
    JOINT_STATE: ("position", "velocity", "effort"),
    CONTROLLER_STATE: (
        *("feedback.positions", "feedback.velocities", "reference.positions"),
        *("actual.positions", "actual.velocities", "desired.positions"),
    ),
}
_PID_FIELDS: Final = ("reference", "feedback", "feedback_dot", "output")
_SELECT: Final = "interface_values[joint_names={joint}].values[interface_names=%s]"
_CHOICES: Final[dict[str, tuple[tuple[str, tuple[str, ...]], ...]]] = {
    "position": (
        (JOINT_STATE, ("position",)),
        (DYNAMIC_JOINT_STATE, (_SELECT % "position",)),
        (CONTROLLER_STATE, ("feedback.positions", "actual.positions")),
        (PID_STATE, ("dof_state.feedback",)),
    ),
    "speed": (
        (JOINT_STATE, ("velocity",)),
        (DYNAMIC_JOINT_STATE, (_SELECT % "velocity",)),
        (CONTROLLER_STATE, ("feedback.velocities", "actual.velocities")),
        (PID_STATE, ("dof_state.feedback_dot",)),
    ),
    "current": (
        (JOINT_STATE, ("effort",)),
        (DYNAMIC_JOINT_STATE, tuple(_SELECT % n for n in ("effort", "torque", "current"))),
    ),
    "command": (
        (CONTROLLER_STATE, ("reference.positions", "desired.positions")),
        (PID_STATE, ("dof_state.reference",)),
        (_COMMANDED, ("position",)),
    ),
    "temperature": (
        (DYNAMIC_JOINT_STATE, tuple(_SELECT % n for n in ("temperature", "motor_temperature"))),
    ),
}
"""Message types and field paths of each quantity, the preferred first."""

_SPEED_OF_JOINT: Final = "user"


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
    series: Series
    """Values by field path."""

    @property
    def namespace(self) -> str:
        return self.topic.rpartition("/")[0]

    def is_measured(self, path: str) -> bool:
        """Return whether a field has at least two finite values."""
        values = self.series.values.get(path)
        return values is not None and int(np.count_nonzero(np.isfinite(values))) > 1

    def is_constant(self, path: str) -> bool:
        values = self.series.values[path]
        values = values[np.isfinite(values)]
        return float(np.ptp(values)) == 0.0


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
    ``std_msgs`` numbers.
    """

    def __init__(self) -> None:
        self._topics: dict[str, _Topic] = {}

    @property
    def topics(self) -> dict[str, str]:
        """Message type by topic, for the topics with messages."""
        return {name: topic.kind for name, topic in self._topics.items()}

    def add(self, topic: str, kind: str, message: Any, sent_ns: int, received_ns: int) -> None:
        """Add a message; messages of types that hold no joints are ignored.

        Parameters
        ----------
        topic, kind
            Topic and message type.
        message
            The message.
        sent_ns, received_ns
            Publication time (0 if unknown) and reception time [ns].
        """
        if kind not in KINDS:
            return
        held = self._topics.setdefault(topic, _Topic(kind))
        form, values, columns = _read(kind, message)
        if form not in held.columns:
            held.columns[form] = columns()
        header = getattr(message, "header", None)
        stamp = NO_STAMP
        if header is not None:
            stamp = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec or NO_STAMP
        held.rows.append(_Row(stamp, sent_ns or received_ns, form, values))

    def joints(self) -> list[TopicJoint]:
        """Return the recognised joints, in the order in which they appear."""
        samples = [item for name in self._topics for item in self._samples(name)]
        by_joint: dict[str, list[_Samples]] = {}
        numbers: list[_Samples] = []
        for joint, item in samples:
            if joint:
                by_joint.setdefault(joint, []).append(item)
            else:
                numbers.append(item)
        candidates = [
            (joint, item, position, len(positions) > 1)
            for joint, item in by_joint.items()
            if (positions := _positions(item))
            for position in positions
        ]
        joints = [
            _joint(name, samples, position, is_ambiguous=is_ambiguous)
            for name, samples, position, is_ambiguous in candidates
        ]
        return _with_commands(joints, numbers)

    def _samples(self, name: str) -> Iterator[tuple[str, _Samples]]:
        """Yield each joint of a topic with its samples."""
        topic = self._topics[name]
        parts: dict[str, list[Series]] = {}
        for form, rows in groupby(topic.rows, lambda row: row.form):
            block = list(rows)
            stamps = np.array([row.stamp_ns for row in block], dtype=np.int64)
            arrivals = np.array([row.arrival_ns for row in block], dtype=np.int64)
            table = np.array([row.values for row in block], dtype=float).T
            by_joint: dict[str, dict[str, NDArray[np.float64]]] = {}
            for (joint, path), values in zip(topic.columns[form], table, strict=True):
                # Of a name that occurs twice, the first value counts.
                by_joint.setdefault(joint, {}).setdefault(path, np.ascontiguousarray(values))
            for joint, columns in by_joint.items():
                parts.setdefault(joint, []).append(Series(stamps, arrivals, columns))
        kind = _COMMANDED if topic.kind == JOINT_STATE and is_command(name) else topic.kind
        for joint, series in parts.items():
            yield joint, _Samples(name, kind, _joined(series))


def _read(
    kind: str, message: Any
) -> tuple[Hashable, NDArray[np.float64], Callable[[], list[tuple[str, str]]]]:
    """Return form and values of a message, and what lists joint and path of each value."""
    if kind in _ARRAYS:
        names = tuple(getattr(message, "name", ()) or getattr(message, "joint_names", ()))
        present = [(path, _array(message, path)) for path in _ARRAYS[kind]]
        arrays = [(path, values[: len(names)]) for path, values in present if len(values)]
        form = names, *((path, len(values)) for path, values in arrays)
        values = np.concatenate([np.empty(0), *(values for _, values in arrays)])
        return (
            form,
            values,
            lambda: [(n, path) for path, v in arrays for n, _ in zip(names, v, strict=False)],
        )
    if kind == DYNAMIC_JOINT_STATE:
        pairs = list(zip(message.joint_names, message.interface_values, strict=False))
        form = tuple((joint, tuple(item.interface_names)) for joint, item in pairs)
        return (
            form,
            np.array([v for _, item in pairs for v in item.values], dtype=float),
            lambda: [(joint, _SELECT % name) for joint, names in form for name in names],
        )
    if kind == PID_STATE:
        state = message.dof_state
        return (
            state.name,
            np.array([getattr(state, name) for name in _PID_FIELDS], dtype=float),
            lambda: [(state.name, f"dof_state.{name}") for name in _PID_FIELDS],
        )
    data = np.atleast_1d(np.asarray(message.data, dtype=float))
    is_array = kind.endswith("Array")
    return (
        len(data),
        data,
        lambda: [("", f"data[{k}]" if is_array else "data") for k in range(len(data))],
    )


def _array(message: Any, path: str) -> NDArray[np.float64]:
    value = message
    for name in path.split("."):
        value = getattr(value, name, ())
    return np.asarray(value, dtype=float)


def _joined(parts: Sequence[Series]) -> Series:
    """Return one series; fields that a part lacks are NaN."""
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


def _positions(samples: Sequence[_Samples]) -> list[tuple[_Samples, str]]:
    """Return the measured positions of a joint name: one for each robot that has the name."""
    for kind, paths in _CHOICES["position"]:
        candidates = [
            (item, path)
            for item in samples
            for path in paths
            if item.kind == kind and item.is_measured(path)
        ]
        distinct: dict[tuple[float, float], tuple[_Samples, str]] = {}
        for item, path in candidates:
            values = item.series.values[path]
            reach = float(np.nanmin(values)), float(np.nanmax(values))
            # Two topics with equal values repeat each other.
            distinct.setdefault(reach, (item, path))
        if distinct:
            return list(distinct.values())
    return []


def _joint(
    name: str, samples: Sequence[_Samples], position: tuple[_Samples, str], *, is_ambiguous: bool
) -> TopicJoint:
    """Return a joint with its measured quantities and its command from the controller."""
    home, path = position
    chosen: dict[str, tuple[_Samples, str]] = {"position": position}
    # Topics of the same namespace belong to the same robot.
    near = sorted(samples, key=lambda item: item.namespace != home.namespace)
    if is_ambiguous:
        near = [item for item in near if item.namespace == home.namespace]
    for quantity in ("speed", "current", "command", "temperature"):
        options = [
            (item, option)
            for kind, paths in _CHOICES[quantity]
            for item in near
            for option in paths
            if item.kind == kind and item.is_measured(option)
        ]
        # A constant effort is not published; prefer one that varies.
        options.sort(key=lambda option: option[0].is_constant(option[1]))
        if options:
            chosen[quantity] = options[0]
    doubts: list[Doubt] = []
    sources: dict[str, Any] = {}
    for quantity, (item, option) in chosen.items():
        if quantity == "speed":
            sources[quantity] = SpeedSource(option, item.topic, shaft=_SPEED_OF_JOINT)
        elif quantity == "current":
            sources[quantity] = CurrentSource(option, item.topic)
            doubts.append(Doubt(DoubtKind.EFFORT_KIND, quantity, option))
        elif quantity == "temperature":
            sources[quantity] = TemperatureSource(option, item.topic)
        else:
            sources[quantity] = AngleSource(option, item.topic)
    doubts += [
        Doubt(DoubtKind.NOT_FOUND, quantity)
        for quantity in ("speed", "current")
        if quantity not in sources
    ]
    mapping = ColumnMapping(**sources, joint=name, clock=Clock("header"))
    label = actuator_name(home.topic, name) if is_ambiguous else name
    by_topic: dict[str, Series] = {}
    for quantity, (item, option) in chosen.items():
        values = {quantity: item.series.values[option]}
        if item.topic in by_topic:
            values = {**by_topic[item.topic].values, **values}
        by_topic[item.topic] = Series(item.series.stamps_ns, item.series.arrivals_ns, values)
    travel = float(np.ptp(_finite(home.series.values[path])))
    return TopicJoint(Guess(mapping, tuple(doubts), label), by_topic, travel)


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
            alone = Doubt(DoubtKind.NAME_ALONE, "command", f"{item.topic} {path}")
            completed.append(_commanded(joint, options[0], (guessed, alone)))
        else:
            doubt = Doubt(DoubtKind.NO_COMMAND, "command")
            guess = joint.guess
            guess = Guess(guess.mapping, (*guess.doubts, doubt), guess.joint)
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
    sources: dict[str, Any] = {
        name: getattr(mapping, name) for name in ("position", "speed", "current", "temperature")
    }
    mapping = ColumnMapping(**sources, command=command, joint=mapping.joint, clock=mapping.clock)
    series = Series(
        item.series.stamps_ns, item.series.arrivals_ns, {"command": item.series.values[path]}
    )
    return TopicJoint(
        Guess(mapping, (*guess.doubts, *doubts), guess.joint),
        {**joint.by_topic, item.topic: series},
        joint.travel,
    )
