# SPDX-License-Identifier: Apache-2.0
"""Conversion of outlooks to assessments, which the history stores."""

from collections.abc import Iterable

from ema_core.levels import ERROR, WARN
from ema_monitor.prognosis.history_entry import FAULT, Assessment, Finding, UnitEvent
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.sentences import in_words


def assessment_of(
    outlook: Outlook,
    before: Assessment | None,
    findings: Iterable[Finding],
    events: Iterable[UnitEvent],
) -> Assessment:
    """Return the assessment of an outlook, with an event for each fault whose level rose.

    Parameters
    ----------
    outlook
        Outlook after a test.
    before
        Assessment of the previous test, or an earlier assessment of the same test, if any.
    findings
        Findings of the test.
    events
        Additional events.
    """
    health, rul = outlook.health, outlook.rul
    items = (*health.faults, *health.requirements)
    alarms = [item for item in items if item.level in (WARN, ERROR)]
    earlier = before.alarms if before else {}
    all_findings = list(findings)
    all_findings += [
        Finding(FAULT, in_words(item)) for item in alarms if item.level > earlier.get(item.name, 0)
    ]
    stamp_ns, hours = outlook.stamp_ns, outlook.hours
    # If a test is reassessed, keep its original events.
    kept = before.events if before and before.stamp_ns == stamp_ns else ()
    return Assessment(
        stamp_ns,
        hours,
        health.level,
        health.health_index,
        outlook.dominant,
        (rul.hours_05, rul.hours_50, rul.hours_95) if rul.known else None,
        {item.name: item.level for item in alarms},
        (*kept, *events, *(UnitEvent(stamp_ns, hours, *finding) for finding in all_findings)),
        {item.name: item.unconfirmed for item in alarms if item.unconfirmed is not None},
    )
