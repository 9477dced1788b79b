"""The monitor node: telemetry in, estimates and health out."""

import time
import traceback
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle.publisher import LifecyclePublisher

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import Health, NodeStatus
from ema_monitor.calibrations import CalibrationStore
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.node.actuators import Actuators
from ema_monitor.node.admission import Admission, Selection, Shard
from ema_monitor.node.calls import MonitorCalls
from ema_monitor.node.follow_ups import FollowUps
from ema_monitor.node.kernels import compile_monitor_kernels
from ema_monitor.node.messages import summary_of
from ema_monitor.node.prognosis import MonitorPrognosis
from ema_monitor.node.settings import Files, Operation, folder_of
from ema_monitor.node.unit_status import telemetry_status, unit_tasks
from ema_monitor.node.worker import IdentificationWorker
from ema_monitor.prognosis.advice import Costs
from ema_monitor.prognosis.fleet import Fleet
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
        chosen, shard = read(self, Selection), read(self, Shard, "shard.")
        self.units = Actuators(self, Admission(chosen, shard, self.operation), trigger)
        self.prognosis = MonitorPrognosis(self)
        self.worker = IdentificationWorker(self)
        self.follow_ups = FollowUps(self)
        self._throttle = Throttle(_LOG_PERIOD_S)
        # One of each topic for each actuator, so that each is latched.
        self._latched: dict[tuple[str, str], LifecyclePublisher] = {}
        self.is_active = False

    def configure(self) -> None:
        """Read the files, compile the kernels, and create what publishes and serves."""
        files = read(self, Files)
        self.store = CalibrationStore(files.calibration_file, folder_of(files.calibration_folder))
        described = load_description(Path(files.actuator_file)) if files.actuator_file else None
        if "{" not in files.calibration_file:
            reason = self.store.of(described or ActuatorDescription())
            if isinstance(reason, str):
                self.get_logger().warning(reason)
        fleet = Fleet.read(folder_of(files.fleet_file)) if files.fleet_file else None
        # Now, as no window waits for them yet.
        compile_monitor_kernels(self)
        message_class, qos = topics.MONITOR_TOPICS[topics.FAULT_ESTIMATE]
        self.estimates = self.add_publisher(message_class, topics.FAULT_ESTIMATE, qos)
        self._calls = MonitorCalls(self)
        # On the clock of the system, a backward step would stop it; on simulated time it does not.
        is_simulated = self.get_parameter("use_sim_time").value
        add_timer = self.create_timer if is_simulated else self.add_timer
        add_timer(_STALE_CHECK_S, self.units.check)
        self.prognosis.begin(files.history_folder, fleet)
        self.units.begin(self.prognosis.folder)
        self.units.expect_listed()
        if words := self.units.admission.list_in_words():
            self.get_logger().info(words)
        if described is not None:
            if reason := self.units.admission.why_not(described.actuator_id):
                name = described.actuator_id
                self.get_logger().info(f"{name} of actuator_file is not followed: {reason}")
            else:
                self.units.describe(described)

    def activate(self) -> None:
        """Subscribe, and identify what is received."""
        self.is_active = True
        self.follow_ups.start()
        self.worker.start()
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
        self.worker.stop()
        for segment in self.units.finish():
            self.worker.refuse(segment, "")
        self.follow_ups.stop()
        with self.units.lock:
            for unit in self.units.values():
                unit.withdraw_health(_NOT_ACTIVE)

    def clean_up(self) -> None:
        """Forget the actuators."""
        self.prognosis.end()
        self._latched.clear()
        self.follow_ups.dropped = 0
        self.units.clear()

    def counts(self) -> NodeStatus:
        """Return what is counted of each actuator, and of all of them."""
        queue = self.worker.queue
        with self.units.lock:
            telemetry = [
                telemetry_status(unit, queue.dropped[name]) for name, unit in self.units.items()
            ]
        return NodeStatus(
            kind=NodeStatus.MONITOR,
            telemetry=telemetry,
            windows_waiting=len(queue),
            windows_dropped=sum(queue.dropped.values()),
            refusals_dropped=sum(queue.unanswered.values()),
            follow_ups_dropped=self.follow_ups.dropped,
        )

    def tasks(self, actuator_id: str = "") -> list[Task]:
        """Return the status of one actuator and of the identification; of each one when empty."""
        queue, follow_ups = self.worker.queue, self.follow_ups
        level, message = self.worker.status()
        if self.is_active and follow_ups.thread.failure:
            failures = [message] if level == ERROR else []
            level, message = ERROR, "; ".join([*failures, follow_ups.thread.failure])
        status = self.counts()
        counts = {
            "windows dropped": status.windows_dropped,
            "refusals dropped": status.refusals_dropped,
        }
        waiting, admission = status.windows_waiting, self.units.admission
        with self.units.lock:
            is_heard = any(one.finder.blocks and not one.is_silent for one in self.units.values())
            received = admission.status(self.units, is_heard=is_heard)
            counts |= admission.figures(self.units)
            units = [
                task
                for name, unit in self.units.items()
                if actuator_id in ("", name)
                for task in unit_tasks(unit, waiting, queue.dropped[name])
            ]
        if not self.is_active:
            units = [
                replace(one, level=STALE, message=f"{_NOT_ACTIVE}, before: {one.message}")
                for one in units
            ]
        figures = {
            "follow-ups waiting": follow_ups.waiting,
            "follow-ups dropped": status.follow_ups_dropped,
            "ends of threads": self.worker.thread.ends + follow_ups.thread.ends,
            "goal rejected": self._calls.rejected or "none",
        }
        return [
            *units,
            *self.prognosis.tasks(actuator_id),
            Task("input", *received, self.hardware_id, counts),
            Task("identification", level, message, self.hardware_id, figures),
        ]

    def warn(self, actuator_id: str, text: str, *, is_first: bool = False) -> None:
        """Log what is wrong now and then, and the first of its kind in the status at once."""
        passed = self._throttle.passed(f"{actuator_id or 'input'}: {text}", time.monotonic())
        if passed is not None:
            self.get_logger().warning(passed)
        if is_first:
            self.report(self.tasks(actuator_id))

    def failed(self, where: str, what: str, error: Exception) -> str:
        """Log what has just failed, with its traceback, and return the reason."""
        reason = f"{what} failed: {error!r}"
        self.get_logger().error(f"{where or 'actuator'}: {reason}\n{traceback.format_exc()}")
        return reason

    def add_publishers(self, actuator_id: str) -> None:
        """Create the publishers of an actuator."""
        # Listening for what others want takes long where there are many publishers.
        quiet = bool(self._latched)
        for topic, (message_class, qos) in topics.MONITOR_TOPICS.items():
            if qos is topics.LATCHED:
                publisher = self.add_publisher(message_class, topic, qos, quiet=quiet)
                self._latched[topic, actuator_id] = publisher

    def publish_health(self, health: Health) -> None:
        """Publish the health of an actuator, whole and in a few lines."""
        self.publish(topics.HEALTH, health)
        self.publish(topics.HEALTH_SUMMARY, summary_of(health))

    def publish(self, topic: str, message: Any) -> None:
        """Publish what is latched of an actuator, unless that is forgotten."""
        publisher = self._latched.get((topic, message.actuator_id))
        if publisher is not None:
            publisher.publish(message)

    def remove_publishers(self, actuator_id: str) -> None:
        """Remove the publishers of an actuator."""
        for key in [key for key in self._latched if key[1] == actuator_id]:
            self.destroy_lifecycle_publisher(self._latched.pop(key))


def main(args: list[str] | None = None) -> int:
    """Run the monitor."""
    return run(MonitorNode, args)
