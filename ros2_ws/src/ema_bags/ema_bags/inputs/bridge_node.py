"""The bridge: topics of other makes in, telemetry of an actuator out."""

import time
from collections import deque
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from ema_bags.inputs.bridging import LEAST_SAMPLES, Bridge, BridgeSettings
from ema_bags.inputs.mapping import load_mapping
from ema_bags.message_type import message_class
from ema_bags.qos import common_offer
from ema_core.description import ActuatorDescription
from ema_core.wording import counted
from ema_interfaces.msg import NodeStatus
from ema_ros import topics
from ema_ros.actuator_file import load_description
from ema_ros.managed_node import ManagedNode
from ema_ros.messages import description_to_message, measured_to_message, telemetry_to_message
from ema_ros.run import run
from ema_ros.settings import declare, read
from ema_ros.status import ERROR, OK, STALE, WARN, Task, hardware_name

_DISCOVERY_S: Final = 0.2
_SILENT_S: Final = 3.0
_PUBLISHED: Final = "published [Hz]"
_CHECKED: Final = "checked [Hz]"
_LEFT_OUT: Final = "left out [Hz]"
_DEPTH: Final = 5000


class BridgeNode(ManagedNode):
    """Publishes telemetry and description of an actuator from third-party topics.

    Parameters of the node are the fields of ``BridgeSettings``; ``docs/inputs.md`` describes the
    mapping file. Types of messages are looked up by name, in the mapping or in the graph: only the
    message packages of the mapped topics are needed.
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
        mapping = load_mapping(Path(settings.mapping_file))
        self._mapping = mapping.of_joint(self._description.actuator_id)
        self._begin()
        for topic, kind in self._bridge.collector.types.items():
            if kind:
                _class_of(topic, kind)
        self._inputs: set[str] = set()
        self._missing: dict[str, str] = {}
        self._told: set[str] = set()
        self._outputs = {
            name: self.add_publisher(kind, name, qos)
            for name, (kind, qos) in topics.ACTUATOR_TOPICS.items()
            if name in (topics.TELEMETRY, topics.DESCRIPTION)
        }
        if self._mapping.temperature is not None:
            kind, qos = topics.SYSTEM_TOPICS[topics.MEASURED_CAUSES]
            measured = self.add_publisher(kind, topics.MEASURED_CAUSES, qos)
            self._outputs[topics.MEASURED_CAUSES] = measured

    def activate(self) -> None:
        """Listen to the topics of the mapping as they come up."""
        self._begin()
        self.add_timer(_DISCOVERY_S, self._discover)
        self._timer = self.add_timer(self._settings.block_s, self._advance)

    def deactivate(self) -> None:
        """Listen no more."""
        self._inputs.clear()

    def tasks(self) -> list[Task]:
        """Return the status of the input, and of the mapping."""
        return [self._input_task(), self._mapping_task()]

    def _begin(self) -> None:
        self._bridge = Bridge(self._mapping, self._description, self._settings)
        self._described: ActuatorDescription | None = None
        self._problem = ""
        # Messages by topic, and samples, so far: now, and at times of the last 3 s.
        rates = (_PUBLISHED, _CHECKED, _LEFT_OUT)
        self._counts = dict.fromkeys([*self._bridge.collector.topics, *rates], 0)
        times = round(_SILENT_S / _DISCOVERY_S) + 1
        self._past = deque([(time.monotonic(), self._counts.copy())], maxlen=times)

    def counts(self) -> NodeStatus:
        """Return how many samples are missing at the input."""
        return NodeStatus(kind=NodeStatus.BRIDGE, samples_lost=self._bridge.losses.lost)

    def _recent(self) -> dict[str, float]:
        """Return the rates of the last 3 s [Hz]: of messages by topic, and of samples."""
        first_s, first = self._past[0]
        span_s = max(time.monotonic() - first_s, 1e-3)
        return {key: (count - first[key]) / span_s for key, count in self._counts.items()}

    def _input_task(self) -> Task:
        bridge, losses, rate = self._bridge, self._bridge.losses, self._bridge.rate
        recent = self._recent()
        values: dict[str, Any] = {
            "rate [Hz]": recent[self._mapping.position.topic],
            _PUBLISHED: recent[_PUBLISHED],
            "nominal rate [Hz]": 1.0 / rate.period if rate else 0.0,
            "jitter [us]": 1e6 * rate.jitter if rate else 0.0,
            "interpolated": bool(rate and not rate.is_regular),
            "samples": losses.samples,
            "lost": self.counts().samples_lost,
            "gaps": losses.gaps,
            "filled": losses.filled,
            "pauses": losses.pauses,
            "clock jumps": losses.jumps,
            "repeated": losses.repeated,
            "not finite": losses.missing,
            "rebuilt stamps": bridge.rebuilt,
            "impossible": losses.impossible,
            "wraps": losses.wraps,
            "withheld": bridge.withheld,
        }
        level, message = self._input_level(recent)
        return Task("input", level, message, self.hardware_id, values)

    def _input_level(self, recent: dict[str, float]) -> tuple[int, str]:
        bridge, source = self._bridge, self._mapping.position.topic
        if self.state != "active":
            return STALE, f"{self.state}: nothing is received"
        if self._missing:
            return ERROR, "; ".join(self._missing.values())
        if waits := [topic for topic in bridge.collector.topics if not self._has_source(topic)]:
            return WARN, f"nobody publishes {', '.join(waits)}"
        is_long = len(self._past) == self._past.maxlen
        silent = self._silent(recent) if is_long else {}
        if source in silent:
            return STALE, silent[source]
        # A command or a temperature may be sent on change only; another sensor that is silent is
        # out of order.
        needed = {
            item.topic
            for _, _, item in self._mapping.wanted()
            if item not in (self._mapping.command, self._mapping.temperature)
            or item.between != "hold"
        }
        reasons = [text for topic, text in silent.items() if topic in needed]
        reasons += [self._problem] * bool(self._problem)
        if recent[_LEFT_OUT]:
            reasons.append(bridge.collector.problem())
        if bridge.rate is None and not reasons:
            expected = f"expected at least {LEAST_SAMPLES} in {self._settings.learn_s:g} s or more"
            return WARN, f"learning the rate: {self._counts[source]} messages; {expected}"
        is_idle = is_long and not recent[_PUBLISHED]
        # The first messages after a silence cannot be published yet.
        middle = self._past[len(self._past) // 2][1]
        is_resumed = middle[source] == self._past[0][1][source]
        if bridge.refused or self._problem or (is_idle and not is_resumed):
            reason = "see mapping" if bridge.refused else "no sample is complete"
            if not bridge.refused:
                reasons += [str(item) for item in bridge.defects if item.is_error]
            text = f"{recent[source]:.4g} Hz received, no telemetry is published"
            return ERROR, f"{text}: {'; '.join(reasons) or reason}"
        if reasons:
            return WARN, "; ".join(reasons)
        if is_idle:
            return STALE, f"{recent[source]:.4g} Hz received again, no telemetry is published yet"
        rate = f"{1.0 / bridge.rate.period:g} Hz" if bridge.rate else ""
        return OK, "; ".join([rate, *(f"{text} is held" for text in silent.values())])

    def _silent(self, recent: dict[str, float]) -> dict[str, str]:
        """Return the topics without messages for 3 s, with the reason."""
        silent: dict[str, str] = {}
        for key, _, item in self._mapping.wanted():
            if not recent[item.topic]:
                begin = f"nothing received on {item.topic} for {_SILENT_S:g} s: "
                begin = f"{silent[item.topic]}, " if item.topic in silent else begin
                silent[item.topic] = f"{begin}{key}"
        return silent

    def _has_source(self, topic: str) -> bool:
        # Latched names outlive their publisher.
        is_latched = topic in self._bridge.collector.names_topics
        count = is_latched or self.count_publishers(self.resolve_topic_name(topic))
        return topic in self._inputs and bool(count)

    def _mapping_task(self) -> Task:
        defects, errors = self._bridge.defects, self._bridge.refused
        values = {item.name: str(item) for item in defects}
        level, text = OK, "nothing wrong seen"
        if not self._recent()[_CHECKED]:
            level, text = STALE, "no samples to check"
        elif errors:
            level, text = ERROR, f"telemetry is withheld: {'; '.join(map(str, errors))}"
        elif uncertain := self._bridge.uncertain:
            words = "; ".join(map(str, uncertain))
            level, text = WARN, f"to be judged again after more motion, not withheld: {words}"
        elif defects:
            asking = [
                item
                for item in defects
                if item.needs_action and item.name not in self._mapping.accept
            ]
            level, text = WARN if asking else OK, "; ".join(map(str, asking or defects))
        return Task("mapping", level, text, self.hardware_id, values)

    def _discover(self) -> None:
        """Subscribe to topics that have a publisher, as it offers them."""
        self._past.append((time.monotonic(), self._counts.copy()))
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
            self.create_subscription(kind, topic, receive, request)
            self._inputs.add(topic)
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
        sent_ns = int(information.get("source_timestamp") or 0)
        received_ns = int(information.get("received_timestamp") or time.time_ns())
        self._counts[topic] += 1
        if not self._bridge.collector.add(topic, message, sent_ns, received_ns):
            self._counts[_LEFT_OUT] += 1

    def _advance(self) -> None:
        """Publish the complete samples, after their description."""
        bridge = self._bridge
        try:
            blocks = bridge.advance()
        except ValueError as error:
            remedy = f"set clock.source or clock.rate_hz in {self._settings.mapping_file}"
            self._problem = f"the rate cannot be learned: {error}: {remedy}"
            self.get_logger().error(self._problem, throttle_duration_sec=5.0)
            return
        rate, self._problem = bridge.rate, ""
        if bridge.description is not None and rate is not None and self._described is None:
            self._described = bridge.description
            self._timer.timer_period_ns = round(bridge.block_s * 1e9)
            message = description_to_message(self._described, time.time_ns())
            self._outputs[topics.DESCRIPTION].publish(message)
            kept = "as they are" if rate.is_regular else "interpolated on their stamps"
            self.get_logger().info(
                f"{1.0 / rate.measured_period:.6g} samples a second, taken as "
                f"{1.0 / rate.period:g} Hz; jitter {1e6 * rate.jitter:.3g} us: {kept}"
            )
        for rise in bridge.take_rises():
            # Published before the telemetry to which it applies.
            measured = measured_to_message(
                rise.stamp_ns, [rise.cause], self._description.actuator_id
            )
            self._outputs[topics.MEASURED_CAUSES].publish(measured)
        for block in blocks:
            message = telemetry_to_message(block, self._description.actuator_id)
            self._outputs[topics.TELEMETRY].publish(message)
            self._counts[_PUBLISHED] += len(block)
        self._counts[_CHECKED] = bridge.checked
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
