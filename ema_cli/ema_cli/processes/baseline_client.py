# SPDX-License-Identifier: Apache-2.0
"""Requests to a running monitor about learned baselines."""

import threading
import time
from collections.abc import Callable
from typing import Any, Final

from ema_cli.processes.listener import Listener
from ema_interfaces.msg import BaselineStatus
from ema_interfaces.srv import ChangeBaseline
from ema_ros.topics import BASELINE, LATCHED_BY_MANY

_DISCOVERY_S: Final = 3.0
_QUIET_S: Final = 1.0
_ANSWER_S: Final = 120.0
_POLL_S: Final = 0.05


class BaselineClient(Listener):
    """Receives the baselines of a monitor, and changes them; a context manager.

    Parameters
    ----------
    monitor
        Full name of the monitor.
    """

    def __init__(self, monitor: str) -> None:
        self._namespace, _, self._monitor = monitor.rpartition("/")
        self._namespace = self._namespace or "/"
        self._service = f"{monitor}/change_baseline"
        self._statuses: dict[tuple[str, str], BaselineStatus] = {}
        self._received_s = 0.0
        self._lock = threading.Lock()
        topic = f"{self._namespace.rstrip('/')}/{BASELINE}"
        super().__init__("baseline", {topic: (BaselineStatus, LATCHED_BY_MANY)}, self._note)

    def finds_monitor(self) -> bool:
        """Wait for the monitor for up to 3 s and return whether it is in the ROS graph."""
        deadline_s = time.monotonic() + _DISCOVERY_S
        while time.monotonic() < deadline_s:
            if self.sees(self._monitor, self._namespace):
                return True
            time.sleep(_POLL_S)
        return False

    def statuses(self) -> list[BaselineStatus]:
        """Wait for the latched status messages and return the latest message of each unit."""
        started_s = time.monotonic()
        while time.monotonic() - max(started_s, self._received_s) < _QUIET_S:
            time.sleep(_POLL_S)
        with self._lock:
            return [status for _, status in sorted(self._statuses.items())]

    def change(self, request: ChangeBaseline.Request) -> str:
        """Change a baseline and return the result as a sentence.

        Raises
        ------
        ValueError
            If the monitor refuses the change, or does not answer.
        """
        client = self._node.create_client(ChangeBaseline, self._service)
        self._wait(client.service_is_ready)
        future = client.call_async(request)
        self._wait(future.done)
        response: Any = future.result()
        if not response.success:
            raise ValueError(response.message)
        return response.message

    def _wait(self, is_done: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + _ANSWER_S
        while not is_done():
            if time.monotonic() > deadline_s:
                raise ValueError(f"{self._service} did not respond within {_ANSWER_S:g} s")
            time.sleep(_POLL_S)

    def _note(self, _: str, status: BaselineStatus) -> None:
        with self._lock:
            self._statuses[status.actuator_id, status.serial_number] = status
            self._received_s = time.monotonic()
