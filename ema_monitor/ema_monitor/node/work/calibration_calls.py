# SPDX-License-Identifier: Apache-2.0
"""Calibration by action or service, and changes of learned baselines."""

import time
from collections.abc import Iterator
from typing import Any, Final

from ema_core.description import ActuatorDescription
from ema_core.labels import label_of
from ema_core.wording import counted, one_line
from ema_interfaces import action, srv
from ema_monitor.baselines.changes import ChangeKind
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.calibrations import CalibrationStore, calibrate
from ema_monitor.model.measured import measured_ranges
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.publish.actuators import Actuators
from ema_monitor.node.publish.log import Log
from ema_monitor.node.settings import NodeSettings
from ema_monitor.node.work.baselines import Baselines
from ema_monitor.node.work.goals import Goals
from ema_monitor.node.work.prognosis import UnitPrognoses
from ema_monitor.node.work.results import Results
from ema_monitor.node.work.worker import IdentificationWorker
from ema_monitor.reasons import Reason
from ema_monitor.windows.window import Window
from ema_ros.executor import SeparateCallbackGroup
from ema_ros.managed_node import ManagedNode

_CANCELLED: Final = "cancelled"
_MOST_WINDOWS: Final = 200
_KINDS: Final = {
    srv.ChangeBaseline.Request.ACCEPT: ChangeKind.ACCEPT,
    srv.ChangeBaseline.Request.EXTEND: ChangeKind.EXTEND,
    srv.ChangeBaseline.Request.RESET: ChangeKind.RESET,
}
_Request = action.Calibrate.Goal | srv.Calibrate.Request


class CalibrationCalls:
    """The action ``~/calibrate``, its deprecated service, and the service ``~/change_baseline``.

    All may take long; they run in threads that do not receive telemetry.
    """

    def __init__(
        self,
        node: ManagedNode,
        goals: Goals,
        worker: IdentificationWorker,
        prognosis: UnitPrognoses,
        results: Results,
        actuators: Actuators,
        baselines: Baselines,
        settings: NodeSettings,
        store: CalibrationStore,
        log: Log,
    ) -> None:
        self._goals = goals
        self._worker = worker
        self._prognosis = prognosis
        self._results = results
        self._actuators = actuators
        self._baselines = baselines
        self._settings = settings
        self._store = store
        self._log = log
        goals.serve(action.Calibrate, "calibrate", self._check, self._execute)
        for kind, name, callback in (
            (srv.Calibrate, "calibrate", self._answer),
            (srv.ChangeBaseline, "change_baseline", self._change_baseline),
        ):
            group = SeparateCallbackGroup()
            node.create_service(kind, f"~/{name}", callback, callback_group=group)

    def _check(self, request: action.Calibrate.Goal) -> None:
        """Reserve the actuator of a goal; refuse unknown and reserved actuators.

        An inactive monitor receives no windows, but can load a calibration.
        """
        if not request.load:
            self._goals.require_active()
        unit, _ = self._actuators.find(request.actuator_id)
        self._reserve(unit)
        # An empty name keeps its actuator if another actuator appears.
        request.actuator_id = unit.actuator_id

    def _reserve(self, unit: ActuatorStatus) -> None:
        with self._actuators.lock:
            unit.begin_calibration()

    def _execute(self, goal: Any, result: action.Calibrate.Result) -> None:
        result.message, result.calibration_id = self._calibrate(goal.request, goal)
        result.success = True

    def _answer(
        self, request: srv.Calibrate.Request, response: srv.Calibrate.Response
    ) -> srv.Calibrate.Response:
        message, response.calibration_id = self._calibrate(request)
        response.message = f"{message}; this service is deprecated: use the action ~/calibrate"
        response.success = True
        return response

    def _calibrate(self, request: _Request, goal: Any = None) -> tuple[str, str]:
        """Calibrate on request of a service or goal; return a message and the calibration's id.

        The actuator of a goal is reserved already.
        """
        unit, description = self._actuators.find(request.actuator_id)
        try:
            if goal is None:
                self._reserve(unit)
            try:
                return self._calibrate_unit(unit, description, request, goal)
            finally:
                unit.end_calibration()
        except (ValueError, OSError) as error:
            self._log.warning(f"{description.actuator_id}: not calibrated: {error}")
            raise

    def _calibrate_unit(
        self, unit: ActuatorStatus, description: ActuatorDescription, request: _Request, goal: Any
    ) -> tuple[str, str]:
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
            self._goals.require_active()
            if not 1 <= (number := request.windows) <= _MOST_WINDOWS:
                raise ValueError(
                    f"windows = {number}: expected 1 to {_MOST_WINDOWS} healthy windows"
                )
            path = self._store.prepare(description, request.file)
            self._log.info(f"{description.actuator_id}: calibration is requested")
            windows = list(self._healthy_windows(unit, number, goal))
            if not request.force:
                self._require_no_alarm(description)
            accepted_by = person if request.force else ""
            has_clock = self._settings.operation.value.has_clock
            if not description.is_modelled and not has_clock:
                windows = [window.without_date() for window in windows]
            calibration = calibrate(windows, description, accepted_by=accepted_by)
            if goal and goal.is_cancel_requested:
                raise ValueError(_CANCELLED)
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
            text = ", ".join(map(label_of, calibration.not_learned))
            message += f"; not learned from the healthy windows: {text}"
        if isinstance(before, Reason) or before.calibration_id != calibration.calibration_id:
            outlook = self._prognosis.change_baseline(
                description,
                person,
                calibration.calibration_id,
                time.time_ns(),
                is_forced=request.force,
            )
            if outlook is not None:
                self._actuators.add_events(description.actuator_id, outlook.events)
        self._results.prepare(description)
        self._log.info(f"calibration: {message}")
        return message, calibration.calibration_id

    def _change_baseline(
        self, request: srv.ChangeBaseline.Request, response: srv.ChangeBaseline.Response
    ) -> srv.ChangeBaseline.Response:
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

    def _healthy_windows(self, unit: ActuatorStatus, number: int, goal: Any) -> Iterator[Window]:
        """Yield the next windows of an actuator, without refused windows; report each to a goal.

        Raises ValueError if a window does not arrive in time, or if the goal is cancelled.
        """
        timeout_s = self._goals.timeout_s(unit)
        work = self._worker.of(unit.actuator_id)
        with work.next_windows() as windows:
            _report(goal, 0, number)
            for received in range(number):
                deadline_s = time.monotonic() + timeout_s
                refused = ""
                while segment := self._goals.next_window(windows, deadline_s, goal):
                    if isinstance(segment.window, Window):
                        _report(goal, received + 1, number)
                        yield segment.window
                        break
                    refused = segment.window.reason
                    _report(goal, received, number, refused)
                else:
                    if goal and goal.is_cancel_requested:
                        raise ValueError(_CANCELLED)
                    latest = f"; the latest was refused: {refused}" if refused else ""
                    raise ValueError(
                        f"no healthy window within {timeout_s:g} s, after {received} of "
                        f"{number}{latest}"
                    )


def _report(goal: Any, windows: int, number: int, refused: str = "") -> None:
    if goal:
        feedback = action.Calibrate.Feedback(windows=windows, missing=number - windows)
        feedback.refused = refused
        goal.publish_feedback(feedback)
