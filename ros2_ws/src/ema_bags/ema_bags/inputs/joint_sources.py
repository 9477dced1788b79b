# SPDX-License-Identifier: Apache-2.0
"""Selection of the topics of each joint: its actuator name, robot, and source of each quantity.

The same rules apply to running robots and to recordings.
"""

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, NamedTuple

from ema_bags.inputs.joint_messages import DYNAMIC_JOINT_STATE, JOINT_STATE, PATHS, is_electric
from ema_bags.inputs.mapping import (
    AngleSource,
    Clock,
    ColumnMapping,
    CurrentSource,
    PayloadSource,
    SpeedSource,
    TemperatureSource,
)
from ema_bags.inputs.names import roles_of

EFFORT_UNIT: Final = "N.m"
"""Unit of the effort in joint states of revolute joints; for prismatic joints, it is N."""

_COMMANDED: Final = "commanded joint state"
"""Kind of a joint state topic that is named like a command, such as ``joint_commands``."""

_PATHS: Final = PATHS | {"command": (*PATHS["command"], (_COMMANDED, ("position",)))}
_STATES: Final = (JOINT_STATE, DYNAMIC_JOINT_STATE)
_KINDS: Final = tuple(kind for kind, _ in PATHS["position"])


class Offer(NamedTuple):
    """Fields of one joint on one topic."""

    topic: str
    """Full name of the topic."""
    kind: str
    """Message type."""
    joint: str
    """Name of the joint in the messages."""
    varying: Set[str]
    """Field paths with usable values."""
    constant: Set[str] = frozenset()
    """Field paths with a constant value, used only if ``varying`` does not have the quantity."""
    is_silent: bool = False
    """Whether the joint is missing in the latest messages, or there are none."""

    @property
    def _kind(self) -> str:
        return _COMMANDED if self.kind == JOINT_STATE and is_command(self.topic) else self.kind

    def path_of(self, quantity: str) -> str:
        """Return the field path of a quantity; "" if the topic does not have it."""
        paths = [path for kind, paths in _PATHS[quantity] if kind == self._kind for path in paths]
        for present in (self.varying, self.constant):
            if path := next((path for path in paths if path in present), ""):
                return path
        return ""

    @property
    def namespace(self) -> str:
        """Namespace of the topic, without slashes at the ends; empty for the root."""
        return namespace_of(self.topic)

    @property
    def is_state(self) -> bool:
        """Whether the topic has measured states of a robot, rather than of a controller."""
        return self._kind in _STATES


class JointKey(NamedTuple):
    """A joint of a robot."""

    robot: str
    """Namespace of the robot, without slashes at the ends; empty for the root."""
    joint: str
    """Name of the joint in the messages."""

    @property
    def actuator(self) -> str:
        """Name of the actuator: the joint's name, prefixed with the robot's namespace if any."""
        return "/".join(filter(None, self))


@dataclass(frozen=True)
class JointSources:
    """Sources of the quantities of one joint."""

    key: JointKey
    paths: Mapping[str, tuple[str, str]]
    """Topic and field path, keyed by quantity; ``position`` is always present."""

    @property
    def home(self) -> str:
        """Topic of the position."""
        return self.paths["position"][0]

    def mapping(
        self,
        effort_unit: str = EFFORT_UNIT,
        *,
        is_linear: bool = False,
        joints: tuple[str, ...] = (),
    ) -> ColumnMapping:
        """Return the mapping of the joint.

        Parameters
        ----------
        effort_unit
            Unit of the effort, unless the field name denotes a current; for prismatic joints, N
            replaces N.m.
        is_linear
            Whether the joint is prismatic.
        joints
            Joints that share the mapping; empty for this joint alone.
        """
        length, speed = ("m", "m/s") if is_linear else ("rad", "rad/s")
        sources: dict[str, Any] = {}
        for quantity, (topic, path) in self.paths.items():
            if quantity == "speed":
                sources[quantity] = SpeedSource(path, topic, unit=speed, shaft="user")
            elif quantity == "current":
                unit = "N" if is_linear and effort_unit == EFFORT_UNIT else effort_unit
                unit = "A" if is_electric(path) else unit
                sources[quantity] = CurrentSource(path, topic, unit=unit, sampling="instantaneous")
            elif quantity == "temperature":
                sources[quantity] = TemperatureSource(path, topic)
            elif quantity == "payload":
                sources[quantity] = PayloadSource(path, topic)
            elif quantity == "command":
                # A command may be sent only on change.
                sources[quantity] = AngleSource(path, topic, unit=length, between="hold")
            else:
                sources[quantity] = AngleSource(path, topic, unit=length)
        return ColumnMapping(
            **sources, joint="" if joints else self.key.joint, joints=joints, clock=Clock("header")
        )


def joint_sources(
    offers: Sequence[Offer],
    homes: Mapping[JointKey, str] | None = None,
    allowed: Set[str] = frozenset(),
    payloads: Set[str] = frozenset(),
) -> Iterator[JointSources]:
    """Yield the sources of each joint with a position, in the order in which joints appear.

    The position is preferably taken from a topic that is not silent and has an effort as well.
    Among several, the order of message types in ``PATHS`` decides, then the topic in ``homes``,
    then the order of ``offers``. Other quantities are preferably taken from the same topic, else
    from another topic of the robot. A payload belongs to the robot with the innermost namespace
    that contains its topic.

    Parameters
    ----------
    offers
        Joints and fields of the topics, in the order in which they appeared.
    homes
        Topic from which the position of each joint is currently taken.
    allowed
        Topics from which positions may be taken; empty for all.
    payloads
        Topics of payloads.
    """
    by_joint = _by_joint(offers)
    robots = {key.robot for key in by_joint}
    for key, group in by_joint.items():
        present = (homes or {}).get(key, "")
        candidates = [
            item
            for item in group
            if item.path_of("position") and (not allowed or item.topic in allowed)
        ]
        if not candidates:
            continue
        home = min(candidates, key=lambda item: _rank(item, present))
        paths = {"position": (home.topic, home.path_of("position"))}
        for quantity in ("speed", "current", "command", "temperature"):
            rivals = [item for item in group if item.path_of(quantity)]
            if rivals:
                best = min(rivals, key=lambda item: _rank_of(quantity, item, home))
                paths[quantity] = (best.topic, best.path_of(quantity))
        of_robot = [topic for topic in payloads if _robot_of(topic, robots) == key.robot]
        if of_robot:
            paths["payload"] = (min(of_robot), "data")
        yield JointSources(key, paths)


@lru_cache(maxsize=1024)
def is_command(topic: str) -> bool:
    """Return whether the name of a joint state topic suggests commanded positions."""
    return "command" in roles_of(topic.rpartition("/")[2])


def namespace_of(topic: str) -> str:
    """Return the namespace of a topic, without slashes at the ends; "" for the root."""
    return topic.rpartition("/")[0].strip("/")


def _rank(offer: Offer, present: str) -> tuple[Any, ...]:
    effort = offer.path_of("current")
    lacks_effort = effort not in offer.varying
    return (*(offer.is_silent, lacks_effort), *(_KINDS.index(offer.kind), offer.topic != present))


def _rank_of(quantity: str, offer: Offer, home: Offer) -> tuple[Any, ...]:
    """Return the rank of a topic for a quantity other than the position."""
    kinds = [kind for kind, _ in _PATHS[quantity]]
    is_constant = offer.path_of(quantity) not in offer.varying
    is_elsewhere = offer.topic != home.topic
    if quantity == "command":
        return is_constant, kinds.index(offer._kind)
    return offer.is_silent, is_constant, is_elsewhere, kinds.index(offer._kind)


def _by_joint(offers: Sequence[Offer]) -> dict[JointKey, list[Offer]]:
    """Group the offers by robot and joint; controller topics are assigned to a robot."""
    groups: dict[JointKey, list[Offer]] = {}
    for offer in offers:
        if offer.is_state and offer.path_of("position"):
            key = JointKey(namespace_of(offer.topic), offer.joint)
            groups.setdefault(key, []).append(offer)
    robots: dict[str, list[str]] = {}
    for key in groups:
        robots.setdefault(key.joint, []).append(key.robot)
    for offer in offers:
        if offer.is_state and offer.path_of("position"):
            continue
        namespaces = robots.get(offer.joint, [])
        containing = [namespace for namespace in namespaces if _is_within(offer.topic, namespace)]
        if containing:
            robot = max(containing, key=len)
        elif len(namespaces) == 1:
            [robot] = namespaces
        else:
            # A controller publishes in its own namespace, within the namespace of the robot.
            robot = namespace_of(f"/{namespace_of(offer.topic)}")
        groups.setdefault(JointKey(robot, offer.joint), []).append(offer)
    return groups


def _robot_of(topic: str, robots: Set[str]) -> str | None:
    """Return the robot with the innermost namespace that contains a topic; None without one."""
    return max((robot for robot in robots if _is_within(topic, robot)), key=len, default=None)


def _is_within(topic: str, namespace: str) -> bool:
    return not namespace or topic.strip("/").startswith(f"{namespace}/")
