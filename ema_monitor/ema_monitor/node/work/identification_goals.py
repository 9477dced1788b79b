# SPDX-License-Identifier: Apache-2.0
"""Identification of a window with a chosen algorithm, by action."""

import threading
import time
from dataclasses import replace
from typing import Any, Final

from ema_interfaces.action import IdentifyFaults
from ema_monitor.calibrations import CalibrationStore
from ema_monitor.diagnosis import Identification
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.publish.actuators import Actuators
from ema_monitor.node.publish.messages import estimate_to_message, unknown_estimate
from ema_monitor.node.settings import NodeSettings
from ema_monitor.node.work.goals import Goals
from ema_monitor.node.work.worker import IdentificationWorker
from ema_monitor.windows.finder import Segment
from ema_ros.messages import faults_to_message

_MOST_GOALS: Final = 2


class IdentificationGoals:
    """The action ``~/identify_faults``."""

    def __init__(
        self,
        goals: Goals,
        worker: IdentificationWorker,
        actuators: Actuators,
        settings: NodeSettings,
        store: CalibrationStore,
    ) -> None:
        self._goals = goals
        self._worker = worker
        self._actuators = actuators
        self._settings = settings
        self._store = store
        self._free_goals = threading.Semaphore(_MOST_GOALS)
        goals.serve(IdentifyFaults, "identify_faults", self._check, self._execute)

    def _check(self, request: IdentifyFaults.Goal) -> None:
        """Refuse invalid goals, and goals beyond the limit of concurrent goals."""
        self._goals.require_active()
        unit, _ = self._actuators.find(request.actuator_id)
        self._search_for(request)
        if not request.next_window:
            self._latest(unit)
        if not self._free_goals.acquire(blocking=False):
            raise ValueError(f"{_MOST_GOALS} goals are already running")

    def _execute(self, goal: Any, result: IdentifyFaults.Result) -> None:
        try:
            self._identify(goal, result)
        except Exception as error:
            result.estimate = unknown_estimate(goal.request.actuator_id, str(error))
            raise
        finally:
            self._free_goals.release()
        if not result.estimate.algorithm:
            result.estimate = unknown_estimate(goal.request.actuator_id, "cancelled")

    def _identify(self, goal: Any, result: IdentifyFaults.Result) -> None:
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
            self._goals.require_active()
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
        timeout_s = self._goals.timeout_s(unit)
        with self._worker.of(unit.actuator_id).next_windows() as windows:
            segment = self._goals.next_window(windows, time.monotonic() + timeout_s, goal)
        if segment is None and not goal.is_cancel_requested:
            raise ValueError(f"no window within {timeout_s:g} s")
        return segment

    def _latest(self, unit: ActuatorStatus) -> Segment:
        latest = self._worker.of(unit.actuator_id).latest
        if latest is None:
            raise ValueError(f"actuator {unit.actuator_id!r} has no complete window so far")
        return latest
