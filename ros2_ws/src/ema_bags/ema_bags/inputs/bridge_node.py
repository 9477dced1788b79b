# SPDX-License-Identifier: Apache-2.0
"""The bridge node, which converts third-party topics to actuator telemetry."""

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from rclpy.lifecycle.publisher import LifecyclePublisher

from ema_bags.inputs.bridged_actuator import BridgedActuator, BridgeReception
from ema_bags.inputs.bridged_robot import BridgedRobot
from ema_bags.inputs.bridging import Bridge, BridgeSettings
from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.defect_wording import defect_line
from ema_bags.inputs.joint_finder import DESCRIPTION_TOPIC, JointFinder, JointGroup
from ema_bags.inputs.joint_messages import JOINT_KINDS, is_payload
from ema_bags.inputs.mapping import ColumnMapping, load_mapping
from ema_bags.message_type import is_installed, message_class, type_name
from ema_bags.qos import common_offer
from ema_core.description import ActuatorDescription
from ema_core.wording import counted
from ema_interfaces.msg import NodeStatus
from ema_ros import topics
from ema_ros.actuator_file import load_descriptions
from ema_ros.managed_node import ManagedNode
from ema_ros.messages import description_to_message, measured_to_message, telemetry_to_message
from ema_ros.node_parameters import declare, read
from ema_ros.peers import nodes_publishing
from ema_ros.run import run
from ema_ros.status import OK, WARN, Task, hardware_name

_DISCOVERY_S: Final = 0.2
_DEPTH: Final = 5000
_STRING: Final = "std_msgs/msg/String"
_MONITORED: Final = {
    type_name(topics.ACTUATOR_TOPICS[name][0]) for name in (topics.TELEMETRY, topics.DESCRIPTION)
}
# With several joints, blocks are at least this long, because each block has a fixed cost.
_JOINTS_BLOCK_S: Final = 0.2


class BridgeNode(ManagedNode):
    """Converts third-party topics to actuator telemetry and descriptions.

    If the mapping lists ``joints``, each joint is a separate actuator; otherwise there is one
    actuator. Without a mapping, the node bridges all joints of all joint state topics outside its
    namespace, including joints that appear later. If a robot has a namespace, the actuators of its
    joints are named with the namespace as prefix.

    The node's parameters are the fields of ``BridgeSettings``; ``docs/inputs.md`` describes the
    mapping file. Message types are looked up by name, in the mapping or the ROS graph, so only the
    message packages of the mapped topics must be installed.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("bridge", **kwargs)
        declare(self, BridgeSettings)
        self._robots: list[BridgedRobot] = []

    @property
    def hardware_id(self) -> str:
        """Name of the actuator if there is only one, else the name of the node."""
        if len(self._actuators) == 1:
            return next(iter(self._actuators.values())).hardware_id
        return super().hardware_id

    @property
    def _actuators(self) -> dict[str, BridgedActuator]:
        """Bridged actuators of all robots, by name."""
        return {name: unit for robot in self._robots for name, unit in robot.actuators.items()}

    def _hardware_of(self, unit: ActuatorDescription) -> str:
        return hardware_name(self.unit_namespace, unit.actuator_id, unit.serial_number)

    def configure(self) -> None:
        """Read the mapping and the actuator descriptions, and create the publishers."""
        self._settings = settings = read(self, BridgeSettings)
        self._mapping = load_mapping(Path(settings.mapping_file)) if settings.mapping_file else None
        self._descriptions: list[ActuatorDescription] = []
        if self._mapping is not None:
            self._descriptions = load_descriptions(settings.actuator_file, self._mapping.joints)
        if len(self._descriptions) != 1:
            self._settings = replace(settings, block_s=max(settings.block_s, _JOINTS_BLOCK_S))
        for unit in self._descriptions:
            for remark in unit.remarks:
                self.get_logger().warning(f"{unit.actuator_id}: {remark}")
        self._begin()
        for topic, kind in self._types.items():
            if kind:
                _class_of(topic, kind)
        self._missing: dict[str, str] = {}
        self._withheld: dict[str, set[DefectKind]] = {}
        self._outputs = {
            name: self.add_publisher(kind, name, qos)
            for name, (kind, qos) in topics.ACTUATOR_TOPICS.items()
            if name == topics.TELEMETRY
        }
        # One publisher per actuator, so that every description stays latched.
        self._descriptors: dict[str, LifecyclePublisher] = {}
        for unit in self._descriptions:
            self._add_descriptor(unit.actuator_id)
        if self._mapping is not None and self._mapping.temperature is not None:
            self._add_measured()

    def activate(self) -> None:
        """Start subscribing to the mapped topics as they appear."""
        self._begin()
        self.add_timer(_DISCOVERY_S, self._discover)
        self._timer = self.add_timer(self._settings.block_s, self._advance)

    def deactivate(self) -> None:
        """Discard the list of subscriptions."""
        self._inputs.clear()

    def tasks(self) -> list[Task]:
        """Return the diagnostic tasks: search for joints; input and mapping of each actuator."""
        reception = BridgeReception(self.state, self._missing, self._has_source)
        tasks = [self._finding_task()] if self._mapping is None else []
        return [*tasks, *(t for unit in self._actuators.values() for t in unit.tasks(reception))]

    def _begin(self) -> None:
        self._inputs: set[str] = set()
        self._described: dict[str, ActuatorDescription] = {}
        self._robots = []
        self._types: dict[str, str] = {}
        self._names_topics: set[str] = set()
        self._finder = JointFinder(
            self._settings.joints,
            self._settings.effort_unit,
            [self.resolve_topic_name(topic) for topic in self._settings.state_topics],
            self._settings.most_actuators,
        )
        # Topics examined by the finder, with their types.
        self._searched: dict[str, str] = {}
        if self._mapping is not None:
            joints = self._mapping.joints or [""]
            self._add(self._mapping, dict(zip(joints, self._descriptions, strict=True)))

    def _add(self, mapping: ColumnMapping, units: Mapping[str, ActuatorDescription]) -> None:
        """Bridge the joints of a mapping; they replace actuators of the same names."""
        for robot in self._robots:
            robot.remove([unit.actuator_id for unit in units.values()])
        robot = BridgedRobot(
            mapping,
            units,
            self._settings,
            self._hardware_of,
            _DISCOVERY_S,
            has_prefix=self._mapping is None or len(units) > 1,
        )
        self._robots = [*(bridged for bridged in self._robots if bridged.actuators), robot]
        self._types |= robot.types
        self._names_topics |= robot.names_topics

    def counts(self) -> NodeStatus:
        """Return the node status with the lost input samples and the search for joints."""
        lost = sum(unit.bridge.losses.lost for unit in self._actuators.values())
        search = self._finding_task().message if self._mapping is None else ""
        return NodeStatus(kind=NodeStatus.BRIDGE, samples_lost=lost, joint_search=search)

    def _has_source(self, topic: str) -> bool:
        # Latched names outlive their publisher.
        is_latched = topic in self._names_topics
        count = is_latched or self.count_publishers(self.resolve_topic_name(topic))
        return topic in self._inputs and bool(count)

    def _discover(self) -> None:
        """Find joints if there is no mapping, and subscribe to each topic with a publisher."""
        for robot in self._robots:
            robot.note()
        if self._mapping is None:
            self._find()
        for topic in [*self._searched, *self._types]:
            if topic not in self._inputs:
                self._subscribe(topic)

    def _subscribe(self, topic: str) -> None:
        """Subscribe to a topic with the quality of service that its publishers offer, if any."""
        name = self.resolve_topic_name(topic)
        publishers = self.get_publishers_info_by_topic(name)
        if not publishers:
            return
        try:
            kind = self._type_of(topic, {item.topic_type for item in publishers})
        except ValueError as error:
            if self._missing.get(topic) != str(error):
                self._missing[topic] = str(error)
                self.get_logger().error(str(error))
            return
        self._missing.pop(topic, None)
        request = common_offer([item.qos_profile for item in publishers], _DEPTH)
        receive: Any = partial(self._receive, topic)
        self.create_subscription(kind, topic, receive, request)
        self._inputs.add(topic)
        self.get_logger().info(f"subscribed to {name}")

    def _find(self) -> None:
        """Search the graph for topics with joint data, and bridge their joints."""
        # The joint states of a monitored actuator duplicate its telemetry.
        prefix = f"{self.unit_namespace.strip('/')}/"
        published = self.get_topic_names_and_types()
        monitored = {
            node
            for topic, kinds in published
            if not _MONITORED.isdisjoint(kinds)
            for node in nodes_publishing(self, topic)
        }
        for topic, kinds in published:
            if topic in self._searched or (prefix != "/" and topic.startswith(f"/{prefix}")):
                continue
            for kind in kinds:
                is_description = kind == _STRING and topic.rpartition("/")[2] == DESCRIPTION_TOPIC
                is_state = kind in JOINT_KINDS and is_installed(kind)
                if is_state and (nodes := nodes_publishing(self, topic)) and nodes <= monitored:
                    continue
                if is_description or is_state or is_payload(topic, kind):
                    self._searched.setdefault(topic, kind)
        for group in self._finder.found(time.monotonic_ns()):
            joints = list(group.names)
            units = load_descriptions(self._settings.actuator_file, joints)
            names = group.names.values()
            described = [
                replace(unit, actuator_id=name) for unit, name in zip(units, names, strict=True)
            ]
            self._add(group.mapping, dict(zip(joints, described, strict=True)))
            for name in names:
                self._add_descriptor(name)
            if group.mapping.temperature is not None:
                self._add_measured()
            self.get_logger().info(_group_text(group))

    def _add_measured(self) -> None:
        if topics.MEASURED_CAUSES not in self._outputs:
            kind, qos = topics.SYSTEM_TOPICS[topics.MEASURED_CAUSES]
            measured = self.add_publisher(kind, topics.MEASURED_CAUSES, qos)
            self._outputs[topics.MEASURED_CAUSES] = measured

    def _add_descriptor(self, name: str) -> None:
        if name not in self._descriptors:
            kind, qos = topics.ACTUATOR_TOPICS[topics.DESCRIPTION]
            self._descriptors[name] = self.add_publisher(kind, topics.DESCRIPTION, qos)

    def _finding_task(self) -> Task:
        """Return the status of the search for joints."""
        actuators = self._actuators
        states = [topic for topic, kind in self._searched.items() if kind in JOINT_KINDS]
        without = sorted(
            name for name, unit in actuators.items() if unit.bridge.mapping.current is None
        )
        values = {
            "joints": len(actuators),
            "joint state topics": ", ".join(states) or "none",
            "without effort": ", ".join(without) or "none",
        }
        if refused := list(self._finder.refused.values()):
            values["refused names"] = "; ".join(refused)
        surplus = sorted(self._finder.surplus)
        level, text = OK, f"{counted(len(actuators), 'joint')} on {', '.join(states)}"
        if not states:
            level, text = WARN, "no publisher of joint states"
        elif not actuators:
            level = WARN
            text = (
                f"no joint moves on {', '.join(states)} yet, or no joint matches parameter joints"
            )
        elif without:
            level = WARN
            text += f"; no effort is published: {', '.join(without)}: friction cannot be judged"
        if refused:
            level, text = WARN, f"{text}; {counted(len(refused), 'joint')} ignored: {refused[0]}"
        if surplus:
            level, limit = WARN, self._settings.most_actuators
            text += f"; the limit most_actuators = {limit} is reached: {', '.join(surplus)} ignored"
        return Task("joints", level, text, super().hardware_id, values)

    def _type_of(self, topic: str, published: set[str]) -> Any:
        mapped = self._searched.get(topic) or self._types.get(topic)
        if len(published) > 1 or (mapped and published != {mapped}):
            expected = mapped or "one type"
            raise ValueError(
                f"topic {topic} is published as {', '.join(sorted(published))}: expected {expected}"
            )
        return _class_of(topic, next(iter(published)))

    def _receive(self, topic: str, message: Any, information: Mapping[str, Any]) -> None:
        sent_ns = int(information.get("source_timestamp") or 0)
        received_ns = int(information.get("received_timestamp") or time.time_ns())
        searched = self._searched.get(topic)
        if searched == _STRING:
            if reason := self._finder.describe(topic, message.data):
                self.get_logger().warning(reason)
            return
        if searched:
            self._finder.add(topic, searched, message, time.monotonic_ns())
        for robot in self._robots:
            if topic in robot.types:
                robot.receive(topic, message, sent_ns, received_ns)

    def _advance(self) -> None:
        """Publish each actuator's description, if it changed, and its completed samples."""
        for robot in self._robots:
            robot.share()
        for name, unit in self._actuators.items():
            try:
                blocks = unit.advance()
            except ValueError:
                self.get_logger().error(f"{name}: {unit.problem}", throttle_duration_sec=5.0)
                continue
            bridge = unit.bridge
            if bridge.description not in (None, self._described.get(name)):
                self._describe(name, unit)
            for rise in bridge.take_rises():
                # Must be published before the telemetry it applies to.
                measured = measured_to_message(rise.stamp_ns, [rise.cause], name)
                self._outputs[topics.MEASURED_CAUSES].publish(measured)
            for block in blocks:
                self._outputs[topics.TELEMETRY].publish(telemetry_to_message(block, name))
            self._report_withheld(name, bridge)

    def _describe(self, name: str, unit: BridgedActuator) -> None:
        """Publish the description of an actuator once its sample rate has been measured."""
        description, rate = unit.bridge.description, unit.bridge.rate
        assert description is not None
        assert rate is not None
        self._described[name] = description
        actuators = self._actuators
        longest_s = max(item.bridge.block_s for item in actuators.values())
        self._timer.timer_period_ns = round(longest_s * 1e9)
        self._descriptors[name].publish(description_to_message(description, time.time_ns()))
        processing = (
            "samples used unchanged" if rate.is_regular else "samples interpolated by stamp"
        )
        prefix = f"{name}: " if self._mapping is None or len(actuators) > 1 else ""
        self.get_logger().info(
            f"{prefix}sample rate {1.0 / rate.period:g} Hz, measured "
            f"{1.0 / rate.measured_period:.6g} Hz; jitter {1e6 * rate.jitter:.3g} us: "
            f"{processing}"
        )

    def _report_withheld(self, name: str, bridge: Bridge) -> None:
        """Log when a defect starts or stops withholding telemetry."""
        refused = {item.kind: item for item in bridge.refused}
        reported = self._withheld.get(name, set())
        for kind in refused.keys() - reported:
            text = defect_line(refused[kind])
            self.get_logger().error(f"{name}: telemetry is withheld: {text}")
        if reported and not refused:
            withheld = counted(bridge.withheld, "sample")
            self.get_logger().info(
                f"{name}: telemetry is published again; {withheld} withheld so far"
            )
        if refused.keys() != reported:
            self._withheld[name] = set(refused)
            self.report()


def _group_text(group: JointGroup) -> str:
    """Return a log line about joints and their columns."""
    mapping = group.mapping
    columns = {"speed": mapping.speed, "effort": mapping.current, "command": mapping.command}
    columns |= {"payload": mapping.payload}
    present = [f"{name} ({item.topic})" for name, item in columns.items() if item]
    missing = [name for name, item in columns.items() if not item]
    text = f"{', '.join(group.names.values())}: position ({mapping.position.topic})"
    text = ", ".join([text, *present])
    return f"{text}; not published: {', '.join(missing)}" if missing else text


def _class_of(topic: str, kind: str) -> Any:
    """Return the class of a message type; if missing, the error names the package to install."""
    try:
        return message_class(kind)
    except ValueError as error:
        package = kind.partition("/")[0]
        raise ValueError(
            f"topic {topic}: type {kind} is not installed: install package {package} "
            f"(ros-jazzy-{package.replace('_', '-')}), or source the workspace that has it"
        ) from error


def main(args: list[str] | None = None) -> int:
    """Run the bridge node."""
    return run(BridgeNode, args)
