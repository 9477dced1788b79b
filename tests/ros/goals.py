"""Goals of the action of a monitor."""

from collections.abc import Callable
from typing import Any

from rclpy.action.client import ActionClient

from ema_interfaces.action import IdentifyFaults

from ..waiting import wait_for
from .monitor_session import MonitorSession
from .spinning import where_it_spins


class Goal:
    """A goal that has been sent to a monitor."""

    def __init__(self, session: MonitorSession, **goal: Any) -> None:
        self.feedback: list[IdentifyFaults.Feedback] = []
        self._session = session
        self._client = ActionClient(session.probe, IdentifyFaults, "/ema/monitor/identify_faults")
        wait_for(self._client.server_is_ready, "the action")
        request = IdentifyFaults.Goal(**goal)
        sent = self._ask(lambda: self._client.send_goal_async(request, self._note))
        self.handle = session.result(sent)
        session.at_end(self._client.destroy)
        self.is_accepted = self.handle.accepted
        self._result = self._ask(self.handle.get_result_async) if self.is_accepted else None

    def _ask(self, call: Callable[[], Any]) -> Any:
        return where_it_spins(self._session.probe, call)

    def _note(self, message: Any) -> None:
        self.feedback.append(message.feedback)

    def cancel(self) -> None:
        self._session.result(self._ask(self.handle.cancel_goal_async))

    def result(self) -> tuple[int, IdentifyFaults.Result]:
        answer = self._session.result(self._result)
        return answer.status, answer.result
