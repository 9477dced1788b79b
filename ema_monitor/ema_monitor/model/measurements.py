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
        """Discard the measurements of an actuator."""
        self._by_actuator.pop(actuator_id, None)

    def add(self, actuator_id: str, stamp_ns: int, measured: Iterable[CauseEstimate]) -> None:
        """Store measurements with their stamp, of the latest thousand actuators at most.

        Raises
        ------
        ValueError
            As in `checked_causes`; then nothing is kept.
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

        One made during the window does not count: it might be received too late for it. Nor does
        one that is older than ``max_age_s`` [s].
        """
        of_each = (self._latest(actuator_id, name, start_ns, max_age_s) for name in HIDDEN_CAUSES)
        return tuple(one for one in of_each if one is not None)

    def winding_rise(
        self, actuator_id: str, stamp_ns: int, max_age_s: float = MAX_AGE_S
    ) -> float | None:
        """Return the latest winding temperature rise [K] measured up to a stamp, or None."""
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
