# SPDX-License-Identifier: Apache-2.0
"""Conversion of outlooks to assessments, which the history stores."""

from collections.abc import Iterable

from ema_core.levels import ERROR, WARN
from ema_monitor.prognosis.events import AlarmRaised, Occurrence, UnitEvent
from ema_monitor.prognosis.history_entry import Assessment
from ema_monitor.prognosis.outlook import Outlook


def assessment_of(
    outlook: Outlook,
    before: Assessment | None,
    occurrences: Iterable[Occurrence],
    events: Iterable[UnitEvent],
) -> Assessment:
    """Return the assessment of an outlook, with events for faults and requirements that got worse.

    If ``before`` is an assessment of the same test, its events are kept.

    Parameters
    ----------
    outlook
        Outlook after a test.
    before
        Assessment of the previous test, or an earlier assessment of the same test, if any.
    occurrences
        Occurrences that the test shows.
    events
        Additional events.
    """
    health, rul = outlook.health, outlook.rul
    items = (*health.faults, *health.requirements)
    alarms = [item for item in items if item.level in (WARN, ERROR)]
    earlier = before.alarms if before else {}
    raised = [AlarmRaised(item) for item in alarms if item.level > earlier.get(item.name, 0)]
    stamp_ns, hours = outlook.stamp_ns, outlook.flight_hours
    # If a test is reassessed, keep its original events.
    kept = before.events if before and before.stamp_ns == stamp_ns else ()
    return Assessment(
        stamp_ns,
        hours,
        health.level,
        health.health_index,
        outlook.dominant_fault,
        (rul.hours_05, rul.hours_50, rul.hours_95) if rul.known else None,
        {item.name: item.level for item in alarms},
        (*kept, *events, *(UnitEvent(stamp_ns, hours, each) for each in (*occurrences, *raised))),
        {item.name: item.unconfirmed for item in alarms if item.unconfirmed is not None},
    )
