# SPDX-License-Identifier: Apache-2.0
"""Sentences for events, in messages, logs, tables and pages."""

from collections.abc import Callable
from typing import Any, Final

import ema_monitor.prognosis.events as of
from ema_core.dates import utc_minute
from ema_core.labels import label_of
from ema_core.wording import counted
from ema_monitor.joint.wording import finding
from ema_monitor.prognosis.events import Occurrence, UnitEvent
from ema_monitor.prognosis.sentences import fault_text, recurrence_text
from ema_monitor.reason_texts import joined


def text_of(occurrence: Occurrence) -> str:
    """Return the sentence of an occurrence, without its kind and a final full stop."""
    return _TEXTS[type(occurrence)](occurrence)


def event_text(event: UnitEvent) -> str:
    """Return kind and sentence of an event."""
    return f"{label_of(event.kind)}: {text_of(event.occurrence)}"


def _values_disagree(event: of.ValuesDisagree) -> str:
    return (
        f"{label_of(event.component)} {event.before:.3f} at {event.before_hours:.1f} h and "
        f"{event.after:.3f} at {event.hours:.1f} h disagree; waiting for the next test"
    )


def _value_unexpected(event: of.ValueUnexpected) -> str:
    return (
        f"{label_of(event.component)} {event.value:.3f} at {event.hours:.1f} h where "
        f"{event.expected:.3f} ± {event.sigma:.3f} was expected; held back until the next test"
    )


def _value_changed(event: of.ValueChanged) -> str:
    verb = "fell" if event.is_smaller else "rose"
    text = (
        f"{label_of(event.component)} {verb} from {event.before:.3f} to {event.after:.3f}, "
        "confirmed by the next test"
    )
    if event.is_new_baseline:
        return f"the baseline changed, so that values relate to a new healthy state: {text}"
    return text


def _unit_departed(event: of.UnitDeparted) -> str:
    return joined(event.reasons) if event.comparison is None else finding(event.comparison)


def _late_test_used(event: of.LateTestUsed) -> str:
    return (
        f"a test arrived late, {event.late_s:g} s older than the latest test: it is used for "
        "growth; the latest test determines the level"
    )


def _count_ignored(event: of.CountIgnored) -> str:
    return (
        f"usage is ignored, {event.hours:g} h: hours_per_cycle = {event.hours_per_cycle:g} h is set"
    )


def _uncounted_dropped(event: of.UncountedDropped) -> str:
    return (
        f"counted from now on: {_tests(event.tests)} before, with hours from hours_per_cycle, "
        "left out"
    )


def _count_not_confirmed(event: of.CountNotConfirmed) -> str:
    return (
        f"{event.hours:g} h at test {event.cycle} not confirmed by the next count, "
        f"{event.next_hours:g} h: interpolated instead"
    )


def _count_confirmed(event: of.CountConfirmed) -> str:
    text = f"set from {event.before:g} h to {event.after:g} h"
    if event.dropped:
        text += f": {_tests(event.dropped)} at more than {event.held:g} h left out"
    return text


def _tests(count: int) -> str:
    return "the test" if count == 1 else f"the {count} tests"


def _baseline_changed(event: of.BaselineChanged) -> str:
    shown = ", ".join(f"{label_of(name)} {value:.3f}" for name, value in event.faults)
    time = f", {utc_minute(event.time_ns)}" if event.time_ns else ""
    if not event.after:
        forced = " (forced)" if event.is_forced else ""
        text = f"{event.person or '~/calibrate'} reset the baseline {event.before}{forced}{time}"
        return f"{text}; the unit showed {shown}" if shown else text
    forced = ", forced" if event.is_forced else ""
    return (
        f"baseline changed by {event.person or '~/calibrate'}{forced}{time}: {event.after} "
        f"instead of {event.before}, which showed {shown or 'no fault above 5 % of its limit'}"
    )


def _note(event: of.Note) -> str:
    return (
        f"{event.person}, {f'{utc_minute(event.time_ns)}: ' if event.time_ns else ''}{event.text}"
    )


_TEXTS: Final[dict[type[Occurrence], Callable[[Any], str]]] = {
    of.ValuesDisagree: _values_disagree,
    of.ValueUnexpected: _value_unexpected,
    of.ValueChanged: _value_changed,
    of.AlarmRaised: lambda event: fault_text(event.item),
    of.FaultRecurred: lambda event: recurrence_text(event.name, event.recurrence),
    of.UnitFailed: lambda event: joined(event.reasons),
    of.UnitDeparted: _unit_departed,
    of.EstimatesMissing: lambda event: (
        f"{counted(event.tests, 'test')} without a valid estimate before this test"
    ),
    of.DuplicateIgnored: lambda _: "duplicate test ignored: it is already in the history",
    of.LateTestUsed: _late_test_used,
    of.CountIgnored: _count_ignored,
    of.UncountedDropped: _uncounted_dropped,
    of.CountNotConfirmed: _count_not_confirmed,
    of.CountConfirmed: _count_confirmed,
    of.MonitorStarted: lambda event: (
        f"the monitor started and read {counted(event.tests, 'valid test')}"
    ),
    of.HistoryDamaged: lambda event: event.problem,
    of.CalibrationReplaced: lambda event: f"{event.after} instead of {event.before}",
    of.BaselineChanged: _baseline_changed,
    of.Note: _note,
}
