# SPDX-License-Identifier: Apache-2.0
"""Publication of test results: estimate, health and follow-ups."""

from collections import deque

from ema_core.description import ActuatorDescription
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.node.publish.actuators import Actuators
from ema_monitor.node.publish.log import Log
from ema_monitor.node.publish.outputs import Outputs
from ema_monitor.node.work.baselines import Baselines
from ema_monitor.node.work.follow_ups import FollowUps
from ema_monitor.node.work.histories import PROGNOSIS, Histories
from ema_monitor.node.work.prognosis import UnitPrognoses
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.requirements.requirements import requirements_of
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window
from ema_ros.executor import WaitingCallbackGroup
from ema_ros.managed_node import ManagedNode


class Results:
    """Publishes estimates and health, in the order of the tests."""

    def __init__(
        self,
        node: ManagedNode,
        histories: Histories,
        prognosis: UnitPrognoses,
        follow_ups: FollowUps,
        actuators: Actuators,
        outputs: Outputs,
        baselines: Baselines,
        log: Log,
    ) -> None:
        self._histories = histories
        self._prognosis = prognosis
        self._follow_ups = follow_ups
        self._actuators = actuators
        self._outputs = outputs
        self._baselines = baselines
        self._log = log
        self._to_resume: deque[ActuatorDescription] = deque()
        self._resume_soon = node.create_guard_condition(
            self._resume_all, callback_group=WaitingCallbackGroup()
        )

    def publish(self, diagnosed: Diagnosed, window: Window | Refusal | None = None) -> None:
        """Publish an estimate and its results; ``window`` is None for combined stretches."""
        description, estimate = diagnosed.description, diagnosed.estimate
        actuator_id, change = description.actuator_id, ""
        self._outputs.publish_estimate(diagnosed)
        self._actuators.now()  # handle a step of the clock before the test
        # Without the lock: telemetry must not wait for a prognosis.
        outlook = self._prognosis.record(description, estimate)
        try:
            with self._actuators.lock:
                if status := self._actuators.get(actuator_id):
                    outlook = self._actuators.claimed(status, outlook) if outlook else None
                    change = status.record(diagnosed, outlook, self._actuators.now())
        except Exception as error:
            # The estimate is published: the window must not be refused in addition.
            reason = self._log.failed(actuator_id, "publishing health", error)
            self._actuators.add_defect(actuator_id, reason)
        self._follow(description, outlook if estimate.valid else None, change)
        if isinstance(window, Window):
            self._follow_ups.follow_estimate(diagnosed, window)
        if not (estimate.valid or estimate.is_learning):
            reason = f"window {diagnosed.number} has no valid estimate: {estimate.reason}"
            self._log.warn(actuator_id, reason)
        # Publishing the status of every actuator could take longer than an identification.
        self._log.report_on(actuator_id)

    def prepare(self, description: ActuatorDescription) -> None:
        """Prepare a unit that has just been described or calibrated.

        A background thread computes the requirements, opens the history and publishes the health.
        """
        self._to_resume.append(description)
        self._resume_soon.trigger()

    def forget(self, actuator_id: str) -> None:
        """Forget an actuator for this run; its files are kept."""
        self._histories.forget(actuator_id)
        self._baselines.forget(actuator_id)

    def _resume_all(self) -> None:
        """Compute requirements, read histories and publish health for all prepared units."""
        while self._to_resume:
            description = self._to_resume.popleft()
            try:
                parameters = self._prognosis.parameters(description)
                if parameters is not None:
                    requirements_of(parameters, self._histories.settings().requirements)
                with self._histories.lock:
                    if not self._histories.is_serving:
                        return
                    unit = self._histories.of(description)
                    outlook = unit.resume(parameters, self._histories.settings())
                    if outlook is not None:
                        self._resume(description, outlook)
                # Without the lock of the histories, which a change of a baseline needs.
                self._baselines.resume(description)
            except Exception as error:
                self._log.failed(description.actuator_id, PROGNOSIS, error)

    def _resume(self, description: ActuatorDescription, outlook: Outlook) -> None:
        """Publish the outlook of a unit from its history."""
        actuators = self._actuators
        with actuators.lock:
            status = actuators.get(description.actuator_id)
            if status is None or not actuators.is_active:
                return
            outlook = actuators.claimed(status, outlook)
            change = status.health.resume(description, outlook, actuators.now())
        self._follow(description, None if change is None else outlook, change)
        self._log.report_on(description.actuator_id)

    def _follow(
        self, description: ActuatorDescription, outlook: Outlook | None, change: str | None
    ) -> None:
        """Log a level change, and queue the follow-ups of an outlook."""
        if change:
            self._log.info(f"{description.actuator_id}: {change}")
        # After the health: the forecaster may wait for a prognosis in another thread.
        if outlook and (forecaster := self._prognosis.forecaster(description, outlook)):
            self._follow_ups.follow_health(description, forecaster)
