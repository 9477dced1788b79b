"""The monitor node: telemetry in, estimates and health out."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle.publisher import LifecyclePublisher

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import Health
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.node.actuators import Actuators
from ema_monitor.node.admission import Admission, Selection, Shard
from ema_monitor.node.calibration_store import CalibrationStore
from ema_monitor.node.calls import MonitorCalls
from ema_monitor.node.follow_ups import FollowUps
from ema_monitor.node.kernels import compile_monitor_kernels
from ema_monitor.node.messages import estimate_to_message, summary_of
from ema_monitor.node.prognosis import MonitorPrognosis
from ema_monitor.node.settings import Files, Operation, folder_of
from ema_monitor.node.worker import IdentificationWorker
from ema_monitor.prognosis.advice import Costs
from ema_monitor.prognosis.fleet import Fleet
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros import topics
from ema_ros.actuator_file import load_description
from ema_ros.latched_subscription import subscribe_latched
from ema_ros.managed_node import ManagedNode
from ema_ros.run import run
from ema_ros.settings import LiveSettings, declare, read
from ema_ros.status import ERROR, STALE, Task
from ema_ros.throttle import Throttle

_LOG_PERIOD_S: Final = 30.0
_STALE_CHECK_S: Final = 1.0
_NOT_ACTIVE: Final = "the monitor is not active"


class MonitorNode(ManagedNode):
    """Monitors the actuators whose telemetry it receives: publishes their faults and health.

    Telemetry is received in one thread and windows are identified in another, in the order in
    which they end. ``docs/nodes.md`` describes topics, services and parameters.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("monitor", **kwargs)
        self.search = LiveSettings(self, SearchSettings)
        self.combining = LiveSettings(self, CombinationSettings)
        self.costs = LiveSettings(self, Costs, "costs.")
        self.operation = LiveSettings(self, Operation)
        trigger = LiveSettings(
            self, TriggerSettings, on_change=lambda new: self.units.restart(new)
        ).value
        declare(self, Selection)
        declare(self, Shard, "shard.")
        declare(self, Files)
        self._admission = Admission(
            read(self, Selection), read(self, Shard, "shard."), self.operation
        )
        self.units = Actuators(self, self._admission, trigger)
        self.prognosis = MonitorPrognosis(self)
        self._worker = IdentificationWorker(self)
        self._follow_ups = FollowUps(self)
        self._throttle = Throttle(_LOG_PERIOD_S)
        # One of each topic for each actuator, so that each is latched.
        self._latched: dict[tuple[str, str], LifecyclePublisher] = {}
        self.is_active = False

    @property
    def uses_sim_time(self) -> bool:
        """Whether the node follows ``/clock``."""
        return bool(self.get_parameter("use_sim_time").value)

    def configure(self) -> None:
        """Read the files, compile the kernels, and create what publishes and serves."""
        files = read(self, Files)
        self._store = CalibrationStore(files.calibration_file, folder_of(files.calibration_folder))
        described = load_description(Path(files.actuator_file)) if files.actuator_file else None
        fleet = Fleet.read(folder_of(files.fleet_file)) if files.fleet_file else None
        # Now, as no window waits for them yet.
        compile_monitor_kernels(self.tell_progress, lambda: self.is_ending)
        message_class, qos = topics.MONITOR_TOPICS[topics.FAULT_ESTIMATE]
        self._estimates = self.add_publisher(message_class, topics.FAULT_ESTIMATE, qos)
        self._calls = MonitorCalls(self, self._store)
        self.create_timer(_STALE_CHECK_S, self._check_staleness)
        self.prognosis.begin(files.history_folder, fleet)
        self.units.expect_listed()
        if words := self._admission.list_in_words():
            self.get_logger().info(words)
        if described is not None:
            if reason := self._admission.why_not(described.actuator_id):
                name = described.actuator_id
                self.get_logger().info(f"{name} of actuator_file is not followed: {reason}")
            else:
                self.units.describe(described)

    def activate(self) -> None:
        """Subscribe, and identify what is received."""
        self.is_active = True
        self._follow_ups.start()
        self._worker.start()
        with self.units.lock:
            for unit in self.units.values():
                if unit.description is not None:
                    self.prognosis.describe(unit.description)
        group, units = MutuallyExclusiveCallbackGroup(), self.units
        known = topics.ACTUATOR_TOPICS | topics.SYSTEM_TOPICS
        for name, callback in (
            (topics.USAGE, units.receive_usage),
            (topics.DESCRIPTION, units.receive_description),
        ):
            subscribe_latched(self, known[name][0], name, callback, group)
        for name, callback in (
            (topics.MEASURED_CAUSES, units.receive_measured),
            (topics.TELEMETRY, units.receive_telemetry),
        ):
            kind = known[name][0]
            self.create_subscription(kind, name, callback, topics.STREAM, callback_group=group)

    def deactivate(self) -> None:
        """Refuse the windows that still wait; nothing is known any more."""
        with self.units.lock:
            self.is_active = False
        self._worker.stop()
        for segment in self.units.finish():
            self._worker.refuse(segment, "")
        self._follow_ups.stop()
        with self.units.lock:
            for unit in self.units.values():
                unit.withdraw_health(_NOT_ACTIVE)

    def clean_up(self) -> None:
        """Forget the actuators."""
        self.prognosis.end()
        self._latched.clear()
        self._follow_ups.dropped = 0
        self.units.clear()
        self._worker.clear()

    def tasks(self) -> list[Task]:
        """Return the status of the actuators, their histories and the identification."""
        return self._tasks_of()

    def _tasks_of(self, actuator_id: str = "") -> list[Task]:
        """Return the status of one actuator and of the identification; of each one when empty."""
        level, message = self._worker.status()
        if self._follow_ups.failure:
            failures = [message] if level == ERROR else []
            level, message = ERROR, "; ".join([*failures, self._follow_ups.failure])
        queue = self._worker.queue
        units = self.units.tasks(len(queue), queue.dropped, actuator_id)
        if not self.is_active:
            units = [
                replace(one, level=STALE, message=f"{_NOT_ACTIVE}, before: {one.message}")
                for one in units
            ]
        counts = {
            "windows dropped": sum(queue.dropped.values()),
            "refusals dropped": sum(queue.unanswered.values()),
        }
        with self.units.lock:
            received = self._admission.status(self.units)
            counts |= self._admission.figures(self.units)
        figures = {
            "follow-ups waiting": self._follow_ups.waiting,
            "follow-ups dropped": self._follow_ups.dropped,
            "ends of threads": self._worker.ends + self._follow_ups.ends,
            "goal rejected": self._calls.rejected or "none",
        }
        return [
            *units,
            *self.prognosis.tasks(actuator_id),
            Task("input", *received, self.hardware_id, counts),
            Task("identification", level, message, self.hardware_id, figures),
        ]

    def now_ns(self) -> int:
        """Return the time of the node's clock [ns]."""
        return self.get_clock().now().nanoseconds

    def calibration_of(self, description: ActuatorDescription) -> AnyCalibration | str:
        """Return the calibration of an actuator, or why there is none."""
        return self._store.of(description)

    def note_description(self, description: ActuatorDescription) -> None:
        """Prepare for a unit that has just been described."""
        for remark in description.remarks:
            self.get_logger().warning(f"{description.actuator_id}: {remark}")
        self.prognosis.describe(description)

    def warn(self, actuator_id: str, text: str, *, is_first: bool = False) -> None:
        """Log what is wrong now and then, and the first of its kind in the status at once."""
        passed = self._throttle.passed(f"{actuator_id or 'input'}: {text}", time.monotonic())
        if passed is not None:
            self.get_logger().warning(passed)
        if is_first:
            self.report(self._tasks_of(actuator_id))

    def log_error(self, text: str) -> None:
        """Log a failure with its traceback."""
        self.get_logger().error(text)

    def add_publishers(self, actuator_id: str) -> Callable[[Health], None]:
        """Create the publishers of an actuator; return what publishes its health."""
        # Listening for what others want takes long where there are many publishers.
        quiet = bool(self._latched)
        for topic, (message_class, qos) in topics.MONITOR_TOPICS.items():
            if qos is topics.LATCHED:
                publisher = self.add_publisher(message_class, topic, qos, quiet=quiet)
                self._latched[topic, actuator_id] = publisher

        def publish(health: Health) -> None:
            self.publish(topics.HEALTH, health)
            self.publish(topics.HEALTH_SUMMARY, summary_of(health))

        return publish

    def publish(self, topic: str, message: Any) -> None:
        """Publish what is latched of an actuator, unless that is forgotten."""
        publisher = self._latched.get((topic, message.actuator_id))
        if publisher is not None:
            publisher.publish(message)

    def queue_window(self, segment: Segment) -> None:
        """Have a window identified."""
        self._calls.add(segment)
        most_waiting = None if self.uses_sim_time else self.operation.value.waiting_windows
        for dropped in self._worker.add(segment, most_waiting):
            self.warn(
                dropped.description.actuator_id,
                f"{'stretch' if dropped.is_stretch else 'window'} {dropped.number} is dropped, "
                f"{len(self._worker.queue)} wait",
            )

    def publish_estimate(self, segment: Segment, estimate: Estimate) -> None:
        """Publish the estimate of a window, and what follows from it."""
        description, actuator_id = segment.description, segment.description.actuator_id
        self._estimates.publish(estimate_to_message(estimate, segment.number, description))
        # Without the lock: telemetry must not wait for a prognosis.
        outlook = self.prognosis.record(description, estimate)
        try:
            self.units.record(segment, estimate, outlook)
        except Exception as error:
            # The estimate is published: the window must not be refused in addition.
            reason = self.prognosis.report_failure(actuator_id, error, "publishing health")
            self.units.add_defect(actuator_id, reason)
        if outlook is not None and estimate.valid:
            self._follow(description, outlook)
        self._follow_ups.follow_estimate(segment, estimate)
        if not estimate.valid:
            reason = f"window {segment.number} has no valid estimate: {estimate.reason}"
            self.warn(actuator_id, reason)
        # Of all of many actuators it would take longer than an identification.
        self.report(self._tasks_of(actuator_id))

    def resume(self, description: ActuatorDescription, outlook: Outlook) -> None:
        """Publish what the history of a unit says of it."""
        with self.units.lock:
            unit = self.units.get(description.actuator_id)
            if unit is None or not self.is_active:
                return
            change = unit.resume(description, outlook, self.now_ns())
        if change:
            self.get_logger().info(f"{description.actuator_id}: {change}")
        if change is not None:
            self._follow(description, outlook)
        self.report(self._tasks_of(description.actuator_id))

    def _follow(self, description: ActuatorDescription, outlook: Outlook) -> None:
        """Have published what follows from a health that has been published."""
        # Only now: it may wait for a prognosis of another thread, and health must not.
        forecaster = self.prognosis.forecaster(description, outlook)
        if forecaster is not None:
            self._follow_ups.follow_health(description, forecaster)

    def forget(self, actuator_id: str) -> None:
        """Follow an actuator no more; what is on disk stays. ValueError when it is not followed."""
        with self.units.lock:
            self.units.forget(actuator_id)
            for key in [key for key in self._latched if key[1] == actuator_id]:
                self.destroy_lifecycle_publisher(self._latched.pop(key))
        self._worker.forget(actuator_id)
        self.prognosis.forget(actuator_id)
        self.report()

    def _check_staleness(self) -> None:
        if not self.is_active:
            return
        stale = self.units.publish_stale()
        for health in stale:
            self.get_logger().warning(f"{health.actuator_id}: {health.reason}")
        if stale:
            self.report()
        if silent := self.units.gives_way():
            self.get_logger().warning(
                f"{silent}: forgotten, as it is silent for more than "
                f"{self.operation.value.forget_after_s:g} s and there is no room for another one"
            )
            self.forget(silent)


def main(args: list[str] | None = None) -> int:
    """Run the monitor."""
    return run(MonitorNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
