# SPDX-License-Identifier: Apache-2.0
"""Services for a unit's remaining life, history and notes."""

import time
from dataclasses import replace
from typing import Final

from ema_core.wording import one_line
from ema_interfaces.msg import ScenarioLife
from ema_interfaces.srv import GetHistory, NoteEvent, PredictRemainingLife
from ema_monitor.node.publish.actuators import Actuators
from ema_monitor.node.publish.log import Log
from ema_monitor.node.publish.messages import (
    health_to_message,
    history_to_message,
    message_of,
    scenarios_from_messages,
    unknown_health,
)
from ema_monitor.node.work.histories import PROGNOSIS, Histories
from ema_monitor.node.work.prognosis import UnitPrognoses
from ema_monitor.reports import scenario_report
from ema_ros.executor import WaitingCallbackGroup
from ema_ros.managed_node import ManagedNode
from ema_ros.stamps import stamp_from_message

_MOST_TESTS: Final = 5000
_USUAL_TESTS: Final = 1000


class PrognosisCalls:
    """The services ``~/predict_remaining_life``, ``~/get_history`` and ``~/note_event``."""

    def __init__(
        self,
        node: ManagedNode,
        histories: Histories,
        prognosis: UnitPrognoses,
        actuators: Actuators,
        log: Log,
    ) -> None:
        self._histories = histories
        self._prognosis = prognosis
        self._actuators = actuators
        self._log = log
        for kind, name, callback in (
            (PredictRemainingLife, "predict_remaining_life", self._predict),
            (GetHistory, "get_history", self._report_history),
            (NoteEvent, "note_event", self._keep_note),
        ):
            group = WaitingCallbackGroup()
            node.create_service(kind, f"~/{name}", callback, callback_group=group)

    def _predict(
        self, request: PredictRemainingLife.Request, response: PredictRemainingLife.Response
    ) -> PredictRemainingLife.Response:
        try:
            _, description = self._actuators.find(request.actuator_id)
            settings = self._histories.settings()
            service = replace(settings.service, duty=request.duty)
            settings = replace(settings, service=service)
            scenarios = scenarios_from_messages(list(request.scenarios))
            unit = self._histories.of(description)
            parameters = self._prognosis.parameters(description)
            outlook = self._actuators.worth(description, unit.outlook(parameters, settings))
            response.health = health_to_message(outlook, description)
            response.scenarios = [
                message_of(
                    ScenarioLife,
                    scenario_report(scenario, unit.under(scenario, parameters, settings)),
                )
                for scenario in scenarios
            ]
            response.success = True
        except ValueError as error:
            response.message = str(error)
        except Exception as error:
            response.message = self._log.failed(request.actuator_id, PROGNOSIS, error)
        if not response.success:
            response.health = unknown_health(request.actuator_id, response.message)
        return response

    def _report_history(
        self, request: GetHistory.Request, response: GetHistory.Response
    ) -> GetHistory.Response:
        if request.most > _MOST_TESTS:
            raise ValueError(f"most = {request.most}: expected at most {_MOST_TESTS} tests")
        _, description = self._actuators.find(request.actuator_id)
        unit = self._histories.of(description)
        tests, omitted = unit.latest_tests(request.most or _USUAL_TESTS)
        response.history = history_to_message(tests, omitted, description)
        response.success = True
        return response

    def _keep_note(
        self, request: NoteEvent.Request, response: NoteEvent.Response
    ) -> NoteEvent.Response:
        person, text = one_line("person", request.person, 60), one_line("text", request.text, 500)
        _, description = self._actuators.find(request.actuator_id)
        unit = self._histories.of(description)
        unit.note(person, text, stamp_from_message(request.stamp), time.time_ns())
        parameters = self._prognosis.parameters(description)
        outlook = unit.resume(parameters, self._histories.settings())
        assert outlook is not None
        self._actuators.add_events(description.actuator_id, outlook.events)
        response.success, response.message = True, unit.history.problem
        return response
