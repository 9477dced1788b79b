"""Which tests may enter the histories of a monitor: those of its clock, none of a replay."""

import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rclpy.node import Node

from ema_core.description import UnitKey
from ema_monitor.node.settings import HistoryRules
from ema_ros.settings import LiveSettings
from ema_ros.throttle import Throttle

_LOG_PERIOD_S: Final = 30.0
_DAY_S: Final = 86_400.0


class Recordable:
    """Decides, by clock and stamp, whether a test enters a history; any thread may call.

    Parameters
    ----------
    node
        Gets the parameter; its clock and its log are used.

    Attributes
    ----------
    note
        What a change of the clock did to the histories, for the status; empty when nothing.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._settings = LiveSettings(node, HistoryRules)
        self._throttle = Throttle(_LOG_PERIOD_S)
        self._is_on_disk = False
        self._is_suspended = False
        self._refusals: dict[UnitKey, str] = {}
        self.note = ""

    def begin(self, folder: Path | None) -> Path | None:
        """Return where histories are kept from now on; None for memory alone.

        They always are in memory in simulated time: a bag that is replayed must not mix with tests
        of the actuator itself.
        """
        in_sim_time = bool(self._node.get_parameter("use_sim_time").value)
        self._is_on_disk = folder is not None and not in_sim_time
        self._is_suspended = False
        self._refusals.clear()
        self.note = ""
        return folder if self._is_on_disk else None

    def suspend(self) -> None:
        """Refuse all tests from now on, while the clock changes."""
        self._is_suspended = True

    def change_clock(self, folder: Path | None) -> Path | None:
        """Return where histories are kept after a change of ``use_sim_time``."""
        kept = self.begin(folder)
        if self._node.get_parameter("use_sim_time").value:
            self.note = (
                "use_sim_time was set while the monitor ran: histories on disk are closed, tests "
                "from then on are in memory only"
            )
        else:
            self.note = (
                "use_sim_time was reset while the monitor ran: what was in memory is forgotten"
            )
        self._node.get_logger().warning(self.note)
        return kept

    def refusal(self, unit: UnitKey) -> str:
        """Return why the latest test of a unit was not recorded; empty when it was."""
        return self._refusals.get(unit, "")

    def refuse(self, unit: UnitKey, stamp_ns: int) -> str:
        """Return, and log, why a test of a stamp [ns] may not be recorded; empty when it may."""
        reason = self._reason(stamp_ns)
        if not reason:
            self._refusals.pop(unit, None)
            return ""
        self._refusals[unit] = reason
        line = self._throttle.passed(f"{unit[0]}: {reason}", time.monotonic())
        if line is not None:
            self._node.get_logger().warning(line)
        return reason

    def _reason(self, stamp_ns: int) -> str:
        test = f"the test of {_utc(stamp_ns)} is not recorded"
        if self._is_suspended:
            return f"{test}: use_sim_time was changed before it was identified"
        offset_s = (stamp_ns - self._node.get_clock().now().nanoseconds) * 1e-9
        limit_s = self._settings.value.history_max_offset_s
        if not self._is_on_disk or abs(offset_s) <= limit_s:
            return ""
        side = "after" if offset_s > 0.0 else "before"
        return (
            f"{test}: its stamp is {_span(abs(offset_s))} {side} the clock of the monitor, allowed "
            f"are {_span(limit_s)}; set use_sim_time for a replay, else set the clock of the "
            "actuator, or history_max_offset_s"
        )


def _utc(stamp_ns: int) -> str:
    return f"{datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC):%Y-%m-%d %H:%M:%S} UTC"


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < _DAY_S else f"{seconds / _DAY_S:.1f} days"
