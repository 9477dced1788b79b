# SPDX-License-Identifier: Apache-2.0
"""Ordering of a unit's tests by stamp or by reception."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from ema_core.faults import ECCENTRICITY_PHASE
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Test, UnusedCycle
from ema_monitor.reasons import OrderUnknown, codes

SAME_TEST_SIGMAS: Final = 4.0
"""Largest difference of a fault between two estimates of the same test [standard deviations]."""

_LEAST_AHEAD_NS: Final = 1_000_000_000


class Place(NamedTuple):
    """Position of a test among the tests of its unit."""

    shift_ns: int = 0
    """Correction of the stamp that puts the test after all earlier tests [ns]."""
    problem: OrderUnknown | None = None
    """Reason why the order of the tests is unknown; None if it is known."""
    is_known: bool = False
    """Whether the history already contains the test."""
    is_ordered: bool = True
    """Whether later tests with the same kind of stamps may be ordered after this test."""


def place_of(
    estimate: Estimate,
    history: History,
    received_ns: int,
    newest_received_ns: int,
    by_clock: bool,
    is_live: bool = False,
) -> Place:
    """Return the position of a test among the tests of its unit.

    Tests are ordered by stamp. If the stamp is not later than the newest stamp, the order of
    reception counts in two cases: the clock went back, so that the receiver's clock is behind the
    reception of the newest test, or the test was received while it was measured. Later tests with
    such stamps follow with the same correction. Otherwise the order is unknown. A test of a
    recording is placed by its stamp, unless another test has the same stamp.

    Parameters
    ----------
    estimate
        The test.
    history
        Tests so far.
    received_ns
        Reception time of the test on the receiver's clock [ns]; 0 for a recording.
    newest_received_ns
        Reception time of the newest test so far [ns]; 0 if unknown.
    by_clock
        Whether stamps come from a clock; otherwise tests are always ordered by reception.
    is_live
        Whether the test was received while it was measured.
    """
    newest, end_ns = history.newest, estimate.end_ns
    if received_ns and not by_clock:
        date_ns = max(received_ns, newest.stamp_ns + 1 if newest else 0)
        return Place(date_ns - end_ns)
    if newest is None or end_ns > newest.stamp_ns or estimate.verdict == Verdict.SKIPPED:
        return Place()
    if any(is_same(test, estimate) for test in reversed(history.tests)):
        return Place(is_known=True)
    if isinstance(newest, UnusedCycle) and newest.stamp_ns == end_ns and estimate.valid:
        return Place()  # the same window, with a valid estimate at the second attempt
    shift_ns = newest.stamp_ns + 1 - end_ns
    if not received_ns:
        is_other = estimate.valid and history.holds_valid(end_ns)
        return Place(shift_ns, _problem(end_ns, newest)) if is_other else Place()
    is_ordered = not isinstance(newest, UnusedCycle) or newest.is_ordered
    if newest.shift_ns and is_ordered and end_ns > newest.end_ns:
        return Place(newest.shift_ns)
    has_gone_back = received_ns < (newest_received_ns or newest.end_ns)
    is_ahead = end_ns > received_ns + _LEAST_AHEAD_NS  # stamped before the clock went back
    if is_live or (has_gone_back and not is_ahead):
        return Place(shift_ns)
    if not estimate.valid:
        # A failure counts at any time, but later tests of its recording stay unordered.
        return Place(shift_ns, is_ordered=False)
    return Place(shift_ns, _problem(end_ns, newest))


def is_after_step(test: Test, before: Test, by_clock: bool) -> bool:
    """Return whether the clock was set back between a test and the test ``before`` it.

    In that case, their stamps do not give the time between them. If ``by_clock``, the stamps come
    from a clock, and a step changes their correction. Otherwise tests are ordered by reception, and
    a step sets the stamp of ``test`` to the first nanosecond after ``before``.
    """
    if by_clock:
        return test.shift_ns != before.shift_ns
    return test.stamp_ns == before.stamp_ns + 1


def since_clock_step_ns(tests: Sequence[Test], from_ns: int, by_clock: bool) -> int:
    """Return the time of the first test after the latest clock step, at least ``from_ns`` [ns]."""
    after = None
    for test in reversed(tests):
        if test.verdict == Verdict.SKIPPED:
            continue
        if after is not None and is_after_step(after, test, by_clock):
            return after.stamp_ns
        if test.stamp_ns < from_ns:
            break
        after = test
    return from_ns


def moved(estimate: Estimate, shift_ns: int) -> Estimate:
    """Return an estimate with its stamps shifted by ``shift_ns`` [ns]."""
    if not shift_ns:
        return estimate
    return replace(
        estimate, start_ns=estimate.start_ns + shift_ns, end_ns=estimate.end_ns + shift_ns
    )


def is_same(test: Test, estimate: Estimate) -> bool:
    """Return whether a test in a history and an estimate come from the same window."""
    if test.end_ns != estimate.end_ns:
        return False
    if isinstance(test, UnusedCycle):
        before, again = ((item.verdict, codes(item.reasons)) for item in (test, estimate))
        return not estimate.valid and before == again
    if not estimate.valid:
        return False
    stored = test.estimate
    change = np.subtract(estimate.faults, stored.faults)
    change[ECCENTRICITY_PHASE] -= np.round(change[ECCENTRICITY_PHASE])
    return not np.any(np.abs(change) > SAME_TEST_SIGMAS * np.hypot(estimate.sigma, stored.sigma))


def _problem(end_ns: int, newest: Test) -> OrderUnknown:
    return OrderUnknown((newest.end_ns - end_ns) * 1e-9)
