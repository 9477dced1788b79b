# SPDX-License-Identifier: Apache-2.0
"""Monitor node: subscribes to telemetry, publishes estimates and health."""

from functools import partial
from pathlib import Path
from typing import Any, Final

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import NodeStatus
from ema_monitor.baselines.unit_baseline import calibration_pattern
from ema_monitor.calibrations import CalibrationStore
from ema_monitor.node.publish.actuators import Actuators
from ema_monitor.node.publish.log import Log
from ema_monitor.node.publish.outputs import Outputs
from ema_monitor.node.receive.admission import Admission, Selection, Shard
from ema_monitor.node.receive.receiver import Receiver
from ema_monitor.node.receive.receiver_clock import ReceiverClock
from ema_monitor.node.receive.source import TelemetrySources
from ema_monitor.node.settings import Files, NodeSettings, folder_of
from ema_monitor.node.work.histories import Histories
from ema_monitor.node.work.kernels import compile_monitor_kernels
from ema_monitor.node.work.work import Work
from ema_monitor.prognosis.fleet_growth import FleetGrowth
from ema_monitor.reason_texts import text_of
from ema_monitor.reasons import Reason
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros import topics
from ema_ros.actuator_file import load_description
from ema_ros.managed_node import ManagedNode
from ema_ros.node_parameters import declare, read
from ema_ros.peers import nodes_publishing
from ema_ros.run import run
from ema_ros.status import Task

_STALE_CHECK_S: Final = 1.0
_PUBLISHERS_CHECK_S: Final = 1.0
_CLOCK_FILE: Final = "clock.json"


class MonitorNode(ManagedNode):
    """ROS node that monitors actuators: receives telemetry, publishes faults and health.

    It has three parts: ``receive`` finds windows in the telemetry, ``work`` identifies faults and
    predicts lives, and ``publish`` publishes estimates and health. Telemetry is received in one
    thread and windows are identified in another, in the order in which they end.
    ``docs/nodes.md`` describes topics, services and parameters.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("monitor", **kwargs)
        self.settings = NodeSettings(self, self._restart)
        declare(self, Selection)
        declare(self, Shard, "shard.")
        declare(self, Files)
        self._log = Log(self)

    def configure(self) -> None:
        """Read files, compile kernels and create the parts of the node."""
        files = read(self, Files)
        learned = calibration_pattern(files.baselines) if files.baselines else ""
        store = CalibrationStore(
            files.calibration_file, folder_of(files.calibration_folder), learned
        )
        description = load_description(Path(files.actuator_file)) if files.actuator_file else None
        if "{" not in files.calibration_file:
            calibration = store.of(description or ActuatorDescription())
            if isinstance(calibration, Reason):
                self._log.warning(text_of(calibration))
        fleet = FleetGrowth.read(folder_of(files.fleet_file)) if files.fleet_file else None
        # Before the subscriptions: no window waits for the compilation.
        compile_monitor_kernels(lambda: self.is_ending, self.report_progress)
        self._build(files, store, fleet)
        self.receiver.expect_listed()
        if description is not None:
            self.receiver.expect_described(description)

    def _build(self, files: Files, store: CalibrationStore, fleet: FleetGrowth | None) -> None:
        """Create and connect the publishing, working and receiving parts."""
        settings, log, namespace = self.settings, self._log, self.unit_namespace
        is_simulated = bool(self.get_parameter("use_sim_time").value)
        folder = files.histories(is_simulated=is_simulated)
        clock = ReceiverClock(
            self._now_ns, is_simulated=is_simulated, kept=folder / _CLOCK_FILE if folder else None
        )
        selection, shard = read(self, Selection), read(self, Shard, "shard.")
        admission = Admission(selection, shard, settings.operation)
        self.histories = Histories(
            folder,
            lambda: settings.prognosis(fleet),
            self.get_fully_qualified_name(),
            namespace,
            log,
            lambda: clock.passed_ns,
        )
        self.outputs = Outputs(self.add_publisher, self.destroy_lifecycle_publisher)
        self.actuators = Actuators(
            self.outputs,
            namespace,
            clock.read,
            settings.operation,
            admission.why_not,
            self.histories.rewind,
            self.histories.mark_clock_step,
            log,
        )
        self.sources = TelemetrySources(
            settings.trigger.value, settings.operation, self.actuators.lock
        )
        self.work = Work(
            self,
            self.histories,
            self.sources,
            self.actuators,
            self.outputs,
            settings,
            store,
            files.baselines,
            self._now_ns,
            log,
            is_simulated=is_simulated,
        )
        self.receiver = Receiver(
            admission,
            self.sources,
            self.work.worker,
            self.work.results,
            self.actuators,
            settings.operation,
            self._now_ns,
            partial(nodes_publishing, self, self.resolve_topic_name(topics.TELEMETRY)),
            log,
        )
        self.receiver.serve(self)
        # A backward step of the system clock stops a timer on it; simulated time may step back.
        add_timer = self.create_timer if is_simulated else self.add_timer
        add_timer(_STALE_CHECK_S, self.receiver.check)
        self.add_timer(_PUBLISHERS_CHECK_S, self.receiver.check_publishers)

    def activate(self) -> None:
        """Start the identification thread and subscribe to telemetry."""
        self.actuators.is_active = True
        self.work.start()
        self.receiver.subscribe(self)

    def deactivate(self) -> None:
        """Refuse the queued windows, and withdraw the health of all actuators."""
        with self.actuators.lock:
            self.actuators.is_active = False
        self.work.stop(self.receiver.finish)
        self.actuators.withdraw()

    def clean_up(self) -> None:
        """Close the histories, and forget the actuators."""
        # A goal of an inactive monitor may load a calibration.
        self.work.goals.finish()
        self.histories.close()
        self.work.baselines.close()
        self.actuators.clear()
        self.sources.clear()

    def counts(self) -> NodeStatus:
        """Return the counts of each actuator and of the node."""
        telemetry = self.actuators.telemetry(self.work.worker.queue.dropped)
        status = NodeStatus(kind=NodeStatus.MONITOR, telemetry=telemetry)
        self.work.count(status)
        return status

    def tasks(self, actuator_id: str = "") -> list[Task]:
        """Return the status of the node and one actuator; an empty name selects all actuators."""
        queue = self.work.worker.queue
        return [
            *self.actuators.tasks(actuator_id, len(queue), queue.dropped),
            *self.histories.tasks(actuator_id),
            self.receiver.task(self.hardware_id),
            self.work.task(self.hardware_id),
        ]

    def _restart(self, trigger: TriggerSettings) -> None:
        if self.is_configured:
            self.receiver.restart(trigger)

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def main(args: list[str] | None = None) -> int:
    """Run the monitor node and return the exit status."""
    return run(MonitorNode, args)
