"""An outlook as the history keeps it, with the events that a test reveals."""

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
    """Return an outlook as it is kept, with an event for each fault whose level got worse.

    ``before`` is the assessment of the previous test, or an earlier one of the same test.
    ``findings`` belong to the test, ``events`` to other times.
    """
    health, rul = outlook.health, outlook.rul
    items = [one for one in (*health.faults, *health.requirements) if one.level in (WARN, ERROR)]
    known = before.alarms if before else {}
    all_findings = list(findings)
    all_findings += [
        Finding(FAULT, in_words(one)) for one in items if one.level > known.get(one.name, 0)
    ]
    stamp_ns, hours = outlook.stamp_ns, outlook.hours
    # A test that is assessed again keeps its first events.
    kept = before.events if before and before.stamp_ns == stamp_ns else ()
    return Assessment(
        stamp_ns,
        hours,
        health.level,
        health.health_index,
        outlook.dominant,
        (rul.hours_05, rul.hours_50, rul.hours_95) if rul.known else None,
        {one.name: one.level for one in items},
        (*kept, *events, *(UnitEvent(stamp_ns, hours, *one) for one in all_findings)),
        {one.name: one.unconfirmed for one in items if one.unconfirmed is not None},
    )
