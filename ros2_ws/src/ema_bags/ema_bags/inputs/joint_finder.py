# SPDX-License-Identifier: Apache-2.0
"""Detection of the joints of running robots, and of their columns, from messages."""

from collections.abc import Sequence, Set
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree

import numpy as np

from ema_bags.inputs.joint_messages import PATHS, is_payload, names_of, read_message
from ema_bags.inputs.joint_sources import (
    EFFORT_UNIT,
    JointKey,
    JointSources,
    Offer,
    joint_sources,
    namespace_of,
)
from ema_bags.inputs.mapping import ColumnMapping
from ema_core.description import check_name

DESCRIPTION_TOPIC: Final = "robot_description"
"""Name of the topic with a robot's URDF, in the namespace of its joint states."""

FIND_S: Final = 1.0
"""Time from the first message of a joint until its columns are decided [s]."""

MOST_JOINTS: Final = 100
"""Default limit of the number of joints."""

_EFFORTS: Final = frozenset(path for _, paths in PATHS["current"] for path in paths)
_LEAST_MESSAGES: Final = 10
# Once its joints are known, a message is examined once per second.
_RECHECK_NS: Final = 1_000_000_000
# Time without the joint after which it is silent: several rechecks.
_SILENT_NS: Final = 3_000_000_000
_MOST_ORDERS: Final = 100
_MOST_NAMES: Final = 1000
_MOST_REFUSED: Final = 100


class JointGroup(NamedTuple):
    """Joints that share topics and have the same columns."""

    mapping: ColumnMapping
    """Mapping that lists the joints."""
    names: dict[str, str]
    """Actuator name by joint: the joint's name, prefixed with the robot's namespace if any."""


@dataclass
class _Joint:
    """Fields of one joint received so far on one topic."""

    first_ns: int
    latest_ns: int
    messages: int = 0
    paths: set[str] = field(default_factory=set)
    """Fields that had a finite value; an effort field only if the value was not 0."""

    def is_decidable(self, now_ns: int) -> bool:
        return self.messages >= _LEAST_MESSAGES and now_ns - self.first_ns >= 1e9 * FIND_S


@dataclass
class _Topic:
    """Joints of one topic."""

    kind: str
    joints: dict[str, _Joint] = field(default_factory=dict)
    next_ns: dict[tuple[str, ...], int] = field(default_factory=dict)
    """Time from which messages with these names are examined again [ns]."""


class JointFinder:
    """Finds the joints of running robots, and the columns of each joint.

    `joint_sources` describes which topics are chosen. An effort that is always 0 counts as not
    published. If the topic of a joint is silent for 3 s, another topic with the joint replaces it.

    Parameters
    ----------
    joints
        Patterns of the actuator names to find, such as ``left/*``; empty for all joints.
    effort_unit
        Unit of the effort: ``N.m``, ``A`` or ``N``; for prismatic joints, N replaces N.m.
    topics
        Full names of the topics from which positions are read; empty for all.
    most
        Largest number of joints.

    Attributes
    ----------
    refused
        Reason why a joint that matches is refused, keyed by topic and joint.
    surplus
        Actuators that are ignored because the limit ``most`` is reached.
    """

    def __init__(
        self,
        joints: Sequence[str] = (),
        effort_unit: str = EFFORT_UNIT,
        topics: Sequence[str] = (),
        most: int = MOST_JOINTS,
    ) -> None:
        self._patterns = tuple(joints)
        self._effort_unit = effort_unit
        self._allowed = frozenset(topics)
        self._most = most
        self._topics: dict[str, _Topic] = {}
        self._payloads: set[str] = set()
        self._prismatic: dict[str, set[str]] = {}
        self._decided: dict[JointKey, JointSources] = {}
        self._actuators: dict[str, JointKey] = {}
        # Number of changes of fields and payloads, and the situation of the latest decision.
        self._changes = 0
        self._situation: tuple[int, int, frozenset[tuple[str, str]]] | None = None
        self.refused: dict[tuple[str, str], str] = {}
        self.surplus: set[str] = set()

    def add(self, topic: str, kind: str, message: Any, received_ns: int) -> None:
        """Examine a message.

        Parameters
        ----------
        topic, kind
            Full name of the topic, and message type: one of ``JOINT_KINDS``, or of a payload.
        message
            The message.
        received_ns
            Reception time, from any clock [ns].
        """
        if is_payload(topic, kind):
            self._changes += topic not in self._payloads
            self._payloads.add(topic)
            return
        state = self._topics.setdefault(topic, _Topic(kind))
        names = names_of(message)
        if received_ns < state.next_ns.get(names, 0):
            return
        reading = read_message(kind, message)
        is_present = np.isfinite(reading.values)
        is_zero = reading.values == 0.0
        seen: set[str] = set()
        columns = zip(reading.columns(), is_present, is_zero, strict=True)
        for (name, path), present, zero in columns:
            joint = state.joints.get(name)
            if joint is None:
                if len(state.joints) >= _MOST_NAMES:
                    self._refuse(topic, "", f"{topic} has more than {_MOST_NAMES} joint names")
                    continue
                joint = state.joints[name] = _Joint(received_ns, received_ns)
                self._changes += 1
            if name not in seen:
                seen.add(name)
                joint.messages += 1
                joint.latest_ns = received_ns
            if present and path not in joint.paths and not (zero and path in _EFFORTS):
                joint.paths.add(path)
                self._changes += 1
        if all(joint.is_decidable(received_ns) for joint in map(state.joints.get, seen) if joint):
            if len(state.next_ns) >= _MOST_ORDERS:
                state.next_ns.clear()
            state.next_ns[names] = received_ns + _RECHECK_NS

    def describe(self, topic: str, urdf: str) -> str:
        """Read the joint types from a robot description; return the reason if unusable, else "".

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
            return f"{topic} is not a robot description: {error}; all joints are assumed rotary"
        self._prismatic[namespace_of(topic)] = prismatic
        return ""

    def found(self, now_ns: int) -> list[JointGroup]:
        """Return the joints that are new, or whose columns or topics have changed.

        Changes are relative to the last call. The mapping of a joint replaces its earlier mapping.
        """
        silent, undecidable = self._silent(now_ns), self._undecidable(now_ns)
        situation = self._changes, undecidable, silent
        if situation == self._situation:
            return []
        self._situation = situation
        homes = {key: sources.home for key, sources in self._decided.items()}
        groups: dict[tuple[str, bool, str], list[JointSources]] = {}
        for sources in joint_sources(self._offers(silent), homes, self._allowed, self._payloads):
            key, topic = sources.key, sources.home
            if not self._topics[topic].joints[key.joint].is_decidable(now_ns):
                continue
            if sources == self._decided.get(key) or not self._is_wanted(sources):
                continue
            is_linear = key.joint in self._prismatic.get(key.robot, ())
            self._decided[key] = sources
            self._actuators[key.actuator] = key
            group = key.robot, is_linear, repr(sorted(sources.paths.items()))
            groups.setdefault(group, []).append(sources)
        return [self._group(members, is_linear=group[1]) for group, members in groups.items()]

    def _silent(self, now_ns: int) -> frozenset[tuple[str, str]]:
        """Return topic and name of each joint that is missing in the latest messages."""
        return frozenset(
            (topic, name)
            for topic, state in self._topics.items()
            for name, joint in state.joints.items()
            if now_ns - joint.latest_ns > _SILENT_NS
        )

    def _undecidable(self, now_ns: int) -> int:
        """Return the number of joints with too few messages to decide."""
        return sum(
            not joint.is_decidable(now_ns)
            for state in self._topics.values()
            for joint in state.joints.values()
        )

    def _offers(self, silent: Set[tuple[str, str]]) -> list[Offer]:
        return [
            Offer(topic, state.kind, name, joint.paths, is_silent=(topic, name) in silent)
            for topic, state in self._topics.items()
            for name, joint in state.joints.items()
        ]

    def _group(self, members: Sequence[JointSources], *, is_linear: bool) -> JointGroup:
        names = {member.key.joint: member.key.actuator for member in members}
        mapping = members[0].mapping(self._effort_unit, is_linear=is_linear, joints=tuple(names))
        return JointGroup(mapping, names)

    def _is_wanted(self, sources: JointSources) -> bool:
        """Return whether a joint matches the patterns, has a usable name, and is not surplus."""
        key, topic = sources.key, sources.home
        actuator = key.actuator
        if key in self._decided:
            return True
        try:
            check_name("joint", actuator)
        except ValueError as error:
            self._refuse(topic, key.joint, f"{topic}: {error}")
            return False
        if self._patterns and not any(fnmatchcase(actuator, item) for item in self._patterns):
            return False
        holder = self._actuators.get(actuator)
        if holder is not None:
            holder_topic = self._decided[holder].home
            self._refuse(
                *(topic, key.joint),
                f"joint {key.joint!r} on {topic} and joint {holder.joint!r} on {holder_topic} "
                f"would both be the actuator {actuator}: rename one, or select topics with "
                "state_topics",
            )
            return False
        if len(self._decided) >= self._most:
            if len(self.surplus) < _MOST_REFUSED:
                self.surplus.add(actuator)
            return False
        return True

    def _refuse(self, topic: str, joint: str, reason: str) -> None:
        if len(self.refused) < _MOST_REFUSED:
            self.refused[topic, joint] = reason
