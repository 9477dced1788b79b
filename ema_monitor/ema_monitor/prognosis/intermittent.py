"""Faults that come and go: beyond their limit in some of the latest tests, within it in others."""

from collections import deque
from collections.abc import Iterable
from typing import Final

from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_monitor.health import ONE_SIDED_95, HealthLimits, Recurrence
from ema_monitor.identification.estimate import Estimate

LATEST_TESTS: Final = 20
"""Tests in which a fault may come and go."""

GONE_SHARE: Final = 0.5
"""Share of the limit below which a fault has gone [-]."""

OCCURRENCES: Final = 2
"""Times that it must have come in them: one occurrence may be an error of the estimate."""


_StampedDistance = tuple[int, float]


class Intermittent:
    """Follows which faults have come and gone, test by test.

    A fault has come if its lower 95 % bound is beyond its limit, and gone if its upper one is
    within half of it; other tests leave it open, for example if the fault is near its limit. A
    fault that comes again is intermittent from that test on, until a person acknowledges it.

    Parameters
    ----------
    limits
        Limits at which life ends.

    Attributes
    ----------
    faults
        Intermittent faults by name.
    """

    def __init__(self, limits: HealthLimits) -> None:
        self._limits = limits
        self.faults: dict[str, Recurrence] = {}
        # By component, stamps of the latest conclusive tests [ns], and distances, 0 if it had gone.
        self._latest = {name: deque[_StampedDistance](maxlen=LATEST_TESTS) for name in COMPONENTS}
        # Stamps of the tests in which an intermittent fault came [ns].
        self._stamps_ns = {name: set[int]() for name in COMPONENTS}

    def add(self, estimate: Estimate) -> list[str]:
        """Add the next test; return the faults that are intermittent from it on."""
        before = set(self.faults)
        for name, latest in self._latest.items():
            distance = _distance(estimate, name, self._limits)
            if distance is not None:
                latest.append((estimate.end_ns, distance))
                self._judge(name, estimate.end_ns if distance else 0)
        return [name for name in self.faults if name not in before]

    def acknowledge(self, stamp_ns: int) -> None:
        """End the intermittent faults that came in the test of a stamp [ns]; later ones count."""
        for name in list(self.faults):
            if stamp_ns in self._stamps_ns[name]:
                later = [one for one in self._latest[name] if one[0] > stamp_ns]
                self._latest[name] = deque(later, maxlen=LATEST_TESTS)
                self._stamps_ns[name] = {one for one in self._stamps_ns[name] if one > stamp_ns}
                del self.faults[name]
                self._judge(name, 0)

    def _judge(self, name: str, came_ns: int) -> None:
        """Note whether a fault is intermittent; it came in the test of a stamp [ns], 0: did not."""
        distances = [distance for _, distance in self._latest[name]]
        known = self.faults.get(name)
        if known is None and _times(distances) < OCCURRENCES:
            return
        worst = max(max(distances), known.worst if known else 0.0)
        times = sum(distance > 0.0 for distance in distances)
        self.faults[name] = Recurrence(times, len(distances), worst)
        self._stamps_ns[name] |= {came_ns} - {0}


def _times(distances: Iterable[float]) -> int:
    """Return how often a fault came, after it had gone or at the start."""
    before, times = 0.0, 0
    for distance in distances:
        times += distance > 0.0 and before == 0.0
        before = distance
    return times


def _distance(estimate: Estimate, name: str, limits: HealthLimits) -> float | None:
    """Return a fault's distance from healthy if it is beyond its limit, 0 if gone, else None."""
    number = FAULT_NAMES.index(name)
    if not estimate.valid or estimate.unobservable[number]:
        return None
    distance = abs(estimate.faults[number] - FAULTS[number].healthy)
    reach, limit = ONE_SIDED_95 * estimate.sigma[number], limits.of(name)
    if distance - reach > limit:
        return float(distance)
    return 0.0 if distance + reach <= GONE_SHARE * limit else None
