"""The bridge: topics of other makes in, telemetry of an actuator out."""

import math
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.subscription import Subscription

from ema_bags.inputs.bridging import Bridge, BridgeSettings
from ema_bags.inputs.mapping import load_mapping
from ema_bags.message_type import message_class
from ema_bags.qos import common_offer
from ema_core.description import ActuatorDescription
from ema_core.wording import counted
from ema_ros import topics
from ema_ros.actuator_file import load_description
from ema_ros.managed_node import ManagedNode
from ema_ros.messages import description_to_message, telemetry_to_message
from ema_ros.run import run
from ema_ros.settings import declare, read
from ema_ros.status import ERROR, OK, STALE, WARN, Task, hardware_name

_DISCOVERY_S: Final = 0.2
_SILENT_S: Final = 3.0
_DEPTH: Final = 5000


class BridgeNode(ManagedNode):
    """Publishes telemetry and description of an actuator from what other makes publish.

    Parameters of the node are the fields of ``BridgeSettings``; ``docs/inputs.md`` describes the
    mapping file. Types of messages are looked up by name, in the mapping or in the graph: no
    package of messages is needed but those of the topics that are mapped.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("bridge", **kwargs)
        declare(self, BridgeSettings)
        self._description = ActuatorDescription()

    @property
    def hardware_id(self) -> str:
        """Namespace, name and serial number of the actuator."""
        unit = self._description
        return hardware_name(self.unit_namespace, unit.actuator_id, unit.serial_number)

    def configure(self) -> None:
        """Read mapping and description."""
        settings = read(self, BridgeSettings)
        if not settings.mapping_file:
            raise ValueError("parameter mapping_file = '': expected a YAML file (docs/inputs.md)")
        file = settings.actuator_file
        self._description = load_description(Path(file)) if file else ActuatorDescription()
        for remark in self._description.remarks:
            self.get_logger().warning(f"{self._description.actuator_id}: {remark}")
        self._settings = settings
        self._mapping = load_mapping(Path(settings.mapping_file))
        self._begin()
        for topic, kind in self._bridge.collector.types.items():
            if kind:
                _class_of(topic, kind)
        self._inputs: dict[str, Subscription] = {}
        self._missing: dict[str, str] = {}
        self._told: set[str] = set()
        self._outputs = {
            name: self.add_publisher(kind, name, qos)
            for name, (kind, qos) in topics.ACTUATOR_TOPICS.items()
            if name in (topics.TELEMETRY, topics.DESCRIPTION)
        }
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._own_timers = [
            self.create_timer(_DISCOVERY_S, self._discover, clock=steady, autostart=False),
            self.create_timer(settings.block_s, self._advance, clock=steady, autostart=False),
        ]

    def activate(self) -> None:
        """Listen to the topics of the mapping as they come up."""
        self._begin()
        for timer in self._own_timers:
            timer.reset()

    def deactivate(self) -> None:
        """Listen no more."""
        for timer in self._own_timers:
            timer.cancel()
        for subscription in self._inputs.values():
            self.destroy_subscription(subscription)
        self._inputs.clear()

    def clean_up(self) -> None:
        """Destroy publishers and timers."""
        for timer in self._own_timers:
            self.destroy_timer(timer)
        for publisher in self._outputs.values():
            self.destroy_lifecycle_publisher(publisher)

    def tasks(self) -> list[Task]:
        """Return what comes in, and what is wrong with it."""
        return [self._input_task(), self._mapping_task()]

    def _begin(self) -> None:
        self._bridge = Bridge(self._mapping, self._description, self._settings)
        self._described: ActuatorDescription | None = None
        self._last_s = self._used_s = time.monotonic()
        self._left_out_s = -math.inf

    def _input_task(self) -> Task:
        bridge, losses = self._bridge, self._bridge.losses
        rate, problem = bridge.rate, bridge.collector.problem()
        values: dict[str, Any] = {
            "rate [Hz]": bridge.received_hz,
            "published [Hz]": bridge.published_hz,
            "nominal rate [Hz]": 1.0 / rate.period if rate else 0.0,
            "jitter [us]": 1e6 * rate.jitter if rate else 0.0,
            "interpolated": bool(rate and not rate.is_regular),
            "samples": losses.samples,
            "lost": losses.lost,
            "gaps": losses.gaps,
            "pauses": losses.pauses,
            "clock jumps": losses.jumps,
            "repeated": losses.repeated,
            "not finite": losses.missing,
            "rebuilt stamps": bridge.rebuilt,
            "withheld": bridge.withheld,
        }
        waits = [topic for topic in bridge.collector.topics if topic not in self._inputs]
        level, message = OK, f"{1.0 / rate.period:g} Hz" if rate else "learning the rate"
        now_s, source = time.monotonic(), self._mapping.position.topic
        if self._missing:
            level, message = ERROR, "; ".join(self._missing.values())
        elif waits:
            level, message = WARN, f"nobody publishes {', '.join(waits)}"
        elif self.state == "active" and now_s - self._last_s > _SILENT_S:
            level, message = STALE, f"nothing received on {source} for {_SILENT_S:g} s"
        elif self.state == "active" and now_s - self._used_s > _SILENT_S:
            level, message = ERROR, f"no telemetry is published: {problem}"
        elif bridge.refused:
            level = ERROR
            message = (
                f"{bridge.received_hz:.4g} Hz received, no telemetry is published: see mapping"
            )
        elif now_s - self._left_out_s < _SILENT_S:
            level, message = WARN, problem
        return Task("input", level, message, self.hardware_id, values)

    def _mapping_task(self) -> Task:
        defects, errors = self._bridge.defects, self._bridge.refused
        values = {item.name: str(item) for item in defects}
        level, text = OK, "nothing wrong seen"
        if errors:
            level, text = ERROR, f"telemetry is withheld: {'; '.join(map(str, errors))}"
        elif defects:
            level, text = WARN, "; ".join(map(str, defects))
        return Task("mapping", level, text, self.hardware_id, values)

    def _discover(self) -> None:
        """Subscribe to topics that have a publisher, as it offers them."""
        for topic in self._bridge.collector.topics:
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
            self._inputs[topic] = self.create_subscription(kind, topic, receive, request)
            self.get_logger().info(f"listening to {name}")

    def _type_of(self, topic: str, there: set[str]) -> Any:
        given = self._bridge.collector.types.get(topic)
        if len(there) > 1 or (given and there != {given}):
            expected = given or "one type"
            raise ValueError(
                f"topic {topic} is published as {', '.join(sorted(there))}: expected {expected}"
            )
        return _class_of(topic, next(iter(there)))

    def _receive(self, topic: str, message: Any, information: Mapping[str, Any]) -> None:
        now_s = time.monotonic()
        sent_ns = int(information.get("source_timestamp") or 0)
        received_ns = int(information.get("received_timestamp") or time.time_ns())
        is_used = self._bridge.collector.add(topic, message, sent_ns, received_ns)
        if not is_used:
            self._left_out_s = now_s
        if topic == self._mapping.position.topic:
            self._last_s, self._used_s = now_s, now_s if is_used else self._used_s

    def _advance(self) -> None:
        """Publish what is complete, after the description that it is of."""
        bridge = self._bridge
        try:
            blocks = bridge.advance()
        except ValueError as error:
            self.get_logger().error(str(error), throttle_duration_sec=5.0)
            return
        rate = bridge.rate
        if bridge.description is not None and rate is not None and self._described is None:
            self._described = bridge.description
            message = description_to_message(self._described, time.time_ns())
            self._outputs[topics.DESCRIPTION].publish(message)
            kept = "as they are" if rate.is_regular else "interpolated on their stamps"
            self.get_logger().info(
                f"{1.0 / rate.measured_period:.6g} samples a second, taken as "
                f"{1.0 / rate.period:g} Hz; jitter {1e6 * rate.jitter:.3g} us: {kept}"
            )
        for block in blocks:
            message = telemetry_to_message(block, self._description.actuator_id)
            self._outputs[topics.TELEMETRY].publish(message)
        self._report_refused()

    def _report_refused(self) -> None:
        """Log a defect that withholds telemetry when it comes and when it has gone."""
        refused = {item.name: item for item in self._bridge.refused}
        for name in refused.keys() - self._told:
            self.get_logger().error(f"telemetry is withheld: {refused[name]}")
        if self._told and not refused:
            withheld = counted(self._bridge.withheld, "sample")
            self.get_logger().info(f"telemetry is published again; {withheld} withheld")
        if refused.keys() != self._told:
            self._told = set(refused)
            self.report()


def _class_of(topic: str, kind: str) -> Any:
    """Return the class of a type; the error names the package to install."""
    try:
        return message_class(kind)
    except ValueError as error:
        package = kind.partition("/")[0]
        raise ValueError(
            f"topic {topic}: type {kind} is not installed here: install package {package} "
            f"(ros-jazzy-{package.replace('_', '-')}), or source the workspace that has it"
        ) from error


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(BridgeNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
