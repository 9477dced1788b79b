# SPDX-License-Identifier: Apache-2.0
"""Log of measured hidden causes by actuator, and their selection for a window."""

from bisect import bisect_right, insort
from collections.abc import Iterable
from typing import Final

from ema_core.causes import CauseEstimate
from ema_monitor.model.deviations import HIDDEN_CAUSES
from ema_monitor.model.measured import checked_causes

MAX_AGE_S: Final = 10.0
"""Default for the largest age of a measurement at the start of a window [s]."""

_MOST_ACTUATORS: Final = 1000


class MeasurementLog:
    """Log of measured hidden causes, by actuator and cause.

    The selection for a window only depends on timestamps, so that live operation, replay and
    offline evaluation give the same result.

    Parameters
    ----------
    most
        Largest number of measurements to keep per cause; None to keep all.
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
        """Store the measurements of an actuator with their timestamp [ns].

        Only the thousand actuators with the most recent measurements are kept.

        Raises
        ------
        ValueError
            If a measurement is invalid (`checked_causes`). In this case, no measurement is stored.
        """
        measured = checked_causes(measured)
        by_name = self._by_actuator[actuator_id] = self._by_actuator.pop(actuator_id, {})
        for cause in measured:
            history = by_name.setdefault(cause.name, [])
            insort(history, (stamp_ns, cause), key=_stamp)
            if self._most is not None and len(history) > self._most:
                del history[0]
        if len(self._by_actuator) > _MOST_ACTUATORS:
            del self._by_actuator[next(iter(self._by_actuator))]

    def at(
        self, actuator_id: str, start_ns: int, max_age_s: float = MAX_AGE_S
    ) -> tuple[CauseEstimate, ...]:
        """Return the latest measurement of each cause up to the start of a window.

        Measurements older than ``max_age_s`` [s] are ignored. Measurements during the window are
        not used, because they may be received too late.
        """
        latest = (self._latest(actuator_id, name, start_ns, max_age_s) for name in HIDDEN_CAUSES)
        return tuple(cause for cause in latest if cause is not None)

    def winding_rise(
        self, actuator_id: str, stamp_ns: int, max_age_s: float = MAX_AGE_S
    ) -> float | None:
        """Return the latest measured winding temperature rise [K] at a timestamp, or None."""
        latest = self._latest(actuator_id, "winding_temperature", stamp_ns, max_age_s)
        return None if latest is None else latest.value

    def _latest(
        self, actuator_id: str, name: str, stamp_ns: int, max_age_s: float
    ) -> CauseEstimate | None:
        history = self._by_actuator.get(actuator_id, {}).get(name, [])
        before = bisect_right(history, stamp_ns, key=_stamp)
        if before and stamp_ns - history[before - 1][0] <= max_age_s * 1e9:
            return history[before - 1][1]
        return None


def _stamp(item: tuple[int, CauseEstimate]) -> int:
    return item[0]
