# SPDX-License-Identifier: Apache-2.0
"""Telemetry, measured causes and usage counts of each actuator."""

import threading
import time
from typing import Any

from ema_core.description import UnitKey
from ema_monitor.intake import MOST_MEASUREMENTS, Intake, Use
from ema_monitor.model.measurements import MeasurementLog
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.receive.arrivals import Arrivals
from ema_monitor.node.settings import Operation
from ema_monitor.prognosis.duty.damage import NOTHING_FLOWN
from ema_monitor.prognosis.service import CountLog
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Defect, TriggerSettings
from ema_ros.messages import telemetry_from_message
from ema_ros.node_parameters import LiveSettings
from ema_ros.stamps import stamp_from_message


class TelemetrySource:
    """One actuator as a source of telemetry.

    Attributes
    ----------
    intake
        Finds windows in its telemetry and adds up the service life of its units.
    arrivals
        Reception times of its telemetry.
    status
        Its status, counts and published health.
    """

    def __init__(self, intake: Intake, arrivals: Arrivals, status: ActuatorStatus) -> None:
        self.intake, self.arrivals, self.status = intake, arrivals, status

    def receive(self, message: Any, steady_ns: int) -> list[Segment | Defect]:
        """Process ``ema_interfaces/msg/TelemetryBlock`` received at ``steady_ns``.

        Returns the windows that the block completes, and defects of the block. While several
        publishers send the telemetry, the status has a single warning instead of these defects.
        """
        self.status.received_ns, self.status.is_silent = steady_ns, False
        try:
            block = telemetry_from_message(message)
        except ValueError as error:
            return self.intake.reject(stamp_from_message(message.header.stamp), str(error))
        runs = self.status.runs
        runs.add(block.first_index, len(block), time.monotonic())
        self.arrivals.add(block.stamp_ns, block.stamp_at(len(block)), steady_ns)
        events = self.intake.feed(block)
        if runs.are_several:
            return [event for event in events if isinstance(event, Segment)]
        return events


class TelemetrySources(dict[str, TelemetrySource]):
    """Sources keyed by actuator. Measured causes and counts may arrive before a source exists.

    Attributes
    ----------
    measurements, counts
        Logs of measured causes and of service-life counts, shared by all actuators.
    """

    def __init__(
        self, trigger: TriggerSettings, operation: LiveSettings[Operation], lock: threading.RLock
    ) -> None:
        super().__init__()
        self.trigger = trigger
        self.measurements = MeasurementLog(MOST_MEASUREMENTS)
        self.counts = CountLog()
        self._operation = operation
        self._lock = lock

    def new_intake(self, actuator_id: str) -> Intake:
        """Return a new intake for an actuator that uses the shared logs."""
        return Intake(
            actuator_id,
            self.trigger,
            measurements=self.measurements,
            counts=self.counts,
            max_age_s=lambda: self._operation.value.measured_max_age_s,
        )

    def is_live(self, actuator_id: str, end_ns: int) -> bool:
        """Return whether the test that ends at the stamp ``end_ns`` was received live."""
        with self._lock:
            return actuator_id in self and self[actuator_id].arrivals.are_live(end_ns)

    def take_use(self, unit_key: UnitKey, end_ns: int) -> Use:
        """Return the latest count of a unit and its duty since the last call, up to a test's end.

        ``end_ns`` is the stamp of the end of the test [ns].
        """
        with self._lock:
            if (source := self.get(unit_key[0])) is None:
                return Use(self.counts.latest(unit_key, end_ns), NOTHING_FLOWN)
            return source.intake.take_use(unit_key, end_ns)
