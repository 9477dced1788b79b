# SPDX-License-Identifier: Apache-2.0
"""Events about changes of a unit's calibration."""

import math
from collections.abc import Iterable
from typing import Final

from ema_monitor.health import FaultHealth
from ema_monitor.prognosis.events import BaselineChanged, CalibrationReplaced, UnitEvent
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.outlook import Outlook

SHOWN_SHARE: Final = 0.05
"""Share of its limit above which a fault is named in the event of a baseline change [-]."""


def baseline_change(
    calibration_id: str,
    history: History,
    faults: Iterable[FaultHealth],
    person: str,
    time_ns: int,
    *,
    is_forced: bool,
) -> UnitEvent:
    """Return the event of a calibration change by a person.

    Parameters
    ----------
    calibration_id
        Identity of the new calibration; empty after a reset.
    history
        Tests of the unit, with at least one valid test.
    faults
        Health of the faults after the newest valid test; empty if unknown.
    person, time_ns, is_forced
        See `BaselineChanged`.
    """
    newest = history.entries[-1]
    shown = ((item.name, float(item.value)) for item in faults if item.share > SHOWN_SHARE)
    before = _baseline(newest)
    change = BaselineChanged(person, time_ns, is_forced, before, calibration_id, tuple(shown))
    assessment = history.assessments.get(newest.stamp_ns)
    hours = assessment.flight_hours if assessment else math.nan
    return UnitEvent(newest.stamp_ns, hours, change)


def other_calibration(outlook: Outlook, history: History) -> list[UnitEvent]:
    """Return the event of a calibration change between the two newest tests, as a list.

    The list is empty if the calibration is the same, or if the newest test was assessed before.
    """
    entries = history.entries
    if len(entries) < 2 or outlook.stamp_ns in history.assessments:
        return []
    old, new = map(_baseline, entries[-2:])
    if old == new:
        return []
    return [UnitEvent(outlook.stamp_ns, outlook.flight_hours, CalibrationReplaced(old, new))]


def worn_baseline(history: History) -> BaselineChanged | None:
    """Return the change to the current baseline if the unit showed faults at that time, or None."""
    newest = _baseline(history.entries[-1])
    earlier = (entry for entry in reversed(history.entries) if _baseline(entry) != newest)
    before = next(earlier, None)
    assessment = history.assessments.get(before.stamp_ns) if before else None
    events = assessment.events if assessment else ()
    changes = (event.occurrence for event in reversed(events))
    return next(
        (
            change
            for change in changes
            if isinstance(change, BaselineChanged) and change.faults and change.after == newest
        ),
        None,
    )


def _baseline(entry: Entry) -> str:
    return entry.estimate.calibration_id
