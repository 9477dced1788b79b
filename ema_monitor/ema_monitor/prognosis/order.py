"""The place of a test among the tests of its unit: by its stamp, or by its reception."""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from ema_core.faults import ECCENTRICITY_PHASE
from ema_monitor.identification.estimate import SKIPPED, Estimate
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Test, UnusedCycle
from ema_monitor.reasons import OrderUnknown, codes

SAME_TEST_SIGMAS: Final = 4.0
"""Standard deviations by which a fault of the same test identified again never differs."""


_LEAST_AHEAD_NS: Final = 1_000_000_000


class Place(NamedTuple):
    """Where a test belongs."""

    shift_ns: int = 0
    """What its stamp is moved by to be behind all earlier tests [ns]."""
    problem: OrderUnknown | None = None
    """Why it is not known which test came first; None if it is known."""
    is_known: bool = False
    """Whether the test is in the history already."""


def place_of(
    estimate: Estimate,
    history: History,
    received_ns: int,
    newest_received_ns: int,
    by_clock: bool,
    is_live: bool = False,
) -> Place:
    """Return the place of a test among the tests of its unit.

    The stamp gives it. If the stamp is not later than the newest one, the order of reception gives
    it where the clock went back: the clock of the receiver is behind the reception of the newest
    test. So it does for a test that was received while it was measured. Otherwise the order is not
    known. A test of a recording has the place of its stamp, unless
    another test has the same stamp.

    Parameters
    ----------
    estimate
        The test.
    history
        Tests so far.
    received_ns
        When the test was received, by the clock of the receiver [ns]; 0 for a recording.
    newest_received_ns
        When the newest test so far was received [ns]; 0 if that is not known.
    by_clock
        Whether stamps are of a clock; otherwise the order of reception always counts.
    is_live
        Whether the test was received while it was measured.
    """
    newest, end_ns = history.newest, estimate.end_ns
    if received_ns and not by_clock:
        date_ns = max(received_ns, newest.stamp_ns + 1 if newest else 0)
        return Place(date_ns - end_ns)
    if newest is None or end_ns > newest.stamp_ns or estimate.verdict == SKIPPED:
        return Place()
    if any(is_same(test, estimate) for test in reversed(history.tests)):
        return Place(is_known=True)
    if isinstance(newest, UnusedCycle) and newest.stamp_ns == end_ns and estimate.valid:
        return Place()  # the same window, which has an estimate in the second attempt
    shift_ns = newest.stamp_ns + 1 - end_ns
    if not received_ns:
        is_other = estimate.valid and history.holds_valid(end_ns)
        return Place(shift_ns, _problem(end_ns, newest)) if is_other else Place()
    is_ordered = not isinstance(newest, UnusedCycle) or newest.is_ordered
    if newest.shift_ns and is_ordered and end_ns > newest.end_ns:
        return Place(newest.shift_ns)
    has_gone_back = received_ns < (newest_received_ns or newest.end_ns)
    is_ahead = end_ns > received_ns + _LEAST_AHEAD_NS  # stamped before the clock went back
    if is_live or (has_gone_back and not is_ahead) or not estimate.valid:
        # A failure is a failure, whenever it was.
        return Place(shift_ns)
    return Place(shift_ns, _problem(end_ns, newest))


def is_after_step(test: Test, before: Test, by_clock: bool) -> bool:
    """Return whether a clock went back between a test and the one before it.

    The time between both is then not known from their stamps.
    """
    if by_clock:
        return test.shift_ns != before.shift_ns
    return test.stamp_ns == before.stamp_ns + 1


def moved(estimate: Estimate, shift_ns: int) -> Estimate:
    """Return an estimate whose stamps are moved [ns]."""
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
        before, again = ((one.verdict, codes(one.reasons)) for one in (test, estimate))
        return not estimate.valid and before == again
    if not estimate.valid:
        return False
    known = test.estimate
    far = np.subtract(estimate.faults, known.faults)
    far[ECCENTRICITY_PHASE] -= np.round(far[ECCENTRICITY_PHASE])
    return not np.any(np.abs(far) > SAME_TEST_SIGMAS * np.hypot(estimate.sigma, known.sigma))


def _problem(end_ns: int, newest: Test) -> OrderUnknown:
    return OrderUnknown((newest.end_ns - end_ns) * 1e-9)
