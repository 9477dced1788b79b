# SPDX-License-Identifier: Apache-2.0
"""Service and action calls: calibration, and identification with a chosen algorithm."""

import threading
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import replace
from queue import Empty, SimpleQueue
from typing import Any, Final

from rclpy.action.server import ActionServer, CancelResponse, GoalResponse

from ema_core.description import ActuatorDescription
from ema_core.wording import counted, one_line
from ema_interfaces.action import IdentifyFaults
from ema_interfaces.srv import Calibrate, ChangeBaseline
from ema_monitor.baselines.changes import Kind
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.calibrations import CalibrationStore, calibrate
from ema_monitor.diagnosis import Identification
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.model.measured import measured_ranges
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.publish.actuators import NOT_ACTIVE, Actuators
from ema_monitor.node.publish.log import Log
from ema_monitor.node.publish.messages import estimate_to_message, unknown_estimate
from ema_monitor.node.settings import MonitorSettings
from ema_monitor.node.work.baselines import Baselines
from ema_monitor.node.work.prognosis import Prognosis
from ema_monitor.node.work.results import Results
from ema_monitor.node.work.worker import IdentificationWorker
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.window import Window
from ema_ros import topics
from ema_ros.executor import SeparateCallbackGroup
from ema_ros.managed_node import ManagedNode
from ema_ros.messages import faults_to_message
from ema_ros.throttle import Throttle

_POLL_S: Final = 0.1
_MOST_GOALS: Final = 2
_MOST_WINDOWS: Final = 200
_REJECTION_S: Final = 1.0
_KINDS: Final = {
    ChangeBaseline.Request.ACCEPT: Kind.ACCEPT,
    ChangeBaseline.Request.EXTEND: Kind.EXTEND,
    ChangeBaseline.Request.RESET: Kind.RESET,
}


class MonitorCalls:
    """The services ``~/calibrate`` and ``~/change_baseline``, and the action ``~/identify_faults``.

    Both may take long; they run in threads that do not receive telemetry.

    Attributes
    ----------
    rejected
        Reason why the latest goal was rejected; empty if it was accepted.
    """

    def __init__(
        self,
        node: ManagedNode,
        worker: IdentificationWorker,
        prognosis: Prognosis,
        results: Results,
        actuators: Actuators,
        baselines: Baselines,
        settings: MonitorSettings,
        store: CalibrationStore,
        log: Log,
    ) -> None:
        self._worker = worker
        self._prognosis = prognosis
        self._results = results
        self._actuators = actuators
        self._baselines = baselines
        self._settings = settings
        self._store = store
        self._log = log
        self._is_stopping: Callable[[], bool] = node.stopping.is_set
        self.rejected = ""
        self._rejections = Throttle(_REJECTION_S)
        self._free_goals = threading.Semaphore(_MOST_GOALS)
        node.create_service(
            Calibrate, "~/calibrate", self._calibrate, callback_group=SeparateCallbackGroup()
        )
        node.create_service(
            ChangeBaseline,
            "~/change_baseline",
            self._change_baseline,
            callback_group=SeparateCallbackGroup(),
        )
        ActionServer(
            node,
            IdentifyFaults,
            "~/identify_faults",
            self._identify,
            goal_callback=self._accept_or_reject,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            goal_service_qos_profile=topics.SERVICE,
            result_service_qos_profile=topics.SERVICE,
            cancel_service_qos_profile=topics.SERVICE,
        )

    def _calibrate(
        self, request: Calibrate.Request, response: Calibrate.Response
    ) -> Calibrate.Response:
        _, description = self._actuators.find(request.actuator_id)
        try:
            return self._calibrate_unit(description, request, response)
        except (ValueError, OSError) as error:
            self._log.warning(f"{description.actuator_id}: not calibrated: {error}")
            raise

    def _calibrate_unit(
        self,
        description: ActuatorDescription,
        request: Calibrate.Request,
        response: Calibrate.Response,
    ) -> Calibrate.Response:
        person = one_line("person", request.person, 60) if request.person or request.force else ""
        if self._baselines.learns(description):
            raise ValueError(
                f"the baseline of {description.actuator_id!r} is learned: use ~/change_baseline"
            )
        before = self._store.of(description)
        if not request.force:
            self._require_no_alarm(description)
        if request.load:
            calibration, path = self._store.load(description, request.file)
            message = f"loaded from {path}"
        else:
            self._require_active()
            path = self._store.prepare(description, request.file)
            self._log.info(f"{description.actuator_id}: calibration is requested")
            windows = list(self._healthy_windows(description.actuator_id, request.windows))
            if not request.force:
                self._require_no_alarm(description)
            accepted_by = person if request.force else ""
            has_clock = self._settings.operation.value.has_clock
            if description.drive == "unknown" and not has_clock:
                windows = [window.without_date() for window in windows]
            calibration = calibrate(windows, description, accepted_by=accepted_by)
            self._store.keep(description, calibration, path)
            message = f"fitted to {counted(len(windows), 'window')}"
            if taken := measured_ranges(window.measured for window in windows):
                message += f"; measured causes: {taken}"
            message += f" and stored in {path}"
            if not self._store.is_used_again(description, path):
                message += "; to use it after a restart, set calibration_file to this path"
            if isinstance(calibration, JointCalibration) and calibration.outliers:
                message += f"; {'; '.join(map(str, calibration.outliers))}"
        if calibration.not_learned:
            text = ", ".join(name.replace("_", " ") for name in calibration.not_learned)
            message += f"; not learned from the healthy windows: {text}"
        if isinstance(before, str) or before.calibration_id != calibration.calibration_id:
            outlook = self._prognosis.change_baseline(
                description, person, calibration.calibration_id, is_forced=request.force
            )
            if outlook is not None:
                self._actuators.add_events(description.actuator_id, outlook.events)
        self._results.prepare(description)
        self._log.info(f"calibration: {message}")
        response.success, response.message = True, message
        response.calibration_id = calibration.calibration_id
        return response

    def _change_baseline(
        self, request: ChangeBaseline.Request, response: ChangeBaseline.Response
    ) -> ChangeBaseline.Response:
        _, description = self._actuators.find(request.actuator_id)
        kind = _KINDS.get(request.change)
        if kind is None:
            raise ValueError(f"change = {request.change}: expected 0 to {len(_KINDS) - 1}")
        response.message = self._baselines.change(
            description, kind, request.person, request.note, force=request.force
        )
        response.success = True
        self._log.report_on(description.actuator_id)
        return response

    def _require_no_alarm(self, description: ActuatorDescription) -> None:
        """Raise ValueError if the latest test of the unit gives a warning or failure."""
        if alarm := self._prognosis.alarm(description):
            raise ValueError(
                f"unit {description.serial_number!r} of {description.actuator_id!r} is not "
                f"healthy: {alarm}; a calibration would define its present state as healthy: "
                "repair it first, or set force and person"
            )

    def _healthy_windows(self, actuator_id: str, number: int) -> Iterator[Window]:
        """Yield the next windows of an actuator, skipping refused windows."""
        if not 1 <= number <= _MOST_WINDOWS:
            raise ValueError(f"windows = {number}: expected 1 to {_MOST_WINDOWS} healthy windows")
        unit, _ = self._actuators.find(actuator_id)
        timeout_s = self._timeout_s(unit)
        work = self._worker.of(unit.actuator_id)
        with work.next_windows() as windows, unit.calibrating():
            for made in range(number):
                deadline_s = time.monotonic() + timeout_s
                refused = ""
                while segment := self._next(windows, deadline_s):
                    if isinstance(segment.window, Window):
                        yield segment.window
                        break
                    refused = f"; the latest was refused: {segment.window.reason}"
                else:
                    raise ValueError(
                        f"no healthy window within {timeout_s:g} s, after {made} of "
                        f"{number}{refused}"
                    )

    def _timeout_s(self, unit: ActuatorStatus) -> float:
        """Return the timeout for the next window [s]; it is longer for a record."""
        timeout_s = self._settings.operation.value.calibration_timeout_s
        return timeout_s + unit.finder.longest_s if unit.finder.finds_records else timeout_s

    def _next(
        self, windows: SimpleQueue[Segment], deadline_s: float, goal: Any = None
    ) -> Segment | None:
        """Wait for the next window; return None at the deadline or on cancellation."""
        while time.monotonic() < deadline_s and not (goal and goal.is_cancel_requested):
            self._require_active()
            try:
                return windows.get(timeout=_POLL_S)
            except Empty:
                continue
        return None

    def _require_active(self) -> None:
        if not self._actuators.is_active or self._is_stopping():
            raise ValueError(NOT_ACTIVE)

    def _accept_or_reject(self, request: IdentifyFaults.Goal) -> GoalResponse:
        """Reject invalid goals, and goals beyond the limit of concurrent goals."""
        try:
            self._require_active()
            unit, _ = self._actuators.find(request.actuator_id)
            self._search_for(request)
            if not request.next_window:
                self._latest(unit)
            if not self._free_goals.acquire(blocking=False):
                raise ValueError(f"{_MOST_GOALS} goals are already running")
        except ValueError as error:
            self.rejected = str(error)
            text = f"goal of identify_faults rejected: {error}"
            if (passed := self._rejections.passed(text, time.monotonic())) is not None:
                self._log.warning(passed)
                self._log.report()
            return GoalResponse.REJECT
        self.rejected = ""
        return GoalResponse.ACCEPT

    def _identify(self, goal: Any) -> IdentifyFaults.Result:
        result = IdentifyFaults.Result()
        try:
            self._identify_for(goal, result)
        except ValueError as error:
            result.message = str(error)
        except Exception as error:
            result.message = f"failed: {error!r}"
            self._log.error(f"identify_faults {result.message}\n{traceback.format_exc()}")
        finally:
            self._free_goals.release()
        if not result.estimate.algorithm:
            result.estimate = unknown_estimate(goal.request.actuator_id, result.message)
        if result.success:
            goal.succeed()
        elif goal.is_cancel_requested:
            result.message = "cancelled"
            goal.canceled()
        else:
            goal.abort()
        return result

    def _identify_for(self, goal: Any, result: IdentifyFaults.Result) -> None:
        """Identify the window of a goal, unless the goal is cancelled."""
        unit, _ = self._actuators.find(goal.request.actuator_id)
        search = self._search_for(goal.request)
        segment = self._window(unit, goal)
        if segment is None:
            return
        if segment.is_stretch:
            raise ValueError(
                "windows = 'any_motion': a single stretch of ordinary motion does not determine "
                "the faults; topic fault_estimate has the estimate from combined stretches; to "
                "identify a test cycle, set `windows` to 'test_cycle'"
            )
        # No warm start: the result depends on the window and the goal alone.
        calibration = self._store.of(segment.description)
        run = Identification(segment.window, segment.description, calibration, search)
        for generation in run:
            if goal.is_cancel_requested:
                return
            self._require_active()
            goal.publish_feedback(
                IdentifyFaults.Feedback(
                    generation=generation.generation,
                    evaluations=generation.evaluations,
                    best_fitness=float(generation.fitness),
                    best=faults_to_message(generation.faults),
                )
            )
        if run.estimate is not None:
            result.estimate = estimate_to_message(run.estimate, segment.number, segment.description)
            result.success, result.message = run.estimate.valid, run.estimate.reason

    def _search_for(self, request: IdentifyFaults.Goal) -> SearchSettings:
        default = self._settings.search.value
        return replace(
            default,
            seed=request.seed,
            algorithm=request.algorithm or default.algorithm,
            budget=request.budget or default.budget,
        )

    def _window(self, unit: ActuatorStatus, goal: Any) -> Segment | None:
        """Return the window of a goal; None if the goal is cancelled before the window ends."""
        if not goal.request.next_window:
            return self._latest(unit)
        timeout_s = self._timeout_s(unit)
        with self._worker.of(unit.actuator_id).next_windows() as windows:
            segment = self._next(windows, time.monotonic() + timeout_s, goal)
        if segment is None and not goal.is_cancel_requested:
            raise ValueError(f"no window within {timeout_s:g} s")
        return segment

    def _latest(self, unit: ActuatorStatus) -> Segment:
        latest = self._worker.of(unit.actuator_id).latest
        if latest is None:
            raise ValueError(f"actuator {unit.actuator_id!r} has no complete window so far")
        return latest
