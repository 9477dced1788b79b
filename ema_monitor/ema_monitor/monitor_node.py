"""The monitor node: telemetry in, estimates and health out."""

import os
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

from ema_core.description import ActuatorDescription
from ema_core.levels import OK, WARN
from ema_messages import topics
from ema_messages.description import description_from_message
from ema_messages.stamps import stamp_from_message
from ema_messages.telemetry import telemetry_from_message
from ema_monitor.calibration import Calibration
from ema_monitor.calibration_store import CalibrationStore
from ema_monitor.diagnosis import Search
from ema_monitor.estimate import Estimate
from ema_monitor.last_faults import LastFaults
from ema_monitor.monitor_calls import MonitorCalls
from ema_monitor.monitor_health import MonitorHealth
from ema_monitor.monitor_messages import estimate_to_message
from ema_monitor.monitor_passed_over import PassedOver
from ema_monitor.monitor_prognosis import MonitorPrognosis
from ema_monitor.monitor_settings import Files, Operation
from ema_monitor.monitor_unit import Unit
from ema_monitor.monitor_units import Units
from ema_monitor.monitor_worker import IdentificationWorker
from ema_monitor.trigger import Defect, TriggerSettings
from ema_monitor.watch import Found
from ema_monitor.window import Window
from ema_nodes.actuator_file import load_description
from ema_nodes.managed_node import ManagedNode
from ema_nodes.run import run
from ema_nodes.settings import LiveSettings, declare, read
from ema_nodes.status import Task

_QUIET_S = 5.0


class MonitorNode(ManagedNode):
    """Watches the actuators whose telemetry it hears, and publishes their faults and health.

    Telemetry is received in one thread and windows are identified in another, in the order in
    which they end. ``docs/nodes.md`` describes topics, services and parameters.

    Attributes
    ----------
    search, operation
        How to identify, and how to go about the work; both may change at any time.
    store
        Calibrations of the actuators.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("monitor", **kwargs)
        self.search = LiveSettings(self, Search)
        self.operation = LiveSettings(self, Operation)
        self._trigger = LiveSettings(self, TriggerSettings, on_change=self._restart)
        self._units = Units()
        self._lock = threading.RLock()
        self._health = MonitorHealth(self, self._units, self._lock)
        self._prognosis = MonitorPrognosis(self, self._health.resume)
        declare(self, Files)
        self._last_faults = LastFaults()
        self._is_active = False
        self._worker = IdentificationWorker(
            self._calibration_of,
            lambda: self.search.value,
            self._last_faults,
            self._publish_estimate,
            lambda text: self.get_logger().error(text),
        )
        self._listeners: list[SimpleQueue[Found]] = []
        self._searched: set[str] = set()
        self._passed_over = PassedOver()

    @property
    def idle(self) -> bool:
        """Whether no windows are identified: the node is not active."""
        return not self._is_active

    def configure(self) -> None:
        """Read the files, and create what publishes and serves."""
        files = read(self, Files)
        own_folder = Path(os.environ.get("ROS_HOME") or "~/.ros").expanduser() / "ema"
        self.store = CalibrationStore(files.calibration_file, own_folder)
        described = load_description(Path(files.actuator_file)) if files.actuator_file else None
        message_class, qos = topics.MONITOR_TOPICS[topics.FAULT_ESTIMATE]
        self._estimates = self.add_publisher(message_class, topics.FAULT_ESTIMATE, qos)
        self._calls = MonitorCalls(self)
        self._health.begin()
        self._prognosis.begin(files.history_folder)
        if described is not None:
            self._describe(described)

    def activate(self) -> None:
        """Listen, and identify what is heard."""
        self._is_active = True
        self._worker.start()
        with self._lock:
            for unit in self._units.values():
                if unit.watch.description is not None:
                    self._prognosis.describe(unit.watch.description)
        receiving = MutuallyExclusiveCallbackGroup()
        heard = topics.ACTUATOR_TOPICS
        self._subscriptions_in_use = [
            self.create_subscription(heard[name][0], name, callback, qos, callback_group=receiving)
            for name, callback, qos in (
                (topics.USAGE, self._receive_usage, topics.LATCHED_BY_MANY),
                (topics.DESCRIPTION, self._receive_description, topics.LATCHED_BY_MANY),
                (topics.TELEMETRY, self._receive_telemetry, topics.STREAM),
            )
        ]

    def deactivate(self) -> None:
        """Stop listening; windows that still wait are refused."""
        with self._lock:
            self._is_active = False
        for subscription in self._subscriptions_in_use:
            self.destroy_subscription(subscription)
        self._worker.stop()
        with self._lock:
            for unit in self._units.values():
                for found in unit.watch.finish():
                    if isinstance(found, Found):
                        self._worker.refuse(found, "")

    def clean_up(self) -> None:
        """Forget the actuators, and stop serving."""
        self._calls.destroy()
        self._prognosis.end()
        self._health.end()
        self.destroy_lifecycle_publisher(self._estimates)
        self._units.clear()
        self._last_faults.clear()
        self._searched.clear()
        self._passed_over = PassedOver()

    def tasks(self) -> list[Task]:
        """Return how each actuator fares."""
        with self._lock:
            tasks = [
                task for unit in self._units.values() for task in unit.tasks(self._worker.waiting)
            ]
            remarks = [] if self._units else ["no actuator heard of so far"]
            remarks += self._passed_over.remarks()
            message = "; ".join(remarks) or f"{len(self._units)} actuators watched"
            counts = {"windows dropped": self._worker.dropped}
            level = WARN if remarks else OK
            tasks += self._prognosis.tasks()
            tasks.append(Task("input", level, message, self.hardware_id, counts))
            level, message = self._worker.status()
            return [*tasks, Task("identification", level, message, self.hardware_id)]

    def unit(self, actuator_id: str) -> Unit:
        """Return one of the actuators that are watched: see ``Units.find``."""
        with self._lock:
            return self._units.find(actuator_id)

    def calibrated(self, description: ActuatorDescription) -> None:
        """Have the requirements of an actuator fitted that has another calibration now."""
        self._prognosis.refresh(description)

    @contextmanager
    def arrivals(self) -> Iterator[SimpleQueue[Found]]:
        """Give a queue into which goes every window that is found from now on."""
        queue: SimpleQueue[Found] = SimpleQueue()
        with self._lock:
            self._listeners.append(queue)
        try:
            yield queue
        finally:
            with self._lock:
                self._listeners.remove(queue)

    def _receive_description(self, message: Any) -> None:
        try:
            self._describe(description_from_message(message))
        except ValueError as error:
            self._complain(message.actuator_id, f"the description is impossible: {error}")

    def _describe(self, description: ActuatorDescription) -> None:
        with self._lock:
            unit = self._unit_heard(description.actuator_id)
            before = unit.watch.description
            self._sort(unit, unit.watch.describe(description))
            if before is not None and before.serial_number != description.serial_number:
                unit.exchange(self.get_clock().now().nanoseconds)
        if before != description:
            self._prognosis.describe(description)

    def _receive_telemetry(self, message: Any) -> None:
        if not message.actuator_id:
            self._complain("", "telemetry without actuator_id")
            return
        with self._lock:
            unit = self._unit_heard(message.actuator_id)
            try:
                block = telemetry_from_message(message)
            except ValueError as error:
                stamp_ns = stamp_from_message(message.header.stamp)
                self._sort(unit, unit.watch.reject(stamp_ns, str(error)))
            else:
                self._sort(unit, unit.watch.feed(block))

    def _receive_usage(self, message: Any) -> None:
        if not message.actuator_id:
            self._complain("", "usage without actuator_id")
            return
        unit = self._units.get(message.actuator_id)
        if wrong := self._prognosis.hear(message, unit.watch.description if unit else None):
            # Whoever only counts makes no actuator known.
            self._complain(message.actuator_id, wrong, is_watched=unit is not None)

    def _unit_heard(self, actuator_id: str) -> Unit:
        if actuator_id not in self._units:
            now_ns = self.get_clock().now().nanoseconds
            self._units[actuator_id] = Unit(actuator_id, self._trigger.value, now_ns)
            self._health.add(actuator_id)
        return self._units[actuator_id]

    def _complain(self, actuator_id: str, reason: str, *, is_watched: bool = True) -> None:
        with self._lock:
            if actuator_id and is_watched:
                is_news = self._unit_heard(actuator_id).complain(reason)
            else:
                is_news = self._passed_over.add(actuator_id, reason)
        self.get_logger().warning(
            f"{actuator_id or 'input'}: {reason}", throttle_duration_sec=_QUIET_S
        )
        if is_news:
            self.report()

    def _sort(self, unit: Unit, events: Iterable[Found | Defect]) -> None:
        """Let windows wait for their identification, and tell of defects."""
        for event in events:
            if isinstance(event, Defect):
                self._complain(unit.actuator_id, event.reason)
                continue
            if isinstance(event.window, Window):
                unit.latest = event
            for queue in self._listeners:
                queue.put(event)
            in_sim_time = self.get_parameter("use_sim_time").value
            most_waiting = None if in_sim_time else self.operation.value.waiting_windows
            for gone in self._worker.add(event, most_waiting):
                self.get_logger().warning(
                    f"{gone.description.actuator_id}: window {gone.number} is dropped, "
                    f"{self._worker.waiting} wait"
                )

    def _calibration_of(self, description: ActuatorDescription) -> Calibration | str:
        """Return what to search with; the first search begins where the history ends."""
        if description.actuator_id not in self._searched and not self.idle:
            self._searched.add(description.actuator_id)
            if (latest := self._prognosis.latest(description)) is not None:
                self._last_faults.note(description, latest)
        return self.store.of(description)

    def _publish_estimate(self, found: Found, estimate: Estimate) -> None:
        self._estimates.publish(estimate_to_message(estimate, found.number, found.description))
        now_ns = self.get_clock().now().nanoseconds
        # Without the lock: telemetry must not wait for a prognosis.
        outlook = self._prognosis.conclude(found, estimate)
        try:
            self._health.conclude(found, estimate, outlook, now_ns)
        except Exception as error:
            # The estimate is out: the window must not be refused on top of it.
            actuator_id = found.description.actuator_id
            reason = self._prognosis.report_failure(actuator_id, error, "publishing health")
            self._complain(actuator_id, reason, is_watched=actuator_id in self._units)
        if not estimate.valid:
            self.get_logger().warning(
                f"{found.description.actuator_id}: window {found.number} has no valid estimate: "
                f"{estimate.reason}"
            )
        self.report()

    def _restart(self, settings: TriggerSettings) -> None:
        with self._lock:
            for unit in self._units.values():
                self._sort(unit, unit.watch.restart(settings, "the settings of the window changed"))


def main(args: list[str] | None = None) -> int:
    """Run the monitor."""
    return run(MonitorNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
