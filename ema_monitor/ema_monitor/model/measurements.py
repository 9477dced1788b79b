"""Measurements of hidden causes by actuator, and their selection for a window."""

from bisect import bisect_right, insort
from collections.abc import Iterable
from typing import Final

from ema_core.causes import CauseEstimate
from ema_monitor.model.deviations import HIDDEN_CAUSES
from ema_monitor.model.measured import checked_causes

MAX_AGE_S: Final = 10.0
"""Default of the largest age of a measurement at the start of a window [s]."""

_MOST_ACTUATORS: Final = 1000


class MeasurementLog:
    """Measurements of hidden causes, by actuator and cause.

    The selection for a window depends on stamps only, so that live operation, replay and offline
    evaluation agree.

    Parameters
    ----------
    most
        Number of latest measurements to keep per cause; None to keep all.
    """

    def __init__(self, most: int | None = None) -> None:
        self._most = most
        self._by_actuator: dict[str, dict[str, list[tuple[int, CauseEstimate]]]] = {}

    def clear(self) -> None:
        """Discard all measurements."""
        self._by_actuator.clear()

    def forget(self, actuator_id: str) -> None:
        """Discard the measurements of an actuator."""
        self._by_actuator.pop(actuator_id, None)

    def add(self, actuator_id: str, stamp_ns: int, measured: Iterable[CauseEstimate]) -> None:
        """Store measurements with their stamp [ns], for the latest thousand actuators.

        Raises
        ------
        ValueError
            If a measurement is invalid (`checked_causes`); then none is stored.
        """
        measured = checked_causes(measured)
        by_name = self._by_actuator[actuator_id] = self._by_actuator.pop(actuator_id, {})
        for cause in measured:
            course = by_name.setdefault(cause.name, [])
            insort(course, (stamp_ns, cause), key=_stamp)
            if self._most is not None and len(course) > self._most:
                del course[0]
        if len(self._by_actuator) > _MOST_ACTUATORS:
            del self._by_actuator[next(iter(self._by_actuator))]

    def at(
        self, actuator_id: str, start_ns: int, max_age_s: float = MAX_AGE_S
    ) -> tuple[CauseEstimate, ...]:
        """Return the latest measurement of each cause at the start of a window.

        Measurements older than ``max_age_s`` [s] are ignored. Measurements during the window are
        ignored as well, because they might be received too late.
        """
        latest = (self._latest(actuator_id, name, start_ns, max_age_s) for name in HIDDEN_CAUSES)
        return tuple(cause for cause in latest if cause is not None)

    def winding_rise(
        self, actuator_id: str, stamp_ns: int, max_age_s: float = MAX_AGE_S
    ) -> float | None:
        """Return the latest winding temperature rise [K] measured before a stamp, or None."""
        latest = self._latest(actuator_id, "winding_temperature", stamp_ns, max_age_s)
        return None if latest is None else latest.value

    def _latest(
        self, actuator_id: str, name: str, stamp_ns: int, max_age_s: float
    ) -> CauseEstimate | None:
        course = self._by_actuator.get(actuator_id, {}).get(name, [])
        before = bisect_right(course, stamp_ns, key=_stamp)
        if before and stamp_ns - course[before - 1][0] <= max_age_s * 1e9:
            return course[before - 1][1]
        return None


def _stamp(item: tuple[int, CauseEstimate]) -> int:
    return item[0]
