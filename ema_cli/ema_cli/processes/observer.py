"""A node that listens to actuator and monitor, and only listens."""

import threading
import time
from typing import Any, Final

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions

from ema_cli.bags.diagnoses import Diagnosis, DiagnosisLog
from ema_recording.message_type import type_name
from ema_ros.stamps import stamp_from_message
from ema_ros.topics import (
    ACTUATOR_TOPICS,
    FAULT_ESTIMATE,
    HEALTH,
    MONITOR_TOPICS,
    NAMESPACE,
    SIMULATED_FAULTS,
    TELEMETRY,
)

_MARGIN_NS: Final = 100_000_000
_QOS_BY_TOPIC: Final = {
    SIMULATED_FAULTS: ACTUATOR_TOPICS[SIMULATED_FAULTS],
    **{name: MONITOR_TOPICS[name] for name in (FAULT_ESTIMATE, HEALTH)},
}


class Observer:
    """Takes in what is true and what is found, in a thread of its own; to be used under ``with``.

    Parameters
    ----------
    name
        Name of its node, in a namespace of its own.

    Attributes
    ----------
    dashboard_address
        Where the dashboard serves; empty as long as none has told.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._history = DiagnosisLog()
        self._telemetry_ns = 0
        self.dashboard_address = ""
        self._lock = threading.Lock()
        self._ending = threading.Event()

    def __enter__(self) -> "Observer":
        self._context = Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node(self._name, namespace=f"/{self._name}", context=self._context)
        for topic, (message_class, qos) in _QOS_BY_TOPIC.items():
            self._node.create_subscription(message_class, f"{NAMESPACE}/{topic}", self._take, qos)
        message_class, _ = ACTUATOR_TOPICS[TELEMETRY]
        self._node.create_subscription(
            message_class, f"{NAMESPACE}/{TELEMETRY}", self._take_telemetry, qos_profile_sensor_data
        )
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._take_status, 10)
        self._thread = threading.Thread(target=self._spin, name="observer", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def sees(self, node_name: str) -> bool:
        """Return whether a node of the health monitor is in the graph."""
        return (node_name, NAMESPACE) in self._node.get_node_names_and_namespaces()

    def diagnoses(self) -> list[Diagnosis]:
        """Return the diagnoses so far."""
        with self._lock:
            return self._history.diagnoses()

    def cycles(self) -> int:
        """Return how many test cycles have begun."""
        with self._lock:
            return len(self._history.truths)

    def cycle_between_windows(self) -> int | None:
        """Return the test cycle that goes on if its window is over, as in the cycles before.

        The telemetry tells how far it is: a busy actuator's stamps are behind the clock.
        """
        with self._lock:
            truths, diagnoses = self._history.truths, self._history.diagnoses()
        starts_ns = {item.cycle: item.stamp_ns for item in truths}
        ends_ns = [one.end_ns - starts_ns[one.cycle] for one in diagnoses if one.cycle is not None]
        if not ends_ns or self._telemetry_ns - truths[-1].stamp_ns < max(ends_ns) + _MARGIN_NS:
            return None
        return truths[-1].cycle

    def has_diagnosed(self, cycle: int) -> bool:
        """Return whether there is a diagnosis of a test cycle."""
        return any(one.cycle == cycle for one in self.diagnoses())

    def _take(self, message: Any) -> None:
        with self._lock:
            self._history.add(type_name(type(message)), message, time.time_ns())

    def _take_telemetry(self, message: Any) -> None:
        with self._lock:
            self._telemetry_ns = stamp_from_message(message.header.stamp)

    def _take_status(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "dashboard: dashboard":
                values = {item.key: item.value for item in status.values}
                self.dashboard_address = values["address"]

    def _spin(self) -> None:
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._node)
        while not self._ending.is_set():
            try:
                executor.spin_once(timeout_sec=0.1)
            except ExternalShutdownException:
                return
        executor.shutdown()
