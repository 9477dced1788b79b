# SPDX-License-Identifier: Apache-2.0
"""Collection of the diagnoses and true faults of a demo."""

import threading
import time
from collections.abc import Mapping
from typing import Any, Final

from rclpy.qos import qos_profile_sensor_data

from ema_bags.message_type import type_name
from ema_cli.bags.diagnoses import DiagnosedWindow, DiagnosisLog
from ema_cli.processes.listener import Listener
from ema_core.faults import healthy_faults
from ema_interfaces.msg import FaultGrowth, NodeStatus
from ema_interfaces.srv import SetSimulatedFaults
from ema_ros.messages import faults_to_message
from ema_ros.stamps import stamp_from_message
from ema_ros.topics import (
    ACTUATOR_TOPICS,
    FAULT_ESTIMATE,
    HEALTH,
    MONITOR_TOPICS,
    NAMESPACE,
    NODE_STATUS,
    NODE_TOPICS,
    SIMULATED_FAULTS,
    TELEMETRY,
)

_MARGIN_NS: Final = 100_000_000
_TELEMETRY: Final = f"{NAMESPACE}/{TELEMETRY}"
_STATUS: Final = f"{NAMESPACE}/{NODE_STATUS}"
_SET_FAULTS: Final = f"{NAMESPACE}/actuator/set_faults"
_TOPICS: Final = {
    f"{NAMESPACE}/{SIMULATED_FAULTS}": ACTUATOR_TOPICS[SIMULATED_FAULTS],
    **{f"{NAMESPACE}/{name}": MONITOR_TOPICS[name] for name in (FAULT_ESTIMATE, HEALTH)},
    _TELEMETRY: (ACTUATOR_TOPICS[TELEMETRY][0], qos_profile_sensor_data),
    _STATUS: NODE_TOPICS[NODE_STATUS],
}


class Observer(Listener):
    """Collects true faults and diagnoses in a separate thread; a context manager.

    Attributes
    ----------
    dashboard_address
        Address of the dashboard; empty until it is published.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name, _TOPICS, self._note)
        self._history = DiagnosisLog()
        self._telemetry_ns = 0
        self.dashboard_address = ""
        self._lock = threading.Lock()

    def diagnoses(self) -> list[DiagnosedWindow]:
        """Return the diagnoses so far."""
        with self._lock:
            return self._history.diagnoses()

    def cycles(self) -> int:
        """Return the number of started test cycles."""
        with self._lock:
            return len(self._history.truths)

    def cycle_between_windows(self) -> int | None:
        """Return the current test cycle if its window is over, else None.

        The end of the window is known from earlier cycles. Progress is measured with the timestamps
        of the telemetry, which lag behind the clock if the actuator is busy.
        """
        with self._lock:
            truths, diagnoses = self._history.truths, self._history.diagnoses()
        starts_ns = {item.cycle: item.stamp_ns for item in truths}
        ends_ns = [
            window.end_ns - starts_ns[window.cycle]
            for window in diagnoses
            if window.cycle is not None
        ]
        if not ends_ns or self._telemetry_ns - truths[-1].stamp_ns < max(ends_ns) + _MARGIN_NS:
            return None
        return truths[-1].cycle

    def has_diagnosed(self, cycle: int) -> bool:
        """Return whether a test cycle has been diagnosed."""
        return any(window.cycle == cycle for window in self.diagnoses())

    def begin_life(self, growth: Mapping[str, Mapping[str, Any]]) -> Any:
        """Reset the actuator to healthy; wear begins again at the next test cycle.

        ``growth`` has the growth parameters, keyed by fault. Returns the future of the response.
        """
        request = SetSimulatedFaults.Request(
            faults=faults_to_message(healthy_faults()),
            growth=[FaultGrowth(fault=name, **law) for name, law in growth.items()],
        )
        return self.call(SetSimulatedFaults, _SET_FAULTS, request)

    def _note(self, topic: str, message: Any) -> None:
        with self._lock:
            if topic == _STATUS:
                if message.kind == NodeStatus.DASHBOARD:
                    self.dashboard_address = message.address
            elif topic == _TELEMETRY:
                self._telemetry_ns = stamp_from_message(message.header.stamp)
            else:
                self._history.add(type_name(type(message)), message, time.time_ns())
