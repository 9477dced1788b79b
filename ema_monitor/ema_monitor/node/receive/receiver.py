# SPDX-License-Identifier: Apache-2.0
"""Reception of actuator messages and detection of windows."""

import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

from ema_core.description import ActuatorDescription, check_name
from ema_interfaces.srv import ForgetActuator
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.publish.actuators import Actuators
from ema_monitor.node.publish.log import Log
from ema_monitor.node.receive.admission import Admission
from ema_monitor.node.receive.arrivals import Arrivals
from ema_monitor.node.receive.source import TelemetrySource, TelemetrySources
from ema_monitor.node.settings import Operation
from ema_monitor.node.work.results import Results
from ema_monitor.node.work.worker import IdentificationWorker
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.reasons import MonitorInactive, MonitorStopped, SettingsChanged, Stage
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Defect, Refusal, TriggerSettings
from ema_ros import topics
from ema_ros.latched_subscription import subscribe_latched
from ema_ros.managed_node import ManagedNode
from ema_ros.messages import description_from_message, measured_from_message
from ema_ros.node_parameters import LiveSettings
from ema_ros.stamps import stamp_from_message
from ema_ros.status import Task

_MOST_DESCRIBED: Final = 1000


class Receiver:
    """Receives messages in one thread and queues detected windows for the worker.

    An impossible message is reported as a defect of its actuator, or of the node if it names no
    monitored actuator.
    """

    def __init__(
        self,
        admission: Admission,
        sources: TelemetrySources,
        worker: IdentificationWorker,
        results: Results,
        actuators: Actuators,
        operation: LiveSettings[Operation],
        now_ns: Callable[[], int],
        publishing: Callable[[], Collection[str]],
        log: Log,
    ) -> None:
        self._admission = admission
        self._sources = sources
        self._worker = worker
        self._results = results
        self._actuators = actuators
        self._operation = operation
        self._now_ns = now_ns
        # Returns the full names of the nodes that publish telemetry.
        self._publishing = publishing
        self._log = log
        # A latched topic delivers a description only once: keep it in case the actuator returns.
        self._described: dict[str, ActuatorDescription] = {}
        self._not_queued = deque[Segment]()

    def serve(self, node: ManagedNode) -> None:
        """Create the service ``~/forget_actuator`` on a node."""
        # In the thread that receives telemetry: no message is received during the call.
        node.create_service(ForgetActuator, "~/forget_actuator", self._answer_forget)

    def subscribe(self, node: ManagedNode) -> None:
        """Create the subscriptions on a node."""
        group = MutuallyExclusiveCallbackGroup()
        classes = topics.ACTUATOR_TOPICS | topics.SYSTEM_TOPICS
        for name, callback in (
            (topics.USAGE, self.receive_usage),
            (topics.DESCRIPTION, self.receive_description),
        ):
            subscribe_latched(node, classes[name][0], name, callback, group)
        for name, callback in (
            (topics.MEASURED_CAUSES, self.receive_measured),
            (topics.TELEMETRY, self.receive_telemetry),
        ):
            kind = classes[name][0]
            node.create_subscription(kind, name, callback, topics.STREAM, callback_group=group)

    def receive_telemetry(self, message: Any) -> None:
        """Process ``ema_interfaces/msg/TelemetryBlock`` and detect windows."""
        with self._receiving():
            source = self._sources.get(message.actuator_id) or self._admit(message)
            if source is None:
                return
            events = source.receive(message, self._actuators.now().steady_ns)
            if source.status.finder.blocks == 1:
                self._log.info(f"{message.actuator_id}: first telemetry")
            if events:
                self._deliver(source, events)
            if source.status.runs.are_several and not source.status.collision:
                self._warn_of_publishers(source.status)

    def receive_description(self, message: Any) -> None:
        """Apply ``ema_interfaces/msg/ActuatorDescription``."""
        if not self._accepts(message, "description"):
            return
        try:
            self.describe(description_from_message(message))
        except ValueError as error:
            self.add_defect(message.actuator_id, f"invalid description: {error}")

    def receive_measured(self, message: Any) -> None:
        """Store ``ema_interfaces/msg/MeasuredCauses``."""
        actuator_id = message.actuator_id
        with self._actuators.lock:
            self._admission.note_measured(actuator_id, time.monotonic())
        if not self._accepts(message, "measured causes"):
            return
        try:
            stamp_ns, measured = measured_from_message(message)
            with self._actuators.lock:
                self._sources.measurements.add(actuator_id, stamp_ns, measured)
        except ValueError as error:
            # A measurement alone does not start the monitoring of an actuator.
            self.add_defect(actuator_id, str(error), is_monitored=actuator_id in self._sources)

    def receive_usage(self, message: Any) -> None:
        """Record usage counts from ``ema_interfaces/msg/Usage``."""
        if not self._accepts(message, "usage"):
            return
        actuator_id = message.actuator_id
        status = self._actuators.get(actuator_id)
        described = status.description if status else None
        # A count without a stamp, or from an actuator without a clock, gets the present time.
        has_clock = self._operation.value.has_clock
        stamp_ns = stamp_from_message(message.header.stamp) if has_clock else 0
        try:
            count = Count(stamp_ns or self._now_ns(), message.flight_hours, message.cycles)
            # A count without a serial number belongs to the described unit.
            serial_number = message.serial_number or (described.serial_number if described else "")
            self._sources.counts.add((actuator_id, serial_number), count)
        except ValueError as error:
            # A count alone does not start the monitoring of an actuator.
            reason = f"usage is impossible: {error}"
            self.add_defect(actuator_id, reason, is_monitored=status is not None)

    def expect_listed(self) -> None:
        """Add the listed actuators, so that the status also shows actuators without telemetry."""
        self._admission.check()
        for actuator_id in self._admission.listed:
            self._get_or_add(actuator_id)
        if text := self._admission.describe_list():
            self._log.info(text)

    def expect_described(self, described: ActuatorDescription) -> None:
        """Apply the configured actuator file for actuators that do not publish a description."""
        if reason := self._admission.why_not(described.actuator_id):
            name = described.actuator_id
            self._log.info(f"{name} of actuator_file is not monitored: {reason}")
        else:
            self.describe(described)

    def describe(self, description: ActuatorDescription) -> None:
        """Apply the description of an actuator, if the actuator is monitored."""
        with self._receiving():
            source = self._get_or_add(description.actuator_id, description)
            if source is None:
                return
            status = source.status
            before = status.description
            self._deliver(source, source.intake.describe(description))
            if before is not None and before.serial_number != description.serial_number:
                status.health.reset(self._actuators.now().steady_ns)
                if status.exchange(before.serial_number, description.serial_number):
                    self._log.warn(status.actuator_id, status.alternation, is_first=True)
        if before != description:
            self._prepare(description)

    def _prepare(self, description: ActuatorDescription) -> None:
        """Prepare the prognosis of a unit that has just been described."""
        for remark in description.remarks:
            self._log.warning(f"{description.actuator_id}: {remark}")
        self._results.prepare(description)

    def restart(self, settings: TriggerSettings) -> None:
        """Apply new trigger settings; an open window is refused."""
        with self._receiving():
            self._sources.trigger = settings
            for source in self._sources.values():
                events = source.intake.restart(settings, SettingsChanged())
                # Without an open window, the change is not a defect.
                self._deliver(source, [event for event in events if isinstance(event, Segment)])

    def check(self) -> None:
        """Publish health that has become stale, and end the records of silent actuators."""
        if not self._actuators.is_active:
            return
        with self._receiving():
            stale = self._actuators.expire()
            for source in self._sources.values():
                # No later position can end the last record of telemetry that has stopped.
                if source.status.is_silent and source.status.finder.finds_records:
                    self._deliver(source, source.intake.finish())
        for health in stale:
            self._log.warning(f"{health.actuator_id}: {health.reason}")
        if stale:
            self._log.report()

    def check_publishers(self) -> None:
        """Count the losses of each publisher, and update the warnings about several publishers."""
        with self._actuators.lock:
            for source in self._sources.values():
                source.status.runs.settle(time.monotonic())
                self._warn_of_publishers(source.status)

    def _warn_of_publishers(self, status: ActuatorStatus) -> None:
        if status.check_publishers(self._publishing):
            self._log.warn(status.actuator_id, status.collision, is_first=True)

    def finish(self) -> list[Segment]:
        """End the telemetry of all actuators. Return refusals for the open windows."""
        with self._actuators.lock:
            for source in self._sources.values():
                source.status.runs.pause()
            events = [
                event for source in self._sources.values() for event in source.intake.finish()
            ]
        return [_cut_off(event) for event in events if isinstance(event, Segment)]

    def forget(self, actuator_id: str) -> None:
        """Stop monitoring an actuator; its files are kept.

        Raises
        ------
        ValueError
            If the actuator is not monitored.
        """
        with self._actuators.lock:
            source = self._sources.get(actuator_id)
            if source is None:
                raise ValueError(self._actuators.not_monitored(actuator_id))
            source.intake.finish()
            if source.status.description is not None:
                self._remember(source.status.description)
            del self._sources[actuator_id]
            self._sources.measurements.forget(actuator_id)
            self._admission.forget_measured(actuator_id)
            self._actuators.forget(actuator_id)
        self._worker.forget(actuator_id)
        self._results.forget(actuator_id)
        self._log.report()

    def task(self, hardware_id: str) -> Task:
        """Return the status of the reception from all actuators."""
        queue = self._worker.queue
        counts = {
            "windows dropped": sum(queue.dropped.values()),
            "refusals dropped": sum(queue.unanswered.values()),
        }
        with self._actuators.lock:
            is_receiving = self._actuators.receives_telemetry()
            level, message = self._admission.status(
                self._actuators, time.monotonic(), is_receiving=is_receiving
            )
            figures = counts | self._admission.figures(self._actuators)
        return Task("input", level, message, hardware_id, figures)

    def _accepts(self, message: Any, what: str) -> bool:
        """Return whether a message's actuator may be monitored; count refused messages."""
        actuator_id = message.actuator_id
        if actuator_id in self._sources:
            return True
        if actuator_id and self._admission.ignores(actuator_id):
            return False
        try:
            check_name("actuator_id", actuator_id)
        except ValueError:
            wrong = "with an impossible" if actuator_id else "without"
            self.add_defect(actuator_id, f"{what} {wrong} actuator_id", is_monitored=False)
            return False
        return True

    def _admit(self, message: Any) -> TelemetrySource | None:
        """Return the source for an actuator's first telemetry; None if it is not monitored."""
        if not self._accepts(message, "telemetry"):
            return None
        return self._get_or_add(message.actuator_id)

    def _get_or_add(
        self, actuator_id: str, description: ActuatorDescription | None = None
    ) -> TelemetrySource | None:
        """Return an actuator's source, created if new; None if admission refuses the actuator."""
        if (source := self._sources.get(actuator_id)) is not None:
            return source
        if (reason := self._admission.refuse(actuator_id, self._sources)) is not None:
            if description is not None:
                self._remember(description)
            if reason:
                self._log.warn(actuator_id, reason, is_first=True)
            return None
        source = self._add(actuator_id)
        remembered = self._described.pop(actuator_id, None)
        if remembered is not None and description is None:
            source.intake.describe(remembered)
            self._prepare(remembered)
        return source

    def _add(self, actuator_id: str) -> TelemetrySource:
        """Start monitoring an actuator in all parts. Return its source."""
        intake, arrivals = self._sources.new_intake(actuator_id), Arrivals()
        self._worker.follow(actuator_id)
        status = self._actuators.follow(actuator_id, intake.finder, arrivals)
        status.is_listed = actuator_id in self._admission.listed
        source = self._sources[actuator_id] = TelemetrySource(intake, arrivals, status)
        return source

    @contextmanager
    def _receiving(self) -> Iterator[None]:
        """Hold the lock of the actuators in a context; then refuse windows that were not queued.

        A refusal may open a history, which must not happen under the lock: a thread that opens a
        history acquires the lock to publish its health.
        """
        with self._actuators.lock:
            yield
        while self._not_queued:
            segment = self._not_queued.popleft()
            self._worker.refuse(segment, MonitorInactive(), is_dropped=True)

    def _deliver(self, source: TelemetrySource, events: Iterable[Segment | Defect]) -> None:
        """Queue windows for identification, and report defects."""
        for event in events:
            if isinstance(event, Defect):
                self.add_defect(source.status.actuator_id, event.reason)
            elif not self._worker.add(event):
                self._not_queued.append(event)

    def add_defect(self, actuator_id: str, reason: str, *, is_monitored: bool = True) -> None:
        """Record and report a defect of an actuator, or of the node if it is not monitored."""
        with self._actuators.lock:
            source = self._get_or_add(actuator_id) if actuator_id and is_monitored else None
            if source is not None:
                is_first = source.status.add_defect(reason)
            else:
                is_first = self._admission.note_wrong(actuator_id, reason)
        self._log.warn(actuator_id, reason, is_first=is_first)

    def _remember(self, description: ActuatorDescription) -> None:
        """Remember the description of an actuator that is not monitored."""
        self._described.pop(description.actuator_id, None)
        self._described[description.actuator_id] = description
        if len(self._described) > _MOST_DESCRIBED:
            del self._described[next(iter(self._described))]

    def _answer_forget(
        self, request: ForgetActuator.Request, response: ForgetActuator.Response
    ) -> ForgetActuator.Response:
        self.forget(request.actuator_id)
        self._log.info(f"{request.actuator_id}: forgotten")
        response.success = True
        response.message = (
            f"{request.actuator_id!r} is forgotten; its next message starts the monitoring again"
        )
        return response


def _cut_off(segment: Segment) -> Segment:
    """Return a refusal for a window or record cut off because the monitor stops."""
    window = segment.window
    if isinstance(window, Refusal):
        return segment
    cause = MonitorStopped(Stage.RECORD)
    return replace(segment, window=Refusal(window.start_ns, window.end_ns, cause, is_cut_off=True))
