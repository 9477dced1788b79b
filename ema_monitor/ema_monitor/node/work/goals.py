# SPDX-License-Identifier: Apache-2.0
"""Goals of the monitor's actions: admission, result, and the windows that they wait for."""

import time
import traceback
from collections.abc import Callable
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Final

from rclpy.action.server import CancelResponse, GoalResponse

from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.publish.actuators import NOT_ACTIVE, Actuators
from ema_monitor.node.publish.log import Log
from ema_monitor.node.settings import NodeSettings
from ema_monitor.windows.finder import Segment
from ema_ros import topics
from ema_ros.managed_node import ManagedNode
from ema_ros.rclpy_private import GoalServer
from ema_ros.throttle import Throttle

_POLL_S: Final = 0.1
_REJECTION_S: Final = 1.0
_PATIENCE_S: Final = 2.0


class Goals:
    """Serves the actions of the monitor. Goals run in threads that do not receive telemetry.

    Attributes
    ----------
    rejected
        Reason why the latest goal was rejected; empty if it was accepted.
    """

    def __init__(
        self, node: ManagedNode, actuators: Actuators, settings: NodeSettings, log: Log
    ) -> None:
        self._node = node
        self._actuators = actuators
        self._settings = settings
        self._log = log
        self._is_stopping: Callable[[], bool] = node.stopping.is_set
        self.rejected = ""
        self._rejections = Throttle(_REJECTION_S)
        self._servers: list[GoalServer] = []

    def serve(
        self,
        kind: Any,
        name: str,
        check: Callable[[Any], None],
        execute: Callable[[Any, Any], None],
    ) -> None:
        """Serve an action, whose goals can be cancelled.

        Parameters
        ----------
        kind, name
            Type and name of the action.
        check
            Called with the request of a goal; a ValueError rejects the goal.
        execute
            Called with an accepted goal and its result, to complete the result. The goal is
            aborted with the message of an exception.
        """
        server = GoalServer(
            self._node,
            kind,
            f"~/{name}",
            partial(self._run, kind, name, execute),
            goal_callback=partial(self._accept_or_reject, name, check),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            goal_service_qos_profile=topics.SERVICE,
            result_service_qos_profile=topics.SERVICE,
            cancel_service_qos_profile=topics.SERVICE,
        )
        self._servers.append(server)

    def finish(self) -> None:
        """Wait until the results of all goals are sent; at most 2 s for a goal that computes.

        An inactive monitor aborts its goals. Its actions must not be destroyed before that.
        """
        deadline_s = time.monotonic() + _PATIENCE_S
        for server in self._servers:
            server.wait(deadline_s - time.monotonic())

    def require_active(self) -> None:
        """Raise ValueError unless the monitor is active."""
        if not self._actuators.is_active or self._is_stopping():
            raise ValueError(NOT_ACTIVE)

    def timeout_s(self, unit: ActuatorStatus) -> float:
        """Return the timeout for the next window [s]; it is longer for a record."""
        timeout_s = self._settings.operation.value.calibration_timeout_s
        return timeout_s + unit.finder.longest_s if unit.finder.finds_records else timeout_s

    def next_window(
        self, windows: SimpleQueue[Segment], deadline_s: float, goal: Any = None
    ) -> Segment | None:
        """Wait for the next window; return None at the deadline or on cancellation.

        Raises
        ------
        ValueError
            If the monitor is deactivated.
        """
        while time.monotonic() < deadline_s and not (goal and goal.is_cancel_requested):
            self.require_active()
            try:
                return windows.get(timeout=_POLL_S)
            except Empty:
                continue
        return None

    def _accept_or_reject(
        self, name: str, check: Callable[[Any], None], request: Any
    ) -> GoalResponse:
        try:
            check(request)
        except ValueError as error:
            self.rejected = str(error)
            text = f"goal of {name} rejected: {error}"
            if (passed := self._rejections.passed(text, time.monotonic())) is not None:
                self._log.warning(passed)
                self._log.report()
            return GoalResponse.REJECT
        self.rejected = ""
        return GoalResponse.ACCEPT

    def _run(self, kind: Any, name: str, execute: Callable[[Any, Any], None], goal: Any) -> Any:
        result = kind.Result()
        try:
            execute(goal, result)
        except (ValueError, OSError) as error:
            result.message = str(error)
        except Exception as error:
            result.message = f"failed: {error!r}"
            self._log.error(f"{name} {result.message}\n{traceback.format_exc()}")
        if result.success:
            goal.succeed()
        elif goal.is_cancel_requested:
            result.message = "cancelled"
            goal.canceled()
        else:
            goal.abort()
        return result
