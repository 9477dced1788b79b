# SPDX-License-Identifier: Apache-2.0
"""Start and stop of the background threads of a monitor."""

from collections.abc import Callable, Iterable
from pathlib import Path

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR
from ema_interfaces.msg import NodeStatus
from ema_monitor.baselines.changes import BaselineChange
from ema_monitor.calibrations import CalibrationStore
from ema_monitor.node.publish.actuators import Actuators
from ema_monitor.node.publish.log import Log
from ema_monitor.node.publish.outputs import Outputs
from ema_monitor.node.settings import NodeSettings
from ema_monitor.node.work.baselines import Baselines
from ema_monitor.node.work.calibration_calls import CalibrationCalls
from ema_monitor.node.work.follow_ups import FollowUps
from ema_monitor.node.work.goals import Goals
from ema_monitor.node.work.histories import Histories
from ema_monitor.node.work.identification_goals import IdentificationGoals
from ema_monitor.node.work.prognosis import Reception, UnitPrognoses
from ema_monitor.node.work.prognosis_calls import PrognosisCalls
from ema_monitor.node.work.results import Results
from ema_monitor.node.work.worker import IdentificationWorker
from ema_monitor.reasons import MonitorStopped, Stage
from ema_monitor.windows.finder import Segment
from ema_ros.managed_node import ManagedNode
from ema_ros.status import Task


class Work:
    """Creates the working parts, and starts and stops their threads.

    Attributes
    ----------
    results
        Publishes estimates and health.
    worker
        Identifies windows.
    baselines
        Learned baselines.
    """

    def __init__(
        self,
        node: ManagedNode,
        histories: Histories,
        reception: Reception,
        actuators: Actuators,
        outputs: Outputs,
        settings: NodeSettings,
        store: CalibrationStore,
        baseline_folder: Path | None,
        now_ns: Callable[[], int],
        log: Log,
        *,
        is_simulated: bool,
    ) -> None:
        self._actuators = actuators
        prognosis = UnitPrognoses(histories, reception, settings.operation, store, now_ns, log)
        self._prognosis, self._log = prognosis, log
        self.baselines = Baselines(
            baseline_folder,
            settings.operation,
            store,
            actuators,
            outputs,
            prognosis.alarm,
            self._announce,
            log,
        )
        self._follow_ups = FollowUps(outputs, histories, settings, store, log)
        self.results = Results(
            node, histories, prognosis, self._follow_ups, actuators, outputs, self.baselines, log
        )
        self.worker = IdentificationWorker(
            self.results,
            histories,
            actuators,
            self.baselines,
            settings,
            store,
            log,
            is_simulated=is_simulated,
        )
        self.goals = Goals(node, actuators, settings, log)
        self.identification_goals = IdentificationGoals(
            self.goals, self.worker, actuators, settings, store
        )
        self.calibration_calls = CalibrationCalls(
            node,
            self.goals,
            self.worker,
            prognosis,
            self.results,
            actuators,
            self.baselines,
            settings,
            store,
            log,
        )
        PrognosisCalls(node, histories, prognosis, actuators, log)

    def _announce(
        self, description: ActuatorDescription, change: BaselineChange, is_forced: bool
    ) -> None:
        """Add the change of a baseline to the history of its unit."""
        self._log.info(f"{description.actuator_id}: baseline: {change}")
        outlook = self._prognosis.change_baseline(
            description, change.author, change.after, change.time_ns, is_forced=is_forced
        )
        if outlook is not None:
            self._actuators.add_events(description.actuator_id, outlook.events)

    def start(self) -> None:
        """Start identification and publish the health of described units."""
        self._follow_ups.start()
        self.worker.start()
        with self._actuators.lock:
            for status in self._actuators.values():
                if status.description is not None:
                    self.results.prepare(status.description)

    def stop(self, finish: Callable[[], Iterable[Segment]]) -> None:
        """Refuse queued windows, then open windows, and stop the threads and goals.

        ``finish`` ends the telemetry and returns refusals for the open windows.
        """
        self.worker.stop()
        for segment in finish():
            self.worker.refuse(segment, MonitorStopped(Stage.RECORD))
        self._follow_ups.stop()
        self.goals.finish()

    def count(self, status: NodeStatus) -> None:
        """Add the work counters to the node status."""
        queue = self.worker.queue
        status.windows_waiting = len(queue)
        status.windows_dropped = sum(queue.dropped.values())
        status.refusals_dropped = sum(queue.unanswered.values())
        status.follow_ups_dropped = self._follow_ups.dropped

    def task(self, hardware_id: str) -> Task:
        """Return the status of identification and follow-ups."""
        follow_ups = self._follow_ups
        level, message = self.worker.status()
        if self._actuators.is_active and follow_ups.thread.failure:
            failures = [message] if level == ERROR else []
            level, message = ERROR, "; ".join([*failures, follow_ups.thread.failure])
        figures = {
            "follow-ups waiting": follow_ups.waiting,
            "follow-ups dropped": follow_ups.dropped,
            "ends of threads": self.worker.thread.ends + follow_ups.thread.ends,
            "goal rejected": self.goals.rejected or "none",
        }
        return Task("identification", level, message, hardware_id, figures)
