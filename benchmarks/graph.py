# SPDX-License-Identifier: Apache-2.0
"""A graph of nodes as processes in a separate ROS domain, and a node that subscribes to them."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Final, Self

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor

from ema_cli.processes.bringup import assignments_of, program, ros_arguments
from ema_core.domains import Domain

Process = subprocess.Popen[bytes]

_PATIENCE_S: Final = 180.0
_LAST_S: Final = 10.0


class Graph(AbstractContextManager["Graph", None]):
    """A context that starts processes, subscribes to topics, and ends its processes on exit.

    ``statuses`` has the latest values of each status of ``/diagnostics`` by its name. The key
    ``message`` has the message of the status.
    """

    def __enter__(self) -> Self:
        self._domain = Domain()
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        os.environ["ROS_DOMAIN_ID"] = str(self._domain.number)
        rclpy.init()
        self._node = rclpy.create_node("benchmark", namespace="/benchmark")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._processes: list[Process] = []
        self.statuses: dict[str, dict[str, str]] = {}
        self.listen(DiagnosticArray, "/diagnostics", self._note_status, 1000)
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.send_signal(signal.SIGINT)
        for process in self._processes:
            try:
                process.wait(_LAST_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown()
        self._domain.close()

    def run(self, command: Sequence[str | Path]) -> Process:
        """Start a command as a process, which ends when the context is left."""
        self._processes.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
        return self._processes[-1]

    def start(self, node: str, files: Sequence[Path] = (), **parameters: Any) -> Process:
        """Start a node with its default parameter file, further files and parameters."""
        arguments = ros_arguments(
            node, parameter_files=files, assignments=assignments_of(parameters)
        )
        return self.run([program(node), *arguments])

    def listen(
        self, message_class: type, topic: str, note: Callable[[Any], None], qos: Any
    ) -> None:
        """Subscribe to a topic: ``note`` is called with each message."""
        self._node.create_subscription(message_class, topic, note, qos)

    def wait(self, is_over: Callable[[], bool], what: str = "") -> None:
        """Process callbacks until a condition holds.

        Raises
        ------
        RuntimeError
            If ``what`` is given and the condition does not hold within ``_PATIENCE_S``.
        """
        end_s = time.monotonic() + _PATIENCE_S
        while not is_over():
            self._executor.spin_once(timeout_sec=0.05)
            if what and time.monotonic() > end_s:
                raise RuntimeError(f"not within {_PATIENCE_S:g} s: {what}")

    def wait_for_status(self, name: str, is_reached: Callable[[dict[str, str]], bool]) -> None:
        """Wait until the values of a status satisfy a condition; earlier messages do not count."""
        self.statuses.clear()
        self.wait(lambda: name in self.statuses and is_reached(self.statuses[name]), name)

    def _note_status(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self.statuses[status.name] = {"message": status.message, **values}
