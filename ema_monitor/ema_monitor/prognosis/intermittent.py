"""Faults and failures that come and go: there in some of the latest tests, gone in others."""

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


class _Sign:
    """A sign of damage in the latest tests that were conclusive about it.

    Attributes
    ----------
    recurrence
        How often it came, once it is intermittent; None before.
    """

    def __init__(self) -> None:
        self.recurrence: Recurrence | None = None
        # Stamps [ns], and distances from healthy, 0 if it had gone.
        self._latest = deque[tuple[int, float]](maxlen=LATEST_TESTS)
        # Stamps of the tests in which it came while it was intermittent [ns].
        self._stamps_ns = set[int]()

    def add(self, stamp_ns: int, distance: float) -> bool:
        """Add the next conclusive test; return whether it is intermittent from this test on."""
        before = self.recurrence
        self._latest.append((stamp_ns, distance))
        self._judge(stamp_ns if distance else 0)
        return before is None and self.recurrence is not None

    def acknowledge(self, stamp_ns: int) -> None:
        """End it if it came in the test of a stamp [ns]; later tests count."""
        if stamp_ns not in self._stamps_ns:
            return
        later = [test for test in self._latest if test[0] > stamp_ns]
        self._latest = deque(later, maxlen=LATEST_TESTS)
        self._stamps_ns = {stamp for stamp in self._stamps_ns if stamp > stamp_ns}
        self.recurrence = None
        self._judge(0)

    def _judge(self, came_ns: int) -> None:
        """Note whether it is intermittent; it came in the test of a stamp [ns], 0: did not."""
        distances = [distance for _, distance in self._latest]
        if self.recurrence is None and _times(distances) < OCCURRENCES:
            return
        worst = max(max(distances), self.recurrence.worst if self.recurrence else 0.0)
        times = sum(distance > 0.0 for distance in distances)
        self.recurrence = Recurrence(times, len(distances), worst)
        self._stamps_ns |= {came_ns} - {0}


class Intermittent:
    """Follows which faults, and which failures, have come and gone, test by test.

    A fault has come if its lower 95 % bound is beyond its limit, and gone if its upper one is
    within half of it; other tests leave it open, for example if the fault is near its limit. A
    failure has come with a test that found the actuator or a sensor out of order, and gone with a
    valid one. What comes again is intermittent from that test on, until a person acknowledges it.

    Parameters
    ----------
    limits
        Limits at which life ends.
    """

    def __init__(self, limits: HealthLimits) -> None:
        self._limits = limits
        self._faults = {name: _Sign() for name in COMPONENTS}
        self._failure = _Sign()

    @property
    def faults(self) -> dict[str, Recurrence]:
        """Intermittent faults by name."""
        return {name: sign.recurrence for name, sign in self._faults.items() if sign.recurrence}

    @property
    def failure(self) -> Recurrence | None:
        """How often tests failed, if failures are intermittent; its distance says nothing."""
        return self._failure.recurrence

    def add(self, estimate: Estimate) -> list[str]:
        """Add the next valid test; return the faults that are intermittent from it on."""
        self._failure.add(estimate.end_ns, 0.0)
        new = []
        for name, sign in self._faults.items():
            distance = _distance(estimate, name, self._limits)
            if distance is not None and sign.add(estimate.end_ns, distance):
                new.append(name)
        return new

    def add_failure(self, stamp_ns: int) -> None:
        """Add the next test, at a stamp [ns], that found the actuator or a sensor out of order."""
        self._failure.add(stamp_ns, 1.0)

    def acknowledge(self, stamp_ns: int) -> None:
        """End what is intermittent and came in the test of a stamp [ns]; later tests count."""
        for sign in (*self._faults.values(), self._failure):
            sign.acknowledge(stamp_ns)


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
