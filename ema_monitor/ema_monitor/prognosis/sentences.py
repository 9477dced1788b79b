# SPDX-License-Identifier: Apache-2.0
"""Sentences on health and remaining life for maintenance planners."""

import math
from typing import Final

from ema_core.labels import label_of
from ema_core.levels import ERROR, LEVEL_NAMES, OK, WARN
from ema_core.wording import beside_limit, counted
from ema_monitor.health import FaultHealth, Recurrence
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.requirements.requirements import RequirementLimits

TREND_HOURS: Final = 1000.0
"""Hours over which growth is displayed [h]."""

SOON_HOURS: Final = 0.5
"""Time to a removal below which the advice is to remove the unit now [h]."""

_NAMED_CAUSES: Final = 3


def shown_in(unit: str) -> tuple[str, float]:
    """Return the unit suffix and the scale factor for displaying a value; no suffix for "1"."""
    return {"rad": (" mrad", 1e3), "1": ("", 1.0)}.get(unit, (f" {unit}", 1.0))


def cause_of_level(outlook: Outlook) -> str:
    """Return the reasons for the health level, with values and limits; empty if it is OK."""
    health = outlook.health
    if outlook.failure:
        return outlook.failure
    if health.level not in (WARN, ERROR):
        return "" if health.level == OK else health.reason or outlook.rul.reason
    every = (*health.faults, *health.requirements)
    items = [item for item in every if item.level == health.level or math.isfinite(item.held)]
    if not items:
        return outlook.departure or health.reason
    items.sort(key=lambda item: (-item.level, item.name != outlook.dominant_fault))
    causes = [fault_text(item) for item in items[:_NAMED_CAUSES]]
    more = len(items) - len(causes)
    text = ", ".join(causes) + (f" and {more} more" if more else "")
    return "; ".join(filter(None, [text, outlook.departure]))


def fault_text(item: FaultHealth) -> str:
    """Return a phrase with value and limit of a fault or requirement in WARN or ERROR."""
    unit, scale = shown_in(RequirementLimits.unit(item.name))
    side = "below" if item.limit_is_lower else "above"
    value, limit = beside_limit(scale * item.value, scale * item.limit)
    ends = f"failed: {side} {limit}{unit}"
    if item.level != ERROR:
        ends = f"warns {side} {scale * item.warn_limit:.3g}{unit}, fails {side} {limit}{unit}"
    if item.recurrence is not None:
        return f"{recurrence_text(item.name, item.recurrence)} ({ends})"
    if math.isfinite(item.held):
        held = scale * item.held
        return (
            f"{label_of(item.name)} {held:.3g}{unit} in the latest test, to be confirmed by the "
            f"next test, {value}{unit} before ({ends})"
        )
    text = f"{label_of(item.name)} {value}{unit} ({ends})"
    if item.unconfirmed is not None:
        text += f", {LEVEL_NAMES[item.unconfirmed]} once the next test confirms it"
    return text


def recurrence_text(name: str, recurrence: Recurrence) -> str:
    """Return a sentence on an intermittent fault or a single occurrence.

    The sentence includes what ends the warning.
    """
    latest = f"the latest {recurrence.tests} tests"
    if recurrence.tests_left:
        return (
            f"{label_of(name)} was beyond its limit in one of {latest}: "
            f"{counted(recurrence.tests_left, 'more test')} without it, or a person's note on its "
            "event, end the warning"
        )
    often = f"in {recurrence.times} of {latest}"
    if not recurrence.times:
        often = f"repeatedly, but not in {latest}"
    return (
        f"{label_of(name)} is intermittent: beyond its limit {often}; a person's note on its event "
        "acknowledges it"
    )


def failures_text(reason: str, recurrence: Recurrence) -> str:
    """Return a sentence on an intermittent failure and on how to acknowledge it.

    Parameters
    ----------
    reason
        Reason of the latest test that failed; empty if unknown.
    recurrence
        Recurrence of the failure.
    """
    latest_tests = f"the latest {recurrence.tests} tests"
    often = f"{recurrence.times} of {latest_tests} failed"
    if not recurrence.times:
        often = f"tests failed repeatedly, but none of {latest_tests}"
    text = f"an intermittent failure: {often}"
    latest = f", the latest by {reason}" if reason else ""
    return f"{text}{latest}; a person's note on its event acknowledges it"


def reason_of(outlook: Outlook) -> str:
    """Return the reasons stated by the health and the remaining life, joined; may be empty."""
    return "; ".join(dict.fromkeys(filter(None, [outlook.health.reason, outlook.rul.reason])))


def removal_text(outlook: Outlook) -> str:
    """Return a sentence with the latest time to remove a unit, and the reason."""
    if outlook.failure:
        return f"Remove now: {outlook.failure}"
    life, hours = outlook.rul, outlook.flight_hours
    items = (*outlook.health.faults, *outlook.health.requirements)
    failed = [item.name for item in items if item.level == ERROR]
    if failed:
        since = ""
        if math.isfinite(outlook.failed_since):
            since = f" since {outlook.failed_since:,.0f} h (now {hours:,.0f} h)"
        criteria = [outlook.lives.get(name, life).criterion or label_of(name) for name in failed]
        return f"Remove now: failed{since}: {', '.join(criteria)}"
    if not life.known:
        return f"No removal date yet: {life.reason}"
    end = "beyond the horizon"
    if math.isfinite(life.hours_50):
        end = f"{hours + life.hours_50:,.0f} h"
    removal = outlook.removal
    when = f"before {hours + removal.hours:,.0f} service hours"
    if removal.hours < SOON_HOURS:
        when = "now"
    span = [f"in {removal.hours:,.0f} h"]
    if math.isfinite(removal.cycles):
        span.append(f"{removal.cycles:,.0f} test cycles")
    if math.isfinite(removal.days):
        span.append(f"{removal.days:,.0f} days at {removal.hours_a_day:.3g} h a day")
    return (
        f"Remove {when} ({', '.join(span)}; {100 * removal.risk:.3g} % risk of failure until "
        f"then); median end of life {end}: {life.criterion}"
    )
