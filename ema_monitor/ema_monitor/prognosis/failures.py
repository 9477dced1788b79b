# SPDX-License-Identifier: Apache-2.0
"""Failures of earlier tests in the outlook of the newest test."""

from dataclasses import replace
from heapq import nlargest

from ema_monitor.health import Recurrence, warned
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Entry, UnusedCycle
from ema_monitor.prognosis.intermittent import LATEST_TESTS
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.sentences import failures_text


def with_earlier_failure(
    outlook: Outlook, history: History, recurrence: Recurrence | None, confirmations: int
) -> Outlook:
    """Return the outlook with an earlier failure, which persists until tests confirm its end.

    An outlook without such a failure is returned unchanged.

    Parameters
    ----------
    outlook
        Outlook from the valid tests.
    history
        All tests of the unit.
    recurrence
        Recurrence of an intermittent failure, which a person must acknowledge; else None.
    confirmations
        Number of consecutive tests that confirm the end.
    """
    judged = (test for test in history.tests if isinstance(test, Entry) or history.has_failed(test))
    latest = nlargest(max(confirmations, LATEST_TESTS), judged, key=lambda test: test.stamp_ns)
    failed = ((i, test.reason) for i, test in enumerate(latest) if isinstance(test, UnusedCycle))
    tests_since, reason = next(failed, (len(latest), ""))
    if recurrence is not None:
        text = failures_text(reason, recurrence)
    elif reason and tests_since < confirmations:
        text = f"{reason}, in an earlier test: the next test must confirm that it has ended"
    else:
        return outlook
    departure = "; ".join(filter(None, [outlook.departure, text]))
    return replace(outlook, health=warned(outlook.health), departure=departure)
