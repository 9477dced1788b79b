"""The prognosis of each unit that is monitored: settings, histories, usage and service."""

import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

from rclpy.node import Node

from ema_core.description import ActuatorDescription, UnitKey
from ema_core.levels import OK, WARN
from ema_core.parameters import ActuatorParameters
from ema_core.wording import counted
from ema_interfaces.msg import ScenarioLife
from ema_interfaces.srv import GetHistory, PredictRemainingLife
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.health import HealthLimits
from ema_monitor.identification.estimate import SKIPPED, Estimate
from ema_monitor.node.actuators import Actuators
from ema_monitor.node.messages import health_to_message, history_to_message, message_of
from ema_monitor.node.recordable import Recordable
from ema_monitor.node.scenario_messages import scenarios_from_messages
from ema_monitor.node.settings import folder_of
from ema_monitor.node.summary import unknown_health
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.duty.meter import DutyLog
from ema_monitor.prognosis.fleet import Fleet
from ema_monitor.prognosis.forecaster import Forecaster
from ema_monitor.prognosis.growth.settings import KnownLawTexts, TrackerSettings
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import FAULT, HISTORY, RESTART, Count, UnusedCycle
from ema_monitor.prognosis.outlook import Claim, Outlook, outlook_of_one, unknown_outlook
from ema_monitor.prognosis.requirements.requirements import RequirementLimits, requirements_of
from ema_monitor.prognosis.service import CountLog, Service
from ema_monitor.prognosis.settings import PrognosisSettings, duty_of
from ema_monitor.reports import scenario_report
from ema_monitor.unit import Unit
from ema_monitor.windows.finder import Segment
from ema_ros.executor import WaitingCallbackGroup
from ema_ros.settings import LiveSettings
from ema_ros.stamps import stamp_from_message
from ema_ros.status import Task, hardware_name

_MOST_TESTS: Final = 5000
_USUAL_TESTS: Final = 1000


class MonitorHistories:
    """The histories of units, each opened at its first use; any thread may call.

    Parameters
    ----------
    author
        Full name of the node.

    Attributes
    ----------
    counts
        Counts of service life, whether or not the history of the unit is open.
    is_serving
        Whether histories are opened.
    """

    def __init__(self, author: str = "") -> None:
        self._author = author
        self._lock = threading.Lock()
        # A lock for each unit: reading a long history must not delay the others.
        self._opening: dict[UnitKey, threading.Lock] = {}
        self._units: dict[UnitKey, Unit] = {}
        self._folder: Path | None = None
        self.counts = CountLog()
        self.is_serving = False

    def begin(self, folder: Path | None) -> None:
        """Open histories in a folder from now on; in memory alone when it is None."""
        self._folder = folder
        self.is_serving = True

    def end(self) -> None:
        """Close the histories, and open no more."""
        with self._lock:
            self.is_serving = False
            opening = list(self._opening.values())
        for lock in opening:
            # A history that is being opened comes first.
            with lock:
                pass
        for _, prognostics in self.items():
            prognostics.history.close()
        self._opening.clear()
        self._units.clear()
        self.counts = CountLog()

    def forget(self, actuator_id: str) -> None:
        """Close the histories of an actuator; they are opened again when they are needed."""
        for unit, prognostics in self.items():
            if unit[0] == actuator_id:
                self._units.pop(unit, None)
                prognostics.history.close()

    def items(self) -> list[tuple[UnitKey, Unit]]:
        """Return the units with open histories."""
        return list(self._units.items())

    def of(self, unit: UnitKey, settings: PrognosisSettings) -> Unit:
        """Return the history of a unit and what follows from it.

        Parameters
        ----------
        unit
            The unit.
        settings
            Settings of the prognosis at first.

        Raises
        ------
        ValueError
            When no histories are opened.
        """
        with self._lock:
            self._require_serving()
            opening = self._opening.setdefault(unit, threading.Lock())
        with opening:
            if unit not in self._units:
                # They may have ended while another thread opened this one.
                self._require_serving()
                path = history_path(self._folder, *unit) if self._folder else None
                history = History(*unit, path)
                self._units[unit] = Unit(history, settings, time.time_ns(), self._author)
            return self._units[unit]

    def _require_serving(self) -> None:
        if not self.is_serving:
            raise ValueError("the monitor is not configured")


class MonitorPrognosis:
    """Health and remaining life of each unit from its history.

    Parameters
    ----------
    node
        Gets parameters and service.
    calibration_of
        Gives the calibration of an actuator, or why there is none.
    units
        The actuators.
    resume
        Called with a unit, once its history is read, and its outlook.
    duties
        Duty that telemetry tells.
    good_for_s
        Gives how long a level holds after its test [s].
    """

    def __init__(
        self,
        node: Node,
        calibration_of: Callable[[ActuatorDescription], AnyCalibration | str],
        units: Actuators,
        resume: Callable[[ActuatorDescription, Outlook], None],
        duties: DutyLog,
        good_for_s: Callable[[], float],
    ) -> None:
        self._node = node
        self._author = node.get_fully_qualified_name()
        self._good_for_s = good_for_s
        self._calibration_of = calibration_of
        self._units = units
        self._resume = resume
        self._duties = duties
        self._limits = LiveSettings(node, HealthLimits, "limits.")
        self._requirements = LiveSettings(node, RequirementLimits, "requirements.")
        self._tracker = LiveSettings(node, TrackerSettings, "tracker.")
        self._laws = LiveSettings(node, KnownLawTexts, "known_law.")
        self._service = LiveSettings(node, Service)
        self._damage = LiveSettings(node, DamageSettings, "damage.")
        self._recordable = Recordable(node)
        self._fleet: Fleet | None = None
        self._histories = MonitorHistories(self._author)
        self._to_refresh: SimpleQueue[ActuatorDescription] = SimpleQueue()
        self._logged: dict[UnitKey, str] = {}
        self._resuming = threading.Lock()

    @property
    def settings(self) -> PrognosisSettings:
        """The settings of prognoses as they are now."""
        return PrognosisSettings(
            self._limits.value,
            self._requirements.value,
            replace(self._tracker.value, laws=self._laws.value.laws()),
            self._service.value,
            self._fleet,
            self._damage.value,
            good_for_s=self._good_for_s(),
        )

    def begin(self, history_folder: str, fleet: Fleet | None) -> None:
        """Store histories in a folder from now on, use a fleet if there is one, and offer services.

        They are in memory alone when the folder is empty, and always in simulated time: a bag that
        is replayed must not mix with tests of the actuator itself.
        """
        self._folder = folder_of(history_folder) if history_folder else None
        self._fleet = fleet
        self._histories.begin(self._recordable.begin(self._folder))
        self._refresh_soon = self._node.create_guard_condition(
            self._refresh_all, callback_group=WaitingCallbackGroup()
        )
        self._call = self._node.create_service(
            PredictRemainingLife,
            "~/predict_remaining_life",
            self._predict,
            callback_group=WaitingCallbackGroup(),
        )
        self._get_history = self._node.create_service(
            GetHistory, "~/get_history", self._tell_history, callback_group=WaitingCallbackGroup()
        )

    def suspend(self) -> None:
        """Record nothing from now on, until ``change_clock``."""
        self._recordable.suspend()

    def change_clock(self) -> None:
        """Begin anew after a change of ``use_sim_time``: what was before is closed, or forgotten.

        What follows from tests of one clock must not mix with those of the other.
        """
        with self._resuming:
            self._histories.end()
            self._duties.clear()
            self._histories.begin(self._recordable.change_clock(self._folder))
        self._logged.clear()

    def end(self) -> None:
        """End the services, and close the histories."""
        # A health that is being published comes first.
        with self._resuming:
            self._histories.end()
            self._duties.clear()
        self._node.destroy_service(self._call)
        self._node.destroy_service(self._get_history)
        self._node.destroy_guard_condition(self._refresh_soon)
        self._logged.clear()
        self._to_refresh = SimpleQueue()

    def forget(self, actuator_id: str) -> None:
        """Forget an actuator in this run; what is on disk stays."""
        with self._resuming:
            self._histories.forget(actuator_id)

    def describe(self, description: ActuatorDescription) -> None:
        """Prepare for a unit that has just been described, as ``refresh`` does."""
        self._histories.counts.assign(description.unit_key)
        self.refresh(description)

    def refresh(self, description: ActuatorDescription) -> None:
        """Have requirements made, the history opened and health published, in another thread."""
        self._to_refresh.put(description)
        self._refresh_soon.trigger()

    def receive_usage(self, message: Any) -> None:
        """Record counted use from ``ema_interfaces/msg/Usage``, which may be impossible."""
        actuator_id = message.actuator_id
        if not actuator_id:
            self._units.add_defect("", "usage without actuator_id")
            return
        if self._units.admission.ignores(actuator_id):
            return
        unit = self._units.get(actuator_id)
        # One that its sender did not stamp was read just now.
        now_ns = self._node.get_clock().now().nanoseconds
        stamp_ns = stamp_from_message(message.header.stamp) or now_ns
        try:
            count = Count(stamp_ns, message.flight_hours, message.cycles)
        except ValueError as error:
            # A count alone does not make an actuator known.
            reason = f"usage is impossible: {error}"
            self._units.add_defect(actuator_id, reason, is_known=unit is not None)
            return
        described = unit.description if unit else None
        serial_number = message.serial_number or (described.serial_number if described else "")
        self._histories.counts.add((actuator_id, serial_number), count)

    def latest(self, description: ActuatorDescription) -> Estimate | None:
        """Return the latest valid estimate in the history of a unit; None when there is none."""
        try:
            entries = self._of(description).history.entries
        except Exception as error:
            # The search does not depend on it.
            self.report_failure(description.actuator_id, error)
            return None
        return entries[-1].estimate if entries else None

    def record(
        self, segment: Segment, estimate: Estimate, settings: PrognosisSettings
    ) -> Outlook | None:
        """Record a test; return health and life after it, None when nothing follows from it.

        Of a test that may not enter the history its health alone is returned, with the reason, as
        long as the history has none.
        """
        description = segment.description
        now_ns = self._node.get_clock().now().nanoseconds
        try:
            prognostics = self._of(description)
            # Also of a test that may not enter: what was flown then is not of the next one.
            flown = self._duties.take(description.unit_key, estimate.end_ns)
            refused = self._recordable.refuse(description.unit_key, estimate.end_ns)
            if refused:
                # Its order among those of the history is not known: it leads none of them.
                if prognostics.history.newest is not None:
                    return None
                return self._outlook_of_one(estimate, settings, refused, now_ns)
            count = self._histories.counts.latest(description.unit_key, estimate.end_ns)
            parameters = self._parameters(description)
            outlook = prognostics.update(estimate, parameters, settings, count, flown, now_ns)
        except Exception as error:
            # A failure here must prevent neither the estimate nor the alarm.
            reason = self.report_failure(description.actuator_id, error)
            return self._outlook_of_one(estimate, settings, reason, now_ns)
        self._log_problem(description, prognostics)
        for event in outlook.events if outlook else ():
            # Changes of level have a line of their own, and so have a restart and the history.
            if event.kind not in (FAULT, RESTART, HISTORY):
                self._node.get_logger().warning(f"{description.actuator_id}: {event}")
        return outlook

    def _outlook_of_one(
        self, estimate: Estimate, settings: PrognosisSettings, reason: str, now_ns: int
    ) -> Outlook | None:
        claim = Claim(estimate.end_ns, now_ns, self._author, settings.good_for_s)
        if estimate.valid:
            return replace(outlook_of_one(estimate, settings.limits, reason), claim=claim)
        if estimate.verdict == SKIPPED:
            return None
        refused = UnusedCycle(estimate.end_ns, estimate.verdict, estimate.reason)
        return replace(unknown_outlook(reason).after_refusal(refused), claim=claim)

    def forecaster(self, description: ActuatorDescription, outlook: Outlook) -> Forecaster | None:
        """Return what forecasts a unit from its latest outlook on; None when that is impossible."""
        try:
            if self._recordable.refusal(description.unit_key):
                return None
            return self._of(description).forecaster(outlook)
        except Exception as error:
            self.report_failure(description.actuator_id, error, "the forecast")
            return None

    def tasks(self, only: str = "") -> list[Task]:
        """Return the status of each history, or of those of one actuator alone."""
        tasks = []
        for unit, prognostics in self._histories.items():
            if only not in ("", unit[0]):
                continue
            history = prognostics.history
            wrong = list(filter(None, [self._recordable.refusal(unit), history.problem]))
            remarks = wrong or [counted(len(history.entries), "test")]
            tasks.append(
                Task(
                    f"{unit[0]} history",
                    WARN if wrong else OK,
                    "; ".join(filter(None, [*remarks, self._recordable.note])),
                    hardware_name(self._node.get_namespace(), *unit),
                    {"file": history.path or "none, in memory only"},
                )
            )
        return tasks

    def _refresh_all(self) -> None:
        """Make the requirements of units, read their histories, and publish their health."""
        while True:
            try:
                description = self._to_refresh.get_nowait()
            except Empty:
                return
            try:
                parameters = self._parameters(description)
                if parameters is not None:
                    requirements_of(parameters, self._requirements.value)
                with self._resuming:
                    if not self._histories.is_serving:
                        return
                    outlook = self._of(description).resume(parameters, self.settings)
                    if outlook is not None:
                        self._resume(description, outlook)
            except Exception as error:
                self.report_failure(description.actuator_id, error)

    def _of(self, description: ActuatorDescription) -> Unit:
        prognostics = self._histories.of(description.unit_key, self.settings)
        self._log_problem(description, prognostics)
        return prognostics

    def _parameters(self, description: ActuatorDescription) -> ActuatorParameters | None:
        calibration = self._calibration_of(description)
        return None if isinstance(calibration, str) else calibration.unit_parameters

    def _log_problem(self, description: ActuatorDescription, prognostics: Unit) -> None:
        problem, unit = prognostics.history.problem, description.unit_key
        if problem and self._logged.get(unit) != problem:
            self._node.get_logger().error(f"{description.actuator_id}: {problem}")
        self._logged[unit] = problem

    def _predict(
        self, request: PredictRemainingLife.Request, response: PredictRemainingLife.Response
    ) -> PredictRemainingLife.Response:
        try:
            _, description = self._units.find(request.actuator_id)
            settings = duty_of(self.settings, request.duty)
            scenarios = scenarios_from_messages(list(request.scenarios))
            prognostics, parameters = self._of(description), self._parameters(description)
            now_ns = self._node.get_clock().now().nanoseconds
            outlook = prognostics.outlook(parameters, settings).at(now_ns)
            response.health = health_to_message(outlook, description)
            response.scenarios = [
                message_of(
                    ScenarioLife,
                    scenario_report(one, prognostics.under(one, parameters, settings)),
                )
                for one in scenarios
            ]
            response.success = True
            return response
        except ValueError as error:
            response.message = str(error)
        except Exception as error:
            # A service that raises would end the node.
            response.message = self.report_failure(request.actuator_id, error)
        response.health = unknown_health(request.actuator_id, response.message)
        return response

    def _tell_history(
        self, request: GetHistory.Request, response: GetHistory.Response
    ) -> GetHistory.Response:
        try:
            if request.most > _MOST_TESTS:
                raise ValueError(f"most = {request.most}: expected at most {_MOST_TESTS} tests")
            _, description = self._units.find(request.actuator_id)
            found = self._of(description).latest_tests(request.most or _USUAL_TESTS)
            response.history = history_to_message(*found, description)
            response.success = True
        except ValueError as error:
            response.message = str(error)
        except Exception as error:
            # A service that raises would end the node.
            response.message = self.report_failure(request.actuator_id, error, "the history")
        return response

    def write_assessment(self, description: ActuatorDescription) -> None:
        """Keep in the history of a unit what was found after its latest test."""
        prognostics = self._of(description)
        prognostics.write()
        self._log_problem(description, prognostics)

    def report_failure(
        self, actuator_id: str, error: Exception, what: str = "the prognosis"
    ) -> str:
        """Log that something has just failed, and return the reason.

        The ``actuator_id`` is empty when it is not known.
        """
        reason = f"{what} failed: {error!r}"
        self._node.get_logger().error(
            f"{actuator_id or 'actuator'}: {reason}\n{traceback.format_exc()}"
        )
        return reason
