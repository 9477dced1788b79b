"""The bridge node, which converts third-party topics to actuator telemetry."""

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from ema_bags.inputs.bridged_actuator import SILENT_S, BridgedActuator, Reception
from ema_bags.inputs.bridging import Bridge, BridgeSettings
from ema_bags.inputs.joint_states import JointStates, reads_joint_states
from ema_bags.inputs.mapping import load_mapping
from ema_bags.inputs.series import Collector
from ema_bags.message_type import message_class
from ema_bags.qos import common_offer
from ema_core.description import ActuatorDescription
from ema_core.wording import counted
from ema_interfaces.msg import NodeStatus
from ema_ros import topics
from ema_ros.actuator_file import load_descriptions
from ema_ros.managed_node import ManagedNode
from ema_ros.messages import description_to_message, measured_to_message, telemetry_to_message
from ema_ros.node_parameters import declare, read
from ema_ros.run import run
from ema_ros.status import Task, hardware_name

_DISCOVERY_S: Final = 0.2
_DEPTH: Final = 5000
# With several joints, blocks are at least this long, because each block has a fixed cost.
_JOINTS_BLOCK_S: Final = 0.2


class BridgeNode(ManagedNode):
    """Converts third-party topics to actuator telemetry and descriptions.

    If the mapping lists ``joints``, each joint is a separate actuator; otherwise there is one
    actuator. The node's parameters are the fields of ``BridgeSettings``; ``docs/inputs.md``
    describes the mapping file. Message types are looked up by name, in the mapping or the ROS
    graph, so only the message packages of the mapped topics must be installed.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("bridge", **kwargs)
        declare(self, BridgeSettings)
        self._descriptions: list[ActuatorDescription] = []

    @property
    def hardware_id(self) -> str:
        """Name of the actuator if there is only one, else the name of the node."""
        if len(self._descriptions) == 1:
            return self._hardware_of(self._descriptions[0])
        return super().hardware_id

    def _hardware_of(self, unit: ActuatorDescription) -> str:
        return hardware_name(self.unit_namespace, unit.actuator_id, unit.serial_number)

    def configure(self) -> None:
        """Read the mapping and the actuator descriptions."""
        settings = read(self, BridgeSettings)
        if not settings.mapping_file:
            raise ValueError("parameter mapping_file = '': expected a YAML file (docs/inputs.md)")
        self._settings = settings
        self._mapping = load_mapping(Path(settings.mapping_file))
        self._descriptions = load_descriptions(settings.actuator_file, self._mapping.joints)
        if len(self._descriptions) > 1:
            self._settings = replace(settings, block_s=max(settings.block_s, _JOINTS_BLOCK_S))
        for unit in self._descriptions:
            for remark in unit.remarks:
                self.get_logger().warning(f"{unit.actuator_id}: {remark}")
        self._begin()
        for topic, kind in self._types.items():
            if kind:
                _class_of(topic, kind)
        self._inputs: set[str] = set()
        self._missing: dict[str, str] = {}
        self._withheld: dict[str, set[str]] = {}
        self._outputs = {
            name: self.add_publisher(kind, name, qos)
            for name, (kind, qos) in topics.ACTUATOR_TOPICS.items()
            if name == topics.TELEMETRY
        }
        kind, qos = topics.ACTUATOR_TOPICS[topics.DESCRIPTION]
        # One publisher per actuator, so that every description stays latched.
        self._descriptors = {
            unit.actuator_id: self.add_publisher(kind, topics.DESCRIPTION, qos)
            for unit in self._descriptions
        }
        if self._mapping.temperature is not None:
            kind, qos = topics.SYSTEM_TOPICS[topics.MEASURED_CAUSES]
            measured = self.add_publisher(kind, topics.MEASURED_CAUSES, qos)
            self._outputs[topics.MEASURED_CAUSES] = measured

    def activate(self) -> None:
        """Start subscribing to the mapped topics as they appear."""
        self._begin()
        self.add_timer(_DISCOVERY_S, self._discover)
        self._timer = self.add_timer(self._settings.block_s, self._advance)

    def deactivate(self) -> None:
        """Forget the subscriptions."""
        self._inputs.clear()

    def tasks(self) -> list[Task]:
        """Return the diagnostic tasks: input and mapping of each actuator."""
        reception = Reception(self.state, self._missing, self._has_source)
        return [task for unit in self._actuators.values() for task in unit.tasks(reception)]

    def _begin(self) -> None:
        self._described: dict[str, ActuatorDescription] = {}
        self._states: JointStates | None = None
        if len(self._descriptions) > 1 and reads_joint_states(self._mapping):
            self._states = JointStates(self._mapping)
        self._actuators = {unit.actuator_id: self._bridged(unit) for unit in self._descriptions}
        self._types: dict[str, str] = {}
        self._names_topics: set[str] = set()
        for unit in self._actuators.values():
            self._types |= dict.fromkeys(unit.bridge.collector.topics, "")
            self._types |= unit.bridge.collector.types
            self._names_topics |= set(unit.bridge.collector.names_topics)

    def _bridged(self, unit: ActuatorDescription) -> BridgedActuator:
        mapping = self._mapping.of_joint(unit.actuator_id)
        collector = self._states.of_joint(unit.actuator_id) if self._states else None
        bridge = Bridge(mapping, unit, self._settings, collector)
        prefix = unit.actuator_id if len(self._descriptions) > 1 else ""
        return BridgedActuator(bridge, self._hardware_of(unit), prefix, _DISCOVERY_S, SILENT_S)

    def counts(self) -> NodeStatus:
        """Return the node status with the number of samples lost at the input."""
        lost = sum(unit.bridge.losses.lost for unit in self._actuators.values())
        return NodeStatus(kind=NodeStatus.BRIDGE, samples_lost=lost)

    def _has_source(self, topic: str) -> bool:
        # Latched names outlive their publisher.
        is_latched = topic in self._names_topics
        count = is_latched or self.count_publishers(self.resolve_topic_name(topic))
        return topic in self._inputs and bool(count)

    def _discover(self) -> None:
        """Subscribe to each topic that has a publisher, with the QoS it offers."""
        for unit in self._actuators.values():
            unit.note()
        for topic in self._types:
            name = self.resolve_topic_name(topic)
            publishers = self.get_publishers_info_by_topic(name)
            if topic in self._inputs or not publishers:
                continue
            try:
                kind = self._type_of(topic, {item.topic_type for item in publishers})
            except ValueError as error:
                if self._missing.get(topic) != str(error):
                    self._missing[topic] = str(error)
                    self.get_logger().error(str(error))
                continue
            self._missing.pop(topic, None)
            request = common_offer([item.qos_profile for item in publishers], _DEPTH)
            receive: Any = partial(self._receive, topic)
            self.create_subscription(kind, topic, receive, request)
            self._inputs.add(topic)
            self.get_logger().info(f"subscribed to {name}")

    def _type_of(self, topic: str, published: set[str]) -> Any:
        mapped = self._types.get(topic)
        if len(published) > 1 or (mapped and published != {mapped}):
            expected = mapped or "one type"
            raise ValueError(
                f"topic {topic} is published as {', '.join(sorted(published))}: expected {expected}"
            )
        return _class_of(topic, next(iter(published)))

    def _receive(self, topic: str, message: Any, information: Mapping[str, Any]) -> None:
        sent_ns = int(information.get("source_timestamp") or 0)
        received_ns = int(information.get("received_timestamp") or time.time_ns())
        if self._states is not None:
            self._states.add(message, sent_ns, received_ns)
            for unit in self._actuators.values():
                unit.count(topic)
            return
        for unit in self._actuators.values():
            collector = unit.bridge.collector
            if isinstance(collector, Collector) and topic in collector.topics:
                is_read = collector.add(topic, message, sent_ns, received_ns)
                unit.count(topic, is_left_out=not is_read)

    def _advance(self) -> None:
        """Publish each actuator's description, if it changed, and its completed samples."""
        if self._states is not None:
            self._states.share()
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
        longest_s = max(item.bridge.block_s for item in self._actuators.values())
        self._timer.timer_period_ns = round(longest_s * 1e9)
        self._descriptors[name].publish(description_to_message(description, time.time_ns()))
        kept = "as they are" if rate.is_regular else "interpolated on their stamps"
        prefix = f"{name}: " if len(self._actuators) > 1 else ""
        self.get_logger().info(
            f"{prefix}{1.0 / rate.measured_period:.6g} samples a second, taken as "
            f"{1.0 / rate.period:g} Hz; jitter {1e6 * rate.jitter:.3g} us: {kept}"
        )

    def _report_withheld(self, name: str, bridge: Bridge) -> None:
        """Log when a defect starts or stops withholding telemetry."""
        refused = {item.name: item for item in bridge.refused}
        reported = self._withheld.get(name, set())
        for defect in refused.keys() - reported:
            self.get_logger().error(f"{name}: telemetry is withheld: {refused[defect]}")
        if reported and not refused:
            withheld = counted(bridge.withheld, "sample")
            self.get_logger().info(f"{name}: telemetry is published again; {withheld} withheld")
        if refused.keys() != reported:
            self._withheld[name] = set(refused)
            self.report()


def _class_of(topic: str, kind: str) -> Any:
    """Return the class of a message type; if missing, the error names the package to install."""
    try:
        return message_class(kind)
    except ValueError as error:
        package = kind.partition("/")[0]
        raise ValueError(
            f"topic {topic}: type {kind} is not installed here: install package {package} "
            f"(ros-jazzy-{package.replace('_', '-')}), or source the workspace that has it"
        ) from error


def main(args: list[str] | None = None) -> int:
    """Run the bridge node."""
    return run(BridgeNode, args)
