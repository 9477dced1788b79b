# SPDX-License-Identifier: Apache-2.0
"""Levels and departures of earlier tests in the outlook of the newest test."""

import math
from dataclasses import replace
from itertools import islice

from ema_core.levels import ERROR, OK, STALE
from ema_monitor.health import warned
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.confirmation import confirmed
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.quantities import FRICTION


def with_unconfirmed_levels(outlook: Outlook, history: History, confirmations: int) -> Outlook:
    """Return the outlook with earlier levels and departures, until tests confirm their end.

    Parameters
    ----------
    outlook
        Outlook after the newest valid test.
    history
        Tests so far.
    confirmations
        Number of consecutive tests that confirm the end. Records of a joint that neither show a
        departure nor determine the friction do not count.
    """
    newest = history.entries[-1].estimate
    earlier = (entry for entry in reversed(history.entries[:-1]) if _counts(entry.estimate))
    assessments = (history.assessments.get(entry.stamp_ns) for entry in earlier)
    outlook = confirmed(outlook, islice(filter(None, assessments), confirmations - 1))
    if newest.comparison is None or outlook.health.level != OK:
        return outlook
    judged = filter(_is_judged, (entry.estimate for entry in reversed(history.entries)))
    latest = islice(judged, confirmations)
    departure = next((estimate.departure for estimate in latest if estimate.departure), "")
    if not departure:
        return outlook
    text = f"{departure}, in an earlier record: the next record must confirm that it has ended"
    return replace(outlook, health=warned(outlook.health), departure=text)


def last_level(outlook: Outlook, history: History) -> int:
    """Return the last known level before a STALE outlook; STALE if there is none.

    The result is also STALE if the outlook is not STALE.
    """
    if outlook.health.level == STALE:
        for entry in reversed(history.entries):
            assessment = history.assessments.get(entry.stamp_ns)
            is_earlier = entry.stamp_ns < outlook.stamp_ns
            if is_earlier and assessment is not None and assessment.level != STALE:
                return assessment.level
    return STALE


def failed_since(outlook: Outlook, history: History) -> float:
    """Return the service hour at which the current run of tests with ERROR began [h].

    The result is NaN if the level is not ERROR.
    """
    if outlook.health.level != ERROR:
        return math.nan
    since = outlook.flight_hours
    for entry in reversed(history.entries):
        if entry.stamp_ns != outlook.stamp_ns:
            assessment = history.assessments.get(entry.stamp_ns)
            if assessment is None or assessment.level != ERROR:
                break
            since = assessment.flight_hours
    return since


def _counts(estimate: Estimate) -> bool:
    """Return whether a test counts towards the confirmation of a lower level."""
    return estimate.comparison is None or _is_judged(estimate)


def _is_judged(estimate: Estimate) -> bool:
    """Return whether a record shows a departure or determines the friction."""
    compared = estimate.comparison
    return compared is not None and (compared.has_departed or compared[FRICTION].is_judged)
