# SPDX-License-Identifier: Apache-2.0
"""Detection of intermittent faults and failures."""

from collections import deque
from collections.abc import Iterable
from typing import Final, NamedTuple

from ema_core.event_kinds import EventKind
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_monitor.health import ONE_SIDED_95, HealthLimits, Recurrence
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Entry

LATEST_TESTS: Final = 20
"""Number of latest tests that are searched for intermittent faults."""

GONE_SHARE: Final = 0.5
"""Share of the limit below which a fault is absent [-]."""

OCCURRENCES: Final = 2
"""Smallest number of occurrences of an intermittent fault: a single one may be an estimation
error."""

CERTAIN_SIGMA: Final = 5.0
"""Distance beyond the limit above which even a single occurrence of a fault gives a warning
[standard deviations]."""

ABSENCES: Final = 14
"""Number of consecutive tests without the fault that end the warning after a single occurrence.
They would miss a fault that appears in one of five tests with a probability below 5 % (0.8^14)."""


class _Sighting(NamedTuple):
    """Result of a conclusive test."""

    stamp_ns: int
    """Stamp of the test [ns]."""
    distance: float = 0.0
    """Distance of the fault from healthy; 0 if it was absent [-]."""
    is_certain: bool = False
    """Whether the fault appeared suddenly, and far beyond its limit."""


class _Sign:
    """A sign of damage in the latest conclusive tests.

    Attributes
    ----------
    recurrence
        Occurrences of the sign, if it is intermittent or was present once; else None.
    """

    def __init__(self) -> None:
        self.recurrence: Recurrence | None = None
        self._latest = deque[_Sighting](maxlen=LATEST_TESTS)
        # Stamps of the tests whose events a person may acknowledge [ns].
        self._stamps_ns = set[int]()
        self._is_near_limit = False

    def add(self, stamp_ns: int, distance: float, *, is_certain: bool = False) -> None:
        """Add the next conclusive test."""
        before = self._latest[-1].distance if self._latest else 1.0
        is_sudden = before == 0.0 and not self._is_near_limit
        self._latest.append(_Sighting(stamp_ns, distance, is_certain and is_sudden))
        self._is_near_limit = False
        if is_certain and is_sudden:
            self._stamps_ns.add(stamp_ns)
        self._judge()

    def pass_over(self) -> None:
        """Note an inconclusive test: an appearance of the sign in the next test is not sudden."""
        self._is_near_limit = True

    def acknowledge(self, stamp_ns: int) -> None:
        """Reset the sign if the test at ``stamp_ns`` [ns] has an event about the sign.

        Later tests still count.
        """
        if stamp_ns not in self._stamps_ns:
            return
        later = [test for test in self._latest if test.stamp_ns > stamp_ns]
        self._latest = deque(later, maxlen=LATEST_TESTS)
        self._stamps_ns = {stamp for stamp in self._stamps_ns if stamp > stamp_ns}
        self.recurrence = None
        self._judge()

    def _judge(self) -> None:
        """Update the recurrence after a test."""
        distances = [test.distance for test in self._latest]
        before = self.recurrence
        is_intermittent = before is not None and not before.tests_left
        if not is_intermittent and _times(distances) < OCCURRENCES:
            self.recurrence = self._single()
            if before is None and self.recurrence is not None:
                self._stamps_ns.add(self._latest[-1].stamp_ns)
            return
        worst = max(max(distances), before.worst if before else 0.0)
        times = sum(distance > 0.0 for distance in distances)
        self.recurrence = Recurrence(times, len(distances), worst)
        newest = self._latest[-1] if self._latest else _Sighting(0)
        if newest.distance:
            self._stamps_ns.add(newest.stamp_ns)

    def _single(self) -> Recurrence | None:
        """Return a single certain occurrence, or None.

        One to ``ABSENCES`` - 1 tests without the sign must follow it.
        """
        latest = list(self._latest)
        absences = next((n for n, test in enumerate(reversed(latest)) if test.distance), 0)
        if not 0 < absences < ABSENCES or not latest[-1 - absences].is_certain:
            return None
        return Recurrence(1, absences + 1, latest[-1 - absences].distance, ABSENCES - absences)


class Intermittent:
    """Detects intermittent faults and failures, test by test.

    A fault is present if its lower 95 % bound is beyond its limit, and absent if its upper 95 %
    bound is below half the limit. Other tests are inconclusive, for example if the fault is near
    its limit. A failure is present in a test that shows a failed actuator or sensor, and absent in
    a valid test. A fault or failure that recurs is intermittent until a person acknowledges it. A
    fault that appeared suddenly and far beyond its limit, in a single test, gives a warning. The
    warning ends if a person acknowledges it, or after ``ABSENCES`` consecutive tests without the
    fault.

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
        """Recurrence of each fault that is intermittent or appeared once, keyed by name."""
        return {name: sign.recurrence for name, sign in self._faults.items() if sign.recurrence}

    @property
    def failure(self) -> Recurrence | None:
        """Recurrence of failures if they are intermittent, else None; ``worst`` is unused."""
        return self._failure.recurrence

    def add(self, estimate: Estimate) -> None:
        """Add the next valid test."""
        self._failure.add(estimate.end_ns, 0.0)
        for name, sign in self._faults.items():
            number = FAULT_NAMES.index(name)
            if not estimate.valid or estimate.unobservable[number]:
                continue
            limit, sigma = self._limits.of(name), estimate.sigma[number]
            distance = float(abs(estimate.faults[number] - FAULTS[number].healthy))
            if distance - ONE_SIDED_95 * sigma > limit:
                is_certain = distance - CERTAIN_SIGMA * sigma > limit
                sign.add(estimate.end_ns, distance, is_certain=is_certain)
            elif distance + ONE_SIDED_95 * sigma <= GONE_SHARE * limit:
                sign.add(estimate.end_ns, 0.0)
            else:
                sign.pass_over()

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
    # A note takes effect with its test, or with the later test whose assessment contains it.
    notes = deque(
        sorted(
            (max(stamp_ns, history.time_of(event.stamp_ns)), history.time_of(event.stamp_ns))
            for stamp_ns, assessment in history.assessments.items()
            for event in assessment.events
            if event.kind is EventKind.NOTE
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
