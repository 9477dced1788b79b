"""The monitor node: telemetry in, estimates and health out."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.parameter import Parameter

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import Health
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.node.actuators import Actuators
from ema_monitor.node.admission import Admission
from ema_monitor.node.calibration_store import CalibrationStore
from ema_monitor.node.calls import MonitorCalls
from ema_monitor.node.follow_ups import FollowUps
from ema_monitor.node.intake import Intake
from ema_monitor.node.kernels import compile_monitor_kernels
from ema_monitor.node.messages import estimate_to_message
from ema_monitor.node.prognosis import MonitorPrognosis
from ema_monitor.node.selection import Selection, Shard
from ema_monitor.node.settings import Files, Operation, WindowSettings, folder_of
from ema_monitor.node.summary import summary_of
from ema_monitor.node.worker import IdentificationWorker
from ema_monitor.prognosis.advice import Costs
from ema_monitor.prognosis.duty.meter import DutyLog
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
        self._search = LiveSettings(self, SearchSettings)
        self._combining = LiveSettings(self, CombinationSettings)
        self._costs = LiveSettings(self, Costs, "costs.")
        self._operation = LiveSettings(self, Operation)
        self._trigger = LiveSettings(
            self, TriggerSettings, on_change=lambda new: self._intake.restart(new)
        )
        self._health_publishers: dict[str, list[LifecyclePublisher]] = {}
        self._throttle = Throttle(_LOG_PERIOD_S)
        declare(self, Selection)
        declare(self, Shard, "shard.")
        self._admission = Admission(
            read(self, Selection),
            read(self, Shard, "shard."),
            self._operation,
        )
        self._units = Actuators(
            self._admission,
            self._trigger.value,
            self._now_ns,
            self._add_publishers,
            self._note_description,
            self._warn,
            self._inform,
            self._forget_silent,
            self.get_namespace(),
        )
        self._duties = DutyLog()
        self._intake = Intake(
            self._units,
            self._queue_window,
            lambda: self._operation.value.measured_max_age_s,
            self._duties,
        )
        self._prognosis = MonitorPrognosis(
            self,
            self._calibration_of,
            self._units,
            self._resume,
            self._duties,
            lambda: self._operation.value.good_for_s,
        )
        declare(self, Files)
        self._worker = IdentificationWorker(
            self._calibration_of,
            self._prognosis.latest,
            self._window_settings,
            self._publish_estimate,
            self._units.report_tally,
            lambda text: self.get_logger().error(text),
        )
        self._follow_ups = FollowUps(
            self._add_latched_publisher,
            self._calibration_of,
            self._prognosis.write_assessment,
            lambda text: self.get_logger().error(text),
        )
        self._removed: deque[str] = deque()
        self._is_active = False
        self._is_configured = False
        self._in_sim_time = False
        self.add_post_set_parameters_callback(self._follow_clock)

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
        self._calls = MonitorCalls(
            self,
            self._store,
            self._units,
            self._search,
            self._operation,
            lambda: self._is_active and not self.stopping.is_set(),
            self._prognosis.refresh,
            self._forget,
        )
        self._stale_timer = self.create_timer(_STALE_CHECK_S, self._check_staleness)
        self._prognosis.begin(files.history_folder, fleet)
        self._in_sim_time = self._uses_sim_time()
        self._is_configured = True
        self._units.expect_listed()
        if words := self._admission.list_in_words():
            self.get_logger().info(words)
        if described is not None:
            reason = self._admission.why_not(described.actuator_id)
            if reason:
                name = described.actuator_id
                self.get_logger().info(f"{name} of actuator_file is not followed: {reason}")
            else:
                self._intake.describe(described)

    def activate(self) -> None:
        """Subscribe, and identify what is received."""
        self._is_active = True
        self._follow_ups.start()
        self._worker.start()
        with self._units.lock:
            for unit in self._units.values():
                if unit.description is not None:
                    self._prognosis.describe(unit.description)
        receiving = MutuallyExclusiveCallbackGroup()
        known = topics.ACTUATOR_TOPICS | topics.SYSTEM_TOPICS
        self._subscriptions_in_use = [
            subscription
            for name, callback in (
                (topics.USAGE, self._prognosis.receive_usage),
                (topics.DESCRIPTION, self._intake.receive_description),
            )
            for subscription in subscribe_latched(self, known[name][0], name, callback, receiving)
        ]
        self._subscriptions_in_use += [
            self.create_subscription(
                known[name][0], name, callback, topics.STREAM, callback_group=receiving
            )
            for name, callback in (
                (topics.MEASURED_CAUSES, self._intake.receive_measured),
                (topics.TELEMETRY, self._intake.receive_telemetry),
            )
        ]

    def deactivate(self) -> None:
        """Unsubscribe; windows that still wait are refused."""
        with self._units.lock:
            self._is_active = False
        for subscription in self._subscriptions_in_use:
            self.destroy_subscription(subscription)
        self._worker.stop()
        for segment in self._intake.finish():
            self._worker.refuse(segment, "")
        self._follow_ups.stop()
        with self._units.lock:
            for unit in self._units.values():
                unit.withdraw_health(_NOT_ACTIVE)

    def clean_up(self) -> None:
        """Forget the actuators, and end the services."""
        self._is_configured = False
        self._calls.destroy()
        self._prognosis.end()
        self.destroy_timer(self._stale_timer)
        of_health = [item for pair in self._health_publishers.values() for item in pair]
        for publisher in (self._estimates, *of_health, *self._follow_ups.publishers):
            self.destroy_lifecycle_publisher(publisher)
        self._health_publishers.clear()
        self._follow_ups.clear()
        self._units.clear()
        self._intake.clear()
        self._worker.forget()

    def tasks(self) -> list[Task]:
        """Return the status of the actuators, their histories and the identification."""
        return self._tasks_of()

    def _tasks_of(self, actuator_id: str = "") -> list[Task]:
        """Return the status of one actuator and of the identification; of each one when empty."""
        level, message = self._worker.status()
        if self._follow_ups.failure:
            failures = [message] if level == ERROR else []
            level, message = ERROR, "; ".join([*failures, self._follow_ups.failure])
        dropped = self._worker.dropped
        units = self._units.tasks(self._worker.waiting, dropped, actuator_id)
        if not self._is_active:
            units = [
                replace(one, level=STALE, message=f"{_NOT_ACTIVE}, before: {one.message}")
                for one in units
            ]
        return [
            *units,
            *self._prognosis.tasks(actuator_id),
            self._units.input_task(
                self.hardware_id,
                {
                    "windows dropped": sum(dropped.values()),
                    "refusals dropped": sum(self._worker.unanswered.values()),
                },
            ),
            Task(
                "identification",
                level,
                message,
                self.hardware_id,
                {
                    "follow-ups waiting": self._follow_ups.waiting,
                    "follow-ups dropped": self._follow_ups.dropped,
                    "ends of threads": self._worker.ends + self._follow_ups.ends,
                },
            ),
        ]

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds

    def _uses_sim_time(self) -> bool:
        return bool(self.get_parameter("use_sim_time").value)

    def _follow_clock(self, _: list[Parameter]) -> None:
        """Let nothing of one clock mix with the other when ``use_sim_time`` changes."""
        if not self._is_configured or self._uses_sim_time() == self._in_sim_time:
            return
        self._in_sim_time = self._uses_sim_time()
        self._prognosis.suspend()
        for segment in self._intake.finish():
            self._worker.refuse(segment, "")
        self._worker.stop()
        self._follow_ups.stop()
        self._worker.forget()
        self._intake.clear()
        self._units.forget_health()
        self._prognosis.change_clock()
        if self._is_active:
            self._follow_ups.start()
            self._worker.start()
            with self._units.lock:
                for unit in self._units.values():
                    if unit.description is not None:
                        self._prognosis.refresh(unit.description)
        self.report()

    def _note_description(self, description: ActuatorDescription) -> None:
        for remark in description.remarks:
            self.get_logger().warning(f"{description.actuator_id}: {remark}")
        self._prognosis.describe(description)

    def _warn(self, actuator_id: str, text: str, is_first: bool = False) -> None:
        passed = self._throttle.passed(f"{actuator_id or 'input'}: {text}", time.monotonic())
        if passed is not None:
            self.get_logger().warning(passed)
        if is_first:
            self.report(self._tasks_of(actuator_id))

    def _inform(self, text: str) -> None:
        self.get_logger().info(text)

    def _window_settings(self) -> WindowSettings:
        return WindowSettings(
            self._search.value,
            self._combining.value,
            self._prognosis.settings,
            self._costs.value,
            self._operation.value.level_confirmations,
        )

    def _forget(self, actuator_id: str) -> None:
        self._remove(actuator_id)
        self._forget_removed(actuator_id)

    def _remove(self, actuator_id: str) -> None:
        """Follow an actuator no more."""
        with self._units.lock:
            self._units.forget(actuator_id)
            publishers = self._follow_ups.remove_actuator(actuator_id)
            for publisher in (*publishers, *self._health_publishers.pop(actuator_id)):
                self.destroy_lifecycle_publisher(publisher)

    def _forget_removed(self, actuator_id: str) -> None:
        """Forget what is known of an actuator that is not followed; what is on disk stays."""
        self._intake.forget(actuator_id)
        self._worker.forget_actuator(actuator_id)
        self._prognosis.forget(actuator_id)
        self.report()

    def _add_publishers(self, actuator_id: str) -> Callable[[Health], None]:
        """Return what publishes the health of one actuator, so that each health is latched."""
        health, summary = (
            self._add_latched_publisher(topic) for topic in (topics.HEALTH, topics.HEALTH_SUMMARY)
        )
        self._follow_ups.add_actuator(actuator_id)
        self._health_publishers[actuator_id] = [health, summary]

        def publish(message: Health) -> None:
            health.publish(message)
            summary.publish(summary_of(message))

        return publish

    def _add_latched_publisher(self, topic: str) -> LifecyclePublisher:
        message_class, qos = topics.MONITOR_TOPICS[topic]
        quiet = bool(self._health_publishers)
        return self.add_publisher(message_class, topic, qos, quiet=quiet)

    def _queue_window(self, segment: Segment) -> None:
        self._calls.add(segment)
        most_waiting = None if self._uses_sim_time() else self._operation.value.waiting_windows
        for dropped in self._worker.add(segment, most_waiting):
            self._warn(
                dropped.description.actuator_id,
                f"{'stretch' if dropped.is_stretch else 'window'} {dropped.number} is dropped, "
                f"{self._worker.waiting} wait",
            )

    def _calibration_of(self, description: ActuatorDescription) -> AnyCalibration | str:
        return self._store.of(description)

    def _publish_estimate(self, segment: Segment, estimate: Estimate) -> None:
        self._estimates.publish(estimate_to_message(estimate, segment.number, segment.description))
        now_ns, actuator_id = self._now_ns(), segment.description.actuator_id
        settings = self._window_settings()
        # Without the lock: telemetry must not wait for a prognosis.
        outlook = self._prognosis.record(segment, estimate, settings.prognosis)
        try:
            self._units.record(segment, estimate, outlook, now_ns, settings.level_confirmations)
        except Exception as error:
            # The estimate is published: the window must not be refused in addition.
            reason = self._prognosis.report_failure(actuator_id, error, "publishing health")
            self._units.add_defect(actuator_id, reason)
        if outlook is not None and estimate.valid:
            self._follow(segment.description, outlook, settings.costs)
        self._follow_ups.follow_estimate(segment, estimate)
        if not estimate.valid:
            reason = f"window {segment.number} has no valid estimate: {estimate.reason}"
            self._warn(actuator_id, reason)
        # Of all of many actuators it would take longer than an identification.
        self.report(self._tasks_of(actuator_id))

    def _resume(self, description: ActuatorDescription, outlook: Outlook) -> None:
        with self._units.lock:
            unit = self._units.get(description.actuator_id)
            if unit is None or not self._is_active:
                return
            change = unit.resume(description, outlook, self._now_ns())
        if change:
            self.get_logger().info(f"{description.actuator_id}: {change}")
        if change is not None:
            self._follow(description, outlook, self._costs.value)
        self.report(self._tasks_of(description.actuator_id))

    def _follow(self, description: ActuatorDescription, outlook: Outlook, costs: Costs) -> None:
        """Have published what follows from a health that has been published."""
        # Only now: it may wait for a prognosis of another thread, and health must not.
        forecaster = self._prognosis.forecaster(description, outlook)
        if forecaster is not None:
            self._follow_ups.follow_health(description, forecaster, costs)

    def _check_staleness(self) -> None:
        while self._removed:
            self._forget_removed(self._removed.popleft())
        if not self._is_active:
            return
        stale = self._units.publish_stale(self._operation.value.good_for_s)
        for health in stale:
            self.get_logger().warning(f"{health.actuator_id}: {health.reason}")
        if stale:
            self.report()

    def _forget_silent(self, actuator_id: str) -> None:
        """Remove an actuator that is silent, in favour of another one."""
        self.get_logger().warning(
            f"{actuator_id}: forgotten, as it is silent for more than "
            f"{self._operation.value.forget_after_s:g} s and there is no room for another one"
        )
        self._remove(actuator_id)
        # Not now: the lock of the actuators is held, for which a history that is read may wait.
        self._removed.append(actuator_id)


def main(args: list[str] | None = None) -> int:
    """Run the monitor."""
    return run(MonitorNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
