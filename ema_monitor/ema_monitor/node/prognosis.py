"""The prognosis of each unit that is monitored: settings, histories, usage and service."""

import threading
import time
from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ema_core.description import ActuatorDescription, UnitKey
from ema_core.levels import OK, WARN
from ema_core.parameters import ActuatorParameters
from ema_core.wording import counted, one_line
from ema_interfaces.msg import ScenarioLife
from ema_interfaces.srv import GetHistory, NoteEvent, PredictRemainingLife
from ema_monitor.health import HealthLimits
from ema_monitor.identification.estimate import SKIPPED, Estimate
from ema_monitor.node.messages import (
    health_to_message,
    history_to_message,
    message_of,
    scenarios_from_messages,
    unknown_health,
)
from ema_monitor.node.settings import IN_MEMORY, folder_of
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.fleet import Fleet
from ema_monitor.prognosis.forecaster import Forecaster
from ema_monitor.prognosis.growth.settings import KnownLawTexts, TrackerSettings
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import (
    DEPARTURE,
    FAULT,
    HISTORY,
    RESTART,
    UnitEvent,
    UnusedCycle,
)
from ema_monitor.prognosis.outlook import Claim, Outlook, outlook_of_one, unknown_outlook
from ema_monitor.prognosis.requirements.requirements import RequirementLimits, requirements_of
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.reports import scenario_report
from ema_monitor.unit import Unit
from ema_ros.executor import WaitingCallbackGroup
from ema_ros.settings import LiveSettings
from ema_ros.stamps import stamp_from_message
from ema_ros.status import Task, hardware_name

if TYPE_CHECKING:
    from ema_monitor.node.monitor_node import MonitorNode

_MOST_TESTS: Final = 5000
_USUAL_TESTS: Final = 1000
_DAY_S: Final = 86_400.0
_WHAT: Final = "the prognosis"


class MonitorPrognosis:
    """Health and remaining life of each unit from its history; any thread may call.

    A history is opened at its first use. Those of a monitor in simulated time are in memory alone:
    a bag that is replayed must not mix with tests of the actuator itself.

    Attributes
    ----------
    folder
        Folder of the histories; None for memory alone.
    """

    def __init__(self, node: "MonitorNode") -> None:
        self._node = node
        self._author = node.get_fully_qualified_name()
        self._limits = LiveSettings(node, HealthLimits, "limits.")
        self._requirements = LiveSettings(node, RequirementLimits, "requirements.")
        self._tracker = LiveSettings(node, TrackerSettings, "tracker.")
        self._laws = LiveSettings(node, KnownLawTexts, "known_law.")
        self._service = LiveSettings(node, Service)
        self._damage = LiveSettings(node, DamageSettings, "damage.")
        self._fleet: Fleet | None = None
        self._to_refresh: deque[ActuatorDescription] = deque()
        # Held while a history is opened, resumed or closed.
        self._lock = threading.RLock()
        self._is_serving = False
        self.folder: Path | None = None
        self._clear()

    def _clear(self) -> None:
        self._histories: dict[UnitKey, Unit] = {}
        self._logged: dict[UnitKey, str] = {}
        # Why the latest test of a unit was not recorded.
        self._refusals: dict[UnitKey, str] = {}

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
            good_for_s=self._node.operation.value.good_for_s,
            level_confirmations=self._node.operation.value.level_confirmations,
            has_clock=self._node.operation.value.has_clock,
        )

    def begin(self, history_folder: str, fleet: Fleet | None) -> None:
        """Store histories in a folder, in memory alone if it is empty; offer the services."""
        is_simulated = self._node.get_parameter("use_sim_time").value
        is_on_disk = history_folder not in ("", IN_MEMORY) and not is_simulated
        self.folder = folder_of(history_folder) if is_on_disk else None
        self._fleet = fleet
        self._is_serving = True
        self._refresh_soon = self._node.create_guard_condition(
            self._refresh_all, callback_group=WaitingCallbackGroup()
        )
        for kind, name, callback in (
            (PredictRemainingLife, "predict_remaining_life", self._predict),
            (GetHistory, "get_history", self._tell_history),
            (NoteEvent, "note_event", self._keep_note),
        ):
            group = WaitingCallbackGroup()
            self._node.create_service(kind, f"~/{name}", callback, callback_group=group)

    def end(self) -> None:
        """Close the histories, and open no more."""
        # One that is being opened, and a health that is being published, come first.
        with self._lock:
            self._is_serving = False
            for unit in self._histories.values():
                unit.history.close()
            self._clear()
        self._to_refresh = deque()

    def forget(self, actuator_id: str) -> None:
        """Forget an actuator in this run; what is on disk stays."""
        with self._lock:
            for key in [key for key in self._histories if key[0] == actuator_id]:
                self._histories.pop(key).history.close()

    def rewind(self, time_ns: int) -> None:
        """Forget tests later than a time to which simulated time has gone back [ns]."""
        for unit in list(self._histories.values()):
            unit.rewind(time_ns)

    def describe(self, description: ActuatorDescription) -> None:
        """Prepare for a unit that has just been described, or calibrated.

        In another thread, requirements are made, the history is opened and health is published.
        """
        self._to_refresh.append(description)
        self._refresh_soon.trigger()

    def estimates(self, description: ActuatorDescription) -> list[Estimate]:
        """Return the valid estimates in the history of a unit, in their order."""
        try:
            entries = self._of(description).history.entries
        except Exception as error:
            # The search does not depend on it.
            self._node.failed(description.actuator_id, _WHAT, error)
            return []
        return [entry.estimate for entry in entries]

    def record(self, description: ActuatorDescription, estimate: Estimate) -> Outlook | None:
        """Record a test; return health and life after it, None when nothing follows from it.

        Of a test that may not enter the history its health alone is returned, with the reason, as
        long as the history has none.
        """
        settings, now_ns, key = self.settings, self._node.units.now_ns(), description.unit_key
        try:
            unit = self._of(description)
            # Also of a test that may not enter: what was flown then is not of the next one.
            end_ns = estimate.end_ns if settings.has_clock else now_ns
            use = self._node.units.take_use(key, end_ns)
            self._refusals[key] = reason = self._why_not_recorded(end_ns, now_ns)
            if not reason:
                parameters = self._parameters(description)
                is_live = self._node.units.is_live(description.actuator_id, estimate.end_ns)
                outlook = unit.update(estimate, parameters, settings, *use, now_ns, is_live)
                self._log(description, unit, outlook.events if outlook else ())
                return outlook
            self._node.warn(description.actuator_id, reason)
            # Its order among those of the history is not known: no level is.
            if unit.history.newest is not None:
                known = unit.resume(self._parameters(description), settings)
                return None if estimate.verdict == SKIPPED or not known else known.stale(reason)
        except Exception as error:
            # A failure here must prevent neither the estimate nor the alarm.
            reason = self._node.failed(description.actuator_id, _WHAT, error)
        if estimate.verdict == SKIPPED:
            return None
        claim = Claim(estimate.end_ns, now_ns, self._author, settings.good_for_s)
        if estimate.valid:
            return replace(outlook_of_one(estimate, settings.limits, reason), claim=claim)
        refused = UnusedCycle.of(estimate)
        return replace(unknown_outlook(reason).after_refusal(refused), claim=claim)

    def _why_not_recorded(self, stamp_ns: int, now_ns: int) -> str:
        """Return why a test of a stamp [ns] may not enter a history; empty when it may."""
        offset_s = (stamp_ns - now_ns) * 1e-9
        limit_s = self._node.operation.value.history_max_offset_s
        if self.folder is None or abs(offset_s) <= limit_s:
            return ""
        stamp = datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC)
        return (
            f"the test of {stamp:%Y-%m-%d %H:%M:%S} UTC is not recorded: its stamp is "
            f"{_span(abs(offset_s))} {'after' if offset_s > 0.0 else 'before'} the clock of the "
            f"monitor, allowed are {_span(limit_s)}; set use_sim_time for a replay, else set the "
            "clock of the actuator, history_max_offset_s, or has_clock = false if it has none"
        )

    def forecaster(self, description: ActuatorDescription, outlook: Outlook) -> Forecaster | None:
        """Return what forecasts a unit from its latest outlook on; None when that is impossible."""
        try:
            if self._refusals.get(description.unit_key):
                return None
            return self._of(description).forecaster(outlook)
        except Exception as error:
            self._node.failed(description.actuator_id, "the forecast", error)
            return None

    def tasks(self, only: str = "") -> list[Task]:
        """Return the status of each history, or of those of one actuator alone."""
        tasks = []
        for key, unit in list(self._histories.items()):
            if only not in ("", key[0]):
                continue
            wrong = "; ".join(filter(None, [self._refusals.get(key), unit.history.problem]))
            tasks.append(
                Task(
                    f"{key[0]} history",
                    WARN if wrong else OK,
                    wrong or counted(len(unit.history.entries), "test"),
                    hardware_name(self._node.unit_namespace, *key),
                    {"file": unit.history.path or "none, in memory only"},
                )
            )
        return tasks

    def _refresh_all(self) -> None:
        """Make the requirements of units, read their histories, and publish their health."""
        waiting = self._to_refresh
        while waiting:
            description = waiting.popleft()
            try:
                parameters = self._parameters(description)
                if parameters is not None:
                    requirements_of(parameters, self._requirements.value)
                with self._lock:
                    if not self._is_serving:
                        return
                    outlook = self._of(description).resume(parameters, self.settings)
                    if outlook is not None:
                        self._node.units.resume(description, outlook)
            except Exception as error:
                self._node.failed(description.actuator_id, _WHAT, error)

    def _of(self, description: ActuatorDescription) -> Unit:
        """Return a unit with its history, which is opened if need be."""
        key = description.unit_key
        unit = self._histories.get(key)
        if unit is None:
            with self._lock:
                if not self._is_serving:
                    raise ValueError("the monitor is not configured")
                if (unit := self._histories.get(key)) is None:
                    path = history_path(self.folder, *key) if self.folder else None
                    unit = self._histories[key] = Unit(
                        History(*key, path), self.settings, time.time_ns(), self._author
                    )
        self._log(description, unit)
        return unit

    def _parameters(self, description: ActuatorDescription) -> ActuatorParameters | None:
        calibration = self._node.store.of(description)
        return None if isinstance(calibration, str) else calibration.unit_parameters

    def _log(
        self, description: ActuatorDescription, unit: Unit, events: Iterable[UnitEvent] = ()
    ) -> None:
        """Log what is wrong with a history, once, and what happened to the unit."""
        problem, key = unit.history.problem, description.unit_key
        if problem and self._logged.get(key) != problem:
            self._node.get_logger().error(f"{description.actuator_id}: {problem}")
        self._logged[key] = problem
        for event in events:
            # Changes of level have a line of their own, and so have a restart and the history.
            if event.kind not in (FAULT, DEPARTURE, RESTART, HISTORY):
                self._node.get_logger().warning(f"{description.actuator_id}: {event}")

    def _predict(
        self, request: PredictRemainingLife.Request, response: PredictRemainingLife.Response
    ) -> PredictRemainingLife.Response:
        try:
            _, description = self._node.units.find(request.actuator_id)
            settings, service = self.settings, replace(self._service.value, duty=request.duty)
            settings = replace(settings, service=service)
            scenarios = scenarios_from_messages(list(request.scenarios))
            unit, parameters = self._of(description), self._parameters(description)
            outlook = self._node.units.worth(description, unit.outlook(parameters, settings))
            response.health = health_to_message(outlook, description)
            response.scenarios = [
                message_of(
                    ScenarioLife, scenario_report(one, unit.under(one, parameters, settings))
                )
                for one in scenarios
            ]
            response.success = True
        except ValueError as error:
            response.message = str(error)
        except Exception as error:
            response.message = self._node.failed(request.actuator_id, _WHAT, error)
        if not response.success:
            response.health = unknown_health(request.actuator_id, response.message)
        return response

    def _tell_history(
        self, request: GetHistory.Request, response: GetHistory.Response
    ) -> GetHistory.Response:
        if request.most > _MOST_TESTS:
            raise ValueError(f"most = {request.most}: expected at most {_MOST_TESTS} tests")
        _, description = self._node.units.find(request.actuator_id)
        found = self._of(description).latest_tests(request.most or _USUAL_TESTS)
        response.history = history_to_message(*found, description)
        response.success = True
        return response

    def _keep_note(
        self, request: NoteEvent.Request, response: NoteEvent.Response
    ) -> NoteEvent.Response:
        person, text = one_line("person", request.person, 60), one_line("text", request.text, 500)
        _, description = self._node.units.find(request.actuator_id)
        unit, now = self._of(description), datetime.now(UTC)
        words = f"{now:%Y-%m-%d %H:%M} UTC: {text}"
        unit.note(person, words, stamp_from_message(request.stamp))
        outlook = unit.resume(self._parameters(description), self.settings)
        assert outlook is not None
        self._node.units.tell(description.actuator_id, outlook.events)
        response.success, response.message = True, unit.history.problem
        return response

    def alarm(self, description: ActuatorDescription) -> str:
        """Return why a unit is in WARN or ERROR, in words; "" if it is not."""
        return self._of(description).alarm(self._parameters(description), self.settings)

    def change_baseline(
        self, description: ActuatorDescription, person: str, calibration_id: str, *, is_forced: bool
    ) -> None:
        """Keep, and publish, that a unit has another calibration from now on."""
        unit, now = self._of(description), datetime.now(UTC)
        words = (
            f"{person or '~/calibrate'}{', forced' if is_forced else ''}, {now:%Y-%m-%d %H:%M} UTC"
        )
        if unit.change_baseline(words, calibration_id):
            outlook = unit.resume(self._parameters(description), self.settings)
            assert outlook is not None
            self._node.units.tell(description.actuator_id, outlook.events)

    def write_assessment(self, description: ActuatorDescription) -> None:
        """Keep what was found after the latest test of a unit, unless that is forgotten."""
        unit = self._histories.get(description.unit_key)
        if unit is not None:
            unit.write()
            self._log(description, unit)


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < _DAY_S else f"{seconds / _DAY_S:.1f} days"
