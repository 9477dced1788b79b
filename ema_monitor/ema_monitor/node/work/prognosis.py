# SPDX-License-Identifier: Apache-2.0
"""Health and remaining life of each unit, computed from its history."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from typing import Final, Protocol

from ema_core.description import ActuatorDescription, UnitKey
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibrations import CalibrationStore
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.intake import Use
from ema_monitor.node.publish.log import Log
from ema_monitor.node.settings import Operation
from ema_monitor.node.work.histories import PROGNOSIS, Histories
from ema_monitor.prognosis.forecaster import Forecaster
from ema_monitor.prognosis.history_entry import UnusedCycle
from ema_monitor.prognosis.outlook import Claim, Outlook, outlook_of_one, unknown_outlook
from ema_monitor.reasons import Reason
from ema_ros.node_parameters import LiveSettings

_DAY_S: Final = 86_400.0


class Reception(Protocol):
    """Interface to the reception of telemetry and usage counts."""

    def take_use(self, unit_key: UnitKey, end_ns: int) -> Use:
        """Return the latest count of a unit and its duty since the last call, up to ``end_ns``."""
        ...

    def is_live(self, actuator_id: str, end_ns: int) -> bool:
        """Return whether the test that ends at the stamp ``end_ns`` was received live."""
        ...


class UnitPrognoses:
    """Health and remaining life of each unit. Thread-safe."""

    def __init__(
        self,
        histories: Histories,
        reception: Reception,
        operation: LiveSettings[Operation],
        store: CalibrationStore,
        now_ns: Callable[[], int],
        log: Log,
    ) -> None:
        self._histories = histories
        self._reception = reception
        self._operation = operation
        self._store = store
        self._now_ns = now_ns
        self._log = log

    def record(self, description: ActuatorDescription, estimate: Estimate) -> Outlook | None:
        """Record a test. Return the updated health and life; None if they are unchanged.

        If the test cannot be recorded, the outlook from the history is returned as STALE. If the
        history is empty or fails, the outlook of this test alone is returned. Both have the reason.
        """
        settings, now_ns, key = self._histories.settings(), self._now_ns(), description.unit_key
        try:
            unit = self._histories.of(description)
            # Also for a test that is not recorded: its use must not count for the next test.
            end_ns = estimate.end_ns if settings.has_clock else now_ns
            use = self._reception.take_use(key, end_ns)
            self._histories.refusals[key] = reason = self._why_not_recorded(end_ns, now_ns)
            if not reason:
                parameters = self.parameters(description)
                is_live = self._reception.is_live(description.actuator_id, estimate.end_ns)
                outlook = unit.update(estimate, parameters, settings, *use, now_ns, is_live)
                self._histories.log(description, unit, outlook.events if outlook else ())
                return outlook
            self._log.warn(description.actuator_id, reason)
            # Whether it is the newest test is uncertain, and so is the level.
            if unit.history.newest is not None:
                resumed = unit.resume(self.parameters(description), settings)
                is_skipped = estimate.verdict == Verdict.SKIPPED
                return None if is_skipped or not resumed else resumed.stale(reason)
        except Exception as error:
            # A failure here must prevent neither the estimate nor the alarm.
            reason = self._log.failed(description.actuator_id, PROGNOSIS, error)
        if estimate.verdict == Verdict.SKIPPED:
            return None
        claim = Claim(estimate.end_ns, now_ns, self._histories.author, settings.good_for_s)
        if estimate.valid:
            return replace(outlook_of_one(estimate, settings.limits, reason), claim=claim)
        refused = UnusedCycle.of(estimate)
        return replace(unknown_outlook(reason).after_refusal(refused), claim=claim)

    def _why_not_recorded(self, stamp_ns: int, now_ns: int) -> str:
        """Return why a test stamped ``stamp_ns`` cannot be recorded; empty if it can."""
        offset_s = (stamp_ns - now_ns) * 1e-9
        limit_s = self._operation.value.history_max_offset_s
        if self._histories.folder is None or abs(offset_s) <= limit_s:
            return ""
        stamp = datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC)
        return (
            f"the test of {stamp:%Y-%m-%d %H:%M:%S} UTC is not recorded: its stamp is "
            f"{_span(abs(offset_s))} {'after' if offset_s > 0.0 else 'before'} the clock of the "
            f"monitor, at most {_span(limit_s)} are allowed; for a replay, set use_sim_time; "
            "otherwise set the clock of the actuator, increase history_max_offset_s, or set "
            "has_clock = false if the actuator has no clock"
        )

    def forecaster(self, description: ActuatorDescription, outlook: Outlook) -> Forecaster | None:
        """Return a forecaster that continues an outlook; None if no forecast is possible."""
        try:
            if self._histories.refusals.get(description.unit_key):
                return None
            return self._histories.of(description).forecaster(outlook)
        except Exception as error:
            self._log.failed(description.actuator_id, "the forecast", error)
            return None

    def parameters(self, description: ActuatorDescription) -> ActuatorParameters | None:
        """Return a unit's parameters from its calibration; None without a calibration."""
        calibration = self._store.of(description)
        return None if isinstance(calibration, Reason) else calibration.unit_parameters

    def alarm(self, description: ActuatorDescription) -> str:
        """Return why a unit's level is WARN or ERROR; "" for other levels."""
        unit, settings = self._histories.of(description), self._histories.settings()
        return unit.alarm(self.parameters(description), settings)

    def change_baseline(
        self,
        description: ActuatorDescription,
        person: str,
        calibration_id: str,
        time_ns: int,
        *,
        is_forced: bool,
    ) -> Outlook | None:
        """Record a new calibration of a unit. Return the resulting health.

        Returns None if nothing was recorded, because the unit has no valid test yet.
        """
        unit = self._histories.of(description)
        if not unit.change_baseline(person, calibration_id, time_ns, is_forced=is_forced):
            return None
        return unit.resume(self.parameters(description), self._histories.settings())


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < _DAY_S else f"{seconds / _DAY_S:.1f} days"
