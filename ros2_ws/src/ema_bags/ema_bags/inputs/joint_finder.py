# SPDX-License-Identifier: Apache-2.0
"""Detection of joints and their columns in joint state topics."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree

import numpy as np

from ema_bags.inputs.joint_states import REFERENCE
from ema_bags.inputs.mapping import AngleSource, Clock, ColumnMapping, CurrentSource, SpeedSource
from ema_bags.inputs.names import roles_of
from ema_core.description import check_name

JOINT_STATE: Final = "sensor_msgs/msg/JointState"
CONTROLLER_STATE: Final = "control_msgs/msg/JointTrajectoryControllerState"
DESCRIPTION_TOPIC: Final = "robot_description"
"""Name of the topic with a robot's URDF, in the namespace of its joint states."""

FIND_S: Final = 1.0
"""Time from the first message of a joint until its columns are decided [s]."""

_LEAST_MESSAGES: Final = 10
# Once all joints of a message are decided, only one message per second is examined.
_RECHECK_NS: Final = 1_000_000_000
_MOST_ORDERS: Final = 100
_MOST_REFUSED: Final = 100


class Columns(NamedTuple):
    """Columns that a joint is known to have, in addition to its position."""

    has_speed: bool = False
    """Whether any speed was a finite number."""
    has_effort: bool = False
    """Whether any effort was a finite number other than zero."""
    command: str = ""
    """Topic of the commanded position; empty if there is none."""
    command_field: str = ""
    """Field of the commanded position in the messages of ``command``."""


class JointGroup(NamedTuple):
    """Joints that share a topic and have the same columns."""

    mapping: ColumnMapping
    """Mapping of the joints, which it lists."""
    names: dict[str, str]
    """Actuator of each joint: the joint's name, after the robot's namespace if it has one."""


@dataclass
class _Joint:
    """Columns of one joint, as seen in messages so far."""

    first_ns: int
    messages: int = 0
    has_speed: bool = False
    has_effort: bool = False
    decided: Columns | None = None


@dataclass
class _Topic:
    """Joints of one joint state topic."""

    joints: dict[str, _Joint] = field(default_factory=dict)
    orders: set[tuple[str, ...]] = field(default_factory=set)
    next_ns: int = 0


class JointFinder:
    """Finds joints, and the columns that they have, from messages on joint state topics.

    A joint state topic named like a command, such as ``joint_commands``, has the commanded
    positions of the joints in its namespace, as has the state of a trajectory controller. Of two
    state topics in a namespace with the same joint, the first one counts, unless only the second
    has an effort.

    Parameters
    ----------
    joints
        Patterns of the actuator names to find, such as ``left/*``; empty for all joints.
    effort_unit
        Unit of the effort: ``N.m``, ``A`` or ``N``; for prismatic joints, N replaces N.m.

    Attributes
    ----------
    refused
        Why joints whose names are not valid for an actuator are not found, by topic and joint.
    """

    def __init__(self, joints: Sequence[str] = (), effort_unit: str = "N.m") -> None:
        self._patterns = tuple(joints)
        self._effort_unit = effort_unit
        self._states: dict[str, _Topic] = {}
        # Field of the commanded position, and the joints seen, by command topic.
        self._commands: dict[str, tuple[str, set[str]]] = {}
        self._prismatic: dict[str, set[str]] = {}
        self.refused: dict[tuple[str, str], str] = {}

    def add(self, topic: str, kind: str, message: Any, received_ns: int) -> None:
        """Examine a message.

        Parameters
        ----------
        topic, kind
            Full name of the topic, and message type: ``JOINT_STATE`` or ``CONTROLLER_STATE``.
        message
            The message.
        received_ns
            Reception time, from any clock [ns].
        """
        names = tuple(getattr(message, "name", ()) or getattr(message, "joint_names", ()))
        if kind == CONTROLLER_STATE or is_command(topic):
            field_name = REFERENCE if kind == CONTROLLER_STATE else "position"
            self._commands.setdefault(topic, (field_name, set()))[1].update(names)
            return
        state = self._states.setdefault(topic, _Topic())
        if names in state.orders and received_ns < state.next_ns:
            return
        state.orders.add(names)
        if len(state.orders) > _MOST_ORDERS:
            state.orders = {names}
        speeds = _are_numbers(message.velocity, len(names))
        efforts = _are_numbers(message.effort, len(names)) & (_filled(message.effort, names) != 0.0)
        for name, has_speed, has_effort in zip(names, speeds, efforts, strict=True):
            joint = state.joints.setdefault(name, _Joint(received_ns))
            joint.messages += 1
            joint.has_speed |= bool(has_speed)
            joint.has_effort |= bool(has_effort)
        if all(state.joints[name].decided is not None for name in names):
            state.next_ns = received_ns + _RECHECK_NS

    def describe(self, topic: str, urdf: str) -> str:
        """Read the joint types from a robot description; return why it is unusable, or "".

        Parameters
        ----------
        topic
            Full name of the topic of the description.
        urdf
            The description, as XML.
        """
        try:
            joints = ElementTree.fromstring(urdf).iter("joint")
            prismatic = {str(j.get("name")) for j in joints if j.get("type") == "prismatic"}
        except ElementTree.ParseError as error:
            return f"{topic} is not a robot description: {error}; all joints are taken as rotary"
        self._prismatic[namespace_of(topic)] = prismatic
        return ""

    def found(self, now_ns: int) -> list[JointGroup]:
        """Return joints that are new, or have columns that they lacked, since the last call.

        Such columns replace the earlier mapping of their joint.
        """
        groups: dict[tuple[str, bool, Columns], list[str]] = {}
        for topic, state in self._states.items():
            for name, joint in state.joints.items():
                if joint.decided is None and not _is_decidable(joint, now_ns):
                    continue
                columns = self._columns(topic, name, joint)
                if columns == joint.decided or not self._is_wanted(topic, name, columns):
                    continue
                is_linear = name in self._prismatic.get(namespace_of(topic), ())
                groups.setdefault((topic, is_linear, columns), []).append(name)
                joint.decided = columns
        return [
            JointGroup(
                self._mapping(topic, names, columns, is_linear=is_linear),
                {name: actuator_name(topic, name) for name in names},
            )
            for (topic, is_linear, columns), names in groups.items()
        ]

    def _is_wanted(self, topic: str, name: str, columns: Columns) -> bool:
        """Return whether a joint matches the patterns, and no better topic has it."""
        actuator = actuator_name(topic, name)
        try:
            check_name("joint", actuator)
        except ValueError as error:
            if len(self.refused) < _MOST_REFUSED:
                self.refused[topic, name] = f"{topic}: {error}"
            return False
        if self._patterns and not any(fnmatchcase(actuator, item) for item in self._patterns):
            return False
        rivals = (
            state.joints[name].decided
            for rival_topic, state in self._states.items()
            if rival_topic != topic
            and actuator_name(rival_topic, name) == actuator
            and name in state.joints
        )
        decided = [rival for rival in rivals if rival is not None]
        return not decided or (
            columns.has_effort and not any(rival.has_effort for rival in decided)
        )

    def _columns(self, topic: str, name: str, joint: _Joint) -> Columns:
        place = namespace_of(topic)
        for command, (field_name, names) in self._commands.items():
            if name in names and self._robot_of(command) == place:
                return Columns(joint.has_speed, joint.has_effort, command, field_name)
        return Columns(joint.has_speed, joint.has_effort)

    def _robot_of(self, command: str) -> str | None:
        """Return the innermost namespace with joint states that contains a command topic."""
        places = {namespace_of(topic) for topic in self._states}
        inside = [place for place in places if _is_within(command, place)]
        return max(inside, key=len, default=None)

    def _mapping(
        self, topic: str, names: Iterable[str], columns: Columns, *, is_linear: bool
    ) -> ColumnMapping:
        length, speed = ("m", "m/s") if is_linear else ("rad", "rad/s")
        unit = "N" if is_linear and self._effort_unit == "N.m" else self._effort_unit
        command = AngleSource(columns.command_field, columns.command, unit=length, between="hold")
        effort = CurrentSource(
            "effort", topic, unit=unit, kind="equivalent", sampling="instantaneous"
        )
        return ColumnMapping(
            position=AngleSource("position", topic, unit=length),
            command=command if columns.command else None,
            speed=SpeedSource("velocity", topic, unit=speed, shaft="user")
            if columns.has_speed
            else None,
            current=effort if columns.has_effort else None,
            joints=tuple(names),
            clock=Clock("header"),
        )


def is_command(topic: str) -> bool:
    """Return whether the name of a joint state topic suggests commanded positions."""
    return "command" in roles_of(topic.rpartition("/")[2])


def namespace_of(topic: str) -> str:
    """Return the namespace of a topic, without slashes at the ends; "" for the root."""
    return topic.rpartition("/")[0].strip("/")


def actuator_name(topic: str, joint: str) -> str:
    """Return the actuator name of a joint: unique among robots in different namespaces."""
    return "/".join(filter(None, (namespace_of(topic), joint)))


def _is_within(topic: str, place: str) -> bool:
    return not place or topic.strip("/").startswith(f"{place}/")


def _is_decidable(joint: _Joint, now_ns: int) -> bool:
    return joint.messages >= _LEAST_MESSAGES and now_ns - joint.first_ns >= 1e9 * FIND_S


def _filled(values: Any, names: Sequence[str]) -> Any:
    """Return an array of one value per name; NaN if the message has another number of values."""
    array = np.asarray(values, dtype=float)
    return array if len(array) == len(names) else np.full(len(names), np.nan)


def _are_numbers(values: Any, count: int) -> Any:
    array = np.asarray(values, dtype=float)
    return np.isfinite(array) if len(array) == count else np.zeros(count, dtype=bool)
