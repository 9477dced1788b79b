"""Detection of intermittent faults and failures."""

from collections import deque
from collections.abc import Iterable
from typing import Final

from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_monitor.health import ONE_SIDED_95, HealthLimits, Recurrence
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import NOTE, Entry

LATEST_TESTS: Final = 20
"""Number of latest tests in which intermittent faults are searched."""

GONE_SHARE: Final = 0.5
"""Share of the limit below which a fault is absent [-]."""

OCCURRENCES: Final = 2
"""Smallest number of occurrences of an intermittent fault: a single one may be an estimation
error."""


class _Sign:
    """A sign of damage in the latest conclusive tests.

    Attributes
    ----------
    recurrence
        Occurrences of the sign, if it is intermittent; else None.
    """

    def __init__(self) -> None:
        self.recurrence: Recurrence | None = None
        # Stamps [ns], and distances from healthy, 0 if the sign was absent.
        self._latest = deque[tuple[int, float]](maxlen=LATEST_TESTS)
        # Stamps of the tests in which the sign was present while it was intermittent [ns].
        self._stamps_ns = set[int]()

    def add(self, stamp_ns: int, distance: float) -> None:
        """Add the next conclusive test."""
        self._latest.append((stamp_ns, distance))
        self._judge(stamp_ns if distance else 0)

    def acknowledge(self, stamp_ns: int) -> None:
        """Reset the sign if it was present in the test at ``stamp_ns``; later tests count."""
        if stamp_ns not in self._stamps_ns:
            return
        later = [test for test in self._latest if test[0] > stamp_ns]
        self._latest = deque(later, maxlen=LATEST_TESTS)
        self._stamps_ns = {stamp for stamp in self._stamps_ns if stamp > stamp_ns}
        self.recurrence = None
        self._judge(0)

    def _judge(self, present_ns: int) -> None:
        """Update the recurrence after a test; ``present_ns`` is its stamp, 0 without the sign."""
        distances = [distance for _, distance in self._latest]
        if self.recurrence is None and _times(distances) < OCCURRENCES:
            return
        worst = max(max(distances), self.recurrence.worst if self.recurrence else 0.0)
        times = sum(distance > 0.0 for distance in distances)
        self.recurrence = Recurrence(times, len(distances), worst)
        self._stamps_ns |= {present_ns} - {0}


class Intermittent:
    """Detects intermittent faults and failures, test by test.

    A fault is present if its lower 95 % bound is beyond its limit, and absent if its upper 95 %
    bound is below half the limit. Other tests are inconclusive, for example if the fault is near
    its limit. A failure is present in a test that shows a failed actuator or sensor, and absent in
    a valid test. A fault or failure that recurs is intermittent until a person acknowledges it.

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
        """Recurrence of each intermittent fault by name."""
        return {name: sign.recurrence for name, sign in self._faults.items() if sign.recurrence}

    @property
    def failure(self) -> Recurrence | None:
        """Recurrence of failures if they are intermittent, else None; ``worst`` is unused."""
        return self._failure.recurrence

    def add(self, estimate: Estimate) -> None:
        """Add the next valid test."""
        self._failure.add(estimate.end_ns, 0.0)
        for name, sign in self._faults.items():
            distance = _distance(estimate, name, self._limits)
            if distance is not None:
                sign.add(estimate.end_ns, distance)

    def add_failure(self, stamp_ns: int) -> None:
        """Add the next test, stamped ``stamp_ns`` [ns], which shows a failed actuator or sensor."""
        self._failure.add(stamp_ns, 1.0)

    def acknowledge(self, stamp_ns: int) -> None:
        """Reset the intermittent faults and failures shown by the test at ``stamp_ns`` [ns]."""
        for sign in (*self._faults.values(), self._failure):
            sign.acknowledge(stamp_ns)


def intermittent_of(history: History, limits: HealthLimits) -> Intermittent:
    """Return the intermittent faults and failures from all tests and the notes on them."""
    result = Intermittent(limits)
    # A note holds from the test on that it is about, or with which it is kept.
    notes = deque(
        sorted(
            (max(stamp_ns, history.time_of(event.stamp_ns)), history.time_of(event.stamp_ns))
            for stamp_ns, assessment in history.assessments.items()
            for event in assessment.events
            if event.kind == NOTE
        )
    )
    for test in sorted(history.tests, key=lambda test: test.stamp_ns):
        if isinstance(test, Entry):
            result.add(test.estimate)
        elif history.has_failed(test):
            result.add_failure(test.stamp_ns)
        while notes and notes[0][0] <= test.stamp_ns:
            result.acknowledge(notes.popleft()[1])
    return result


def _times(distances: Iterable[float]) -> int:
    """Return how often a fault appeared, at the start or after an absence."""
    before, times = 0.0, 0
    for distance in distances:
        times += distance > 0.0 and before == 0.0
        before = distance
    return times


def _distance(estimate: Estimate, name: str, limits: HealthLimits) -> float | None:
    """Return a fault's distance from healthy if present, 0 if absent, None if inconclusive."""
    number = FAULT_NAMES.index(name)
    if not estimate.valid or estimate.unobservable[number]:
        return None
    distance = abs(estimate.faults[number] - FAULTS[number].healthy)
    reach, limit = ONE_SIDED_95 * estimate.sigma[number], limits.of(name)
    if distance - reach > limit:
        return float(distance)
    return 0.0 if distance + reach <= GONE_SHARE * limit else None
