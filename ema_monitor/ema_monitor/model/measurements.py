"""Measurements of hidden causes by actuator, and which of them hold for a window."""

from bisect import bisect_right, insort
from collections.abc import Iterable
from typing import Final

from ema_core.causes import CauseEstimate
from ema_monitor.model.deviations import HIDDEN_CAUSES
from ema_monitor.model.measured import checked_causes

MAX_AGE_S: Final = 10.0
"""Usual age at the start of a window up to which a measurement holds for it [s]."""

_MOST_ACTUATORS: Final = 1000


class MeasurementLog:
    """What was measured, by actuator and cause.

    What holds for a window depends on stamps alone: live, in a replay and offline it is the same.

    Parameters
    ----------
    most
        How many measurements of a cause are kept, the latest ones; None for all.
    """

    def __init__(self, most: int | None = None) -> None:
        self._most = most
        self._by_actuator: dict[str, dict[str, list[tuple[int, CauseEstimate]]]] = {}

    def clear(self) -> None:
        """Forget all."""
        self._by_actuator.clear()

    def forget(self, actuator_id: str) -> None:
        """Forget what was measured of an actuator."""
        self._by_actuator.pop(actuator_id, None)

    def add(self, actuator_id: str, stamp_ns: int, measured: Iterable[CauseEstimate]) -> None:
        """Keep what was measured at a time; of more than a thousand actuators, the latest.

        Parameters
        ----------
        actuator_id, stamp_ns
            Of which actuator, and when [ns].
        measured
            What it was.

        Raises
        ------
        ValueError
            As of `checked_causes`; then nothing is kept.
        """
        measured = checked_causes(measured)
        by_name = self._by_actuator[actuator_id] = self._by_actuator.pop(actuator_id, {})
        for one in measured:
            course = by_name.setdefault(one.name, [])
            insort(course, (stamp_ns, one), key=_stamp)
            if self._most is not None and len(course) > self._most:
                del course[0]
        if len(self._by_actuator) > _MOST_ACTUATORS:
            del self._by_actuator[next(iter(self._by_actuator))]

    def at(
        self, actuator_id: str, start_ns: int, max_age_s: float = MAX_AGE_S
    ) -> tuple[CauseEstimate, ...]:
        """Return the latest measurement of each cause at the start of a window.

        One made during the window does not count: it might be received too late for it.

        Parameters
        ----------
        actuator_id, start_ns
            Of which actuator, and stamp of the window's start [ns].
        max_age_s
            Age from which on a measurement does not hold any more [s].
        """
        by_name, found = self._by_actuator.get(actuator_id, {}), []
        for name in HIDDEN_CAUSES:
            course = by_name.get(name, [])
            before = bisect_right(course, start_ns, key=_stamp)
            if before and start_ns - course[before - 1][0] <= max_age_s * 1e9:
                found.append(course[before - 1][1])
        return tuple(found)

    def winding_rise(
        self, actuator_id: str, stamp_ns: int, max_age_s: float = MAX_AGE_S
    ) -> float | None:
        """Return the latest measured rise of the winding [K], as of ``at``; None without one."""
        course = self._by_actuator.get(actuator_id, {}).get("winding_temperature", [])
        before = bisect_right(course, stamp_ns, key=_stamp)
        if before and stamp_ns - course[before - 1][0] <= max_age_s * 1e9:
            return course[before - 1][1].value
        return None


def _stamp(item: tuple[int, CauseEstimate]) -> int:
    return item[0]
