# SPDX-License-Identifier: Apache-2.0
"""Confirmation of levels: a level only falls after several consecutive tests at the lower level."""

import math
from collections.abc import Iterable
from dataclasses import replace

from ema_core.levels import ERROR, OK, STALE, WARN
from ema_monitor.health import FaultHealth, warned, worst_of
from ema_monitor.prognosis.history_entry import Assessment
from ema_monitor.prognosis.outlook import Outlook


def confirmed(outlook: Outlook, earlier: Iterable[Assessment]) -> Outlook:
    """Return an outlook whose levels are not below the levels that the earlier tests showed.

    A STALE outlook is returned unchanged. Levels rise immediately. They fall once the newest test
    and all ``earlier`` tests show the lower level.

    Parameters
    ----------
    outlook
        Outlook after the newest test.
    earlier
        Assessments of the preceding tests that must confirm a lower level.
    """
    if outlook.health.level == STALE:
        return outlook
    before: dict[str, int] = {}
    for assessment in earlier:
        for name, level in assessment.alarms.items():
            shown = assessment.unconfirmed.get(name, level)
            before[name] = max(before.get(name, OK), shown)
    health = outlook.health
    faults, requirements = (
        tuple(_confirmed(item, before.get(item.name, OK)) for item in items)
        for items in (health.faults, health.requirements)
    )
    if (faults, requirements) == (health.faults, health.requirements):
        return outlook
    worst, of_fault = worst_of((*faults, *requirements)), worst_of(faults)
    health = replace(health, faults=faults, requirements=requirements)
    if worst is None or worst.level == OK:
        return replace(outlook, health=health)
    if not health.dominant_fault and of_fault is not None and of_fault.level != OK:
        health = replace(health, dominant_fault=of_fault.name)
    health = warned(replace(health, level=max(health.level, worst.level)))
    return replace(outlook, health=health, dominant_fault=outlook.dominant_fault or worst.name)


def _confirmed(item: FaultHealth, before: int) -> FaultHealth:
    """Return the item, with its level raised to the level of earlier tests if they were worse."""
    if item.level == STALE:
        return item
    level, shown = max(item.level, before), min(_level_of_test(item), item.level)
    unconfirmed = shown if shown < level else None
    if (level, unconfirmed) == (item.level, item.unconfirmed):
        return item  # in Python 3.13, a copy with a NaN would be unequal
    return replace(item, level=level, unconfirmed=unconfirmed)


def _level_of_test(item: FaultHealth) -> int:
    """Return the level according to the newest test, even if its value is held back."""
    if not math.isfinite(item.held):
        return item.level
    sign = -1.0 if item.limit_is_lower else 1.0
    if sign * (item.held - item.limit) > 0.0:
        return ERROR
    return WARN if sign * (item.held - item.warn_limit) > 0.0 else OK
