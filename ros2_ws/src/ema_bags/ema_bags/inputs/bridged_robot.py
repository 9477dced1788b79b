# SPDX-License-Identifier: Apache-2.0
"""Telemetry of the joints that share a mapping."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from ema_bags.inputs.bridged_actuator import SILENT_S, BridgedActuator
from ema_bags.inputs.bridging import Bridge, BridgeSettings
from ema_bags.inputs.joint_states import JointStates, reads_joint_states
from ema_bags.inputs.mapping import ColumnMapping
from ema_bags.inputs.series import Collector
from ema_core.description import ActuatorDescription


class BridgedRobot:
    """Converts the messages of mapped topics to the telemetry of one or several joints.

    Parameters
    ----------
    mapping
        The mapping.
    units
        Actuator descriptions, keyed by joint name in the mapping; a mapping without joints has one
        actuator.
    settings
        Settings of the bridges.
    hardware_of
        Function that returns the hardware ID of a unit.
    step_s
        Interval between calls to `note` [s].
    has_prefix
        Whether the names of diagnostic tasks begin with the name of the actuator.

    Attributes
    ----------
    mapping
        The mapping.
    actuators
        Bridged actuators by name.
    types
        Message type of each mapped topic; empty if the mapping does not state it.
    names_topics
        Topics with element names for values on other topics.
    """

    def __init__(
        self,
        mapping: ColumnMapping,
        units: Mapping[str, ActuatorDescription],
        settings: BridgeSettings,
        hardware_of: Callable[[ActuatorDescription], str],
        step_s: float,
        *,
        has_prefix: bool,
    ) -> None:
        self.mapping = mapping
        reads_at_once = bool(mapping.joints) and reads_joint_states(mapping)
        self._states = JointStates(mapping) if reads_at_once else None
        self.actuators: dict[str, BridgedActuator] = {}
        self._joints = {unit.actuator_id: joint for joint, unit in units.items()}
        for joint, unit in units.items():
            collector = self._states.of_joint(joint) if self._states else None
            bridge = Bridge(mapping.of_joint(joint), unit, settings, collector)
            prefix = unit.actuator_id if has_prefix else ""
            self.actuators[unit.actuator_id] = BridgedActuator(
                bridge, hardware_of(unit), prefix, step_s, SILENT_S
            )
        self.types: dict[str, str] = {}
        self.names_topics: set[str] = set()
        for bridged in self.actuators.values():
            collector = bridged.bridge.collector
            self.types |= dict.fromkeys(collector.topics, "") | dict(collector.types)
            self.names_topics |= set(collector.names_topics)

    def note(self) -> None:
        """Record the message counts, from which the status computes rates."""
        for unit in self.actuators.values():
            unit.note()

    def receive(self, topic: str, message: Any, sent_ns: int, received_ns: int) -> None:
        """Read a message of one of the mapped topics.

        Parameters
        ----------
        topic
            Topic of the message, as in the mapping.
        message
            The message.
        sent_ns, received_ns
            Publication time (0 if unknown) and reception time [ns].
        """
        if self._states is not None:
            self._states.add(topic, message, sent_ns, received_ns)
            for unit in self.actuators.values():
                unit.count(topic)
            return
        for unit in self.actuators.values():
            collector = unit.bridge.collector
            if isinstance(collector, Collector) and topic in collector.topics:
                collector.add(topic, message, sent_ns, received_ns)
                unit.count(topic)

    def share(self) -> None:
        """Distribute the messages received so far to the joints."""
        if self._states is not None:
            self._states.share()

    def remove(self, names: Iterable[str]) -> None:
        """Stop converting the telemetry of the named actuators; unknown names are ignored."""
        for name in names:
            if self.actuators.pop(name, None) and self._states is not None:
                self._states.remove(self._joints[name])
