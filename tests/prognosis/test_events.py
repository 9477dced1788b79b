# SPDX-License-Identifier: Apache-2.0
"""Events are values with fields: each has a sentence, and comes back from JSON and an archive."""

import json
import math
import re
from dataclasses import fields, replace
from typing import Any

import pytest
from tests.monitor.comparisons import changed, comparison

from ema_archive.history_rows import history_from, kept_history
from ema_core.event_kinds import MOST_COUNT, EventKind
from ema_core.levels import WARN
from ema_monitor.health import FaultHealth, Recurrence
from ema_monitor.prognosis.event_texts import event_text, text_of
from ema_monitor.prognosis.events import (
    OCCURRENCES,
    AlarmRaised,
    BaselineChanged,
    CountConfirmed,
    EstimatesMissing,
    Note,
    Occurrence,
    UnitDeparted,
    UnitEvent,
    ValueChanged,
)
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Assessment, assessment_text, read_assessment
from ema_monitor.quantities import FRICTION
from ema_monitor.reasons import NotMeasured
from ema_monitor.reports import EventReport

_TIME_NS = 1_795_914_720_000_000_000
_RECURRENCE = Recurrence(2, 20, 0.1 + 0.2, 4)
_ITEM = FaultHealth(
    "friction", WARN, 0.3, 0.01, 0.5, 0.25, False, 0.6, unconfirmed=0, recurrence=_RECURRENCE
)
_VALUES: dict[str, Any] = {
    "component": "friction",
    "name": "friction",
    "faults": (("friction", 0.1 + 0.2), ("backlash", 0.2)),
    "item": _ITEM,
    "recurrence": _RECURRENCE,
    "reasons": (NotMeasured("speed"),),
    "comparison": None,
}


def made(code: str) -> Occurrence:
    """An occurrence with a value in each of its fields."""
    by_type = {float: 0.1 + 0.2, int: 3, bool: True, str: "some text"}
    kind = OCCURRENCES[code]
    return kind(**{i.name: _VALUES.get(i.name, by_type.get(i.type)) for i in fields(kind)})


@pytest.mark.parametrize("code", OCCURRENCES)
def test_each_occurrence_has_a_sentence_and_a_kind(code: str):
    occurrence = made(code)
    text = text_of(occurrence)
    assert text
    assert not re.search(r"[{}<]|None|event\.", text)
    kind = occurrence.kind.replace("_", " ")
    assert event_text(UnitEvent(0, 1.0, occurrence)) == f"{kind}: {text}"
    assert occurrence.kind in EventKind
    assert " " not in occurrence.kind


@pytest.mark.parametrize("code", OCCURRENCES)
def test_each_occurrence_comes_back_from_json(code: str):
    occurrence = made(code)
    record = json.loads(json.dumps(occurrence.as_record(), allow_nan=False))
    again = Occurrence.of_record(record)
    # NaN differs from itself.
    assert repr(again) == repr(occurrence)


def test_departure_keeps_its_comparison():
    departed = UnitDeparted((), comparison(changed(FRICTION, 0.4)))
    record = json.loads(json.dumps(departed.as_record(), allow_nan=False))
    again = Occurrence.of_record(record)
    assert repr(again) == repr(departed)
    assert text_of(again) == text_of(departed)


def test_unknown_occurrence_is_refused_by_name():
    with pytest.raises(ValueError, match="code = 'flown_away': expected one of values_disagree"):
        Occurrence.of_record({"code": "flown_away"})


def test_change_of_a_value_has_the_kind_of_its_direction():
    changes = [
        ValueChanged("friction", 0.1, 0.2, 10.0, is_smaller, is_new_baseline)
        for is_smaller, is_new_baseline in ((False, False), (True, False), (True, True))
    ]
    assert [change.kind for change in changes] == ["step", "repair", "calibration"]
    assert text_of(changes[0]) == ("friction rose from 0.100 to 0.200, confirmed by the next test")
    assert text_of(replace(changes[1], component="short_circuit_a")).startswith(
        "short circuit A fell from 0.100 to 0.200"
    )
    assert text_of(changes[2]).startswith("the baseline changed, so that values relate to a new ")


def test_change_and_note_state_their_author_and_time_to_the_minute():
    change = BaselineChanged("Ada", _TIME_NS, True, "first", "second", ())
    assert text_of(change).startswith(
        "baseline changed by Ada, forced, 2026-11-29 01:12 UTC: second instead of first, which "
    )
    unknown = replace(change, person="", time_ns=0, is_forced=False)
    assert text_of(unknown).startswith("baseline changed by ~/calibrate: second instead of first")
    reset = replace(change, after="", before="4711-ab")
    assert text_of(reset) == "Ada reset the baseline 4711-ab (forced), 2026-11-29 01:12 UTC"
    worn = replace(reset, is_forced=False, time_ns=0, faults=(("friction", 0.3),))
    assert text_of(worn) == "Ada reset the baseline 4711-ab; the unit showed friction 0.300"
    note = Note("Ada", "greased", _TIME_NS)
    assert text_of(note) == "Ada, 2026-11-29 01:12 UTC: greased"
    assert text_of(replace(note, time_ns=0)) == "Ada, greased"


def test_archive_keeps_every_field_of_an_event():
    occurrences = [
        AlarmRaised(_ITEM),
        BaselineChanged("Ada", _TIME_NS, True, "first", "second", (("friction", 0.3),)),
        Note("Ada", 'greased "all"', _TIME_NS),
        CountConfirmed(10.0, 5.0),
        EstimatesMissing(2),
        UnitDeparted((NotMeasured("speed"),)),
    ]
    events = tuple(UnitEvent(7, math.nan, occurrence) for occurrence in occurrences)
    assessment = Assessment(7, 10.0, WARN, 0.5, "friction", None, {"friction": WARN}, events)
    history = History("flap", "A")
    history.assess(assessment)
    again = history_from(kept_history(history, b"", "", "", 0), ("flap", "A"), [])
    assert repr(again.assessments) == repr(history.assessments)
    assert repr(read_assessment(assessment_text(assessment))) == repr(assessment)


def test_count_of_an_event_fits_the_message():
    reports = [EventReport.of(UnitEvent(7, 1.0, EstimatesMissing(n))) for n in (0, 3, 10**12)]
    assert [report.count for report in reports] == [0, 3, MOST_COUNT]
    assert EventReport.of(UnitEvent(7, 1.0, CountConfirmed(10.0, 5.0, 4))).count == 4
    assert EventReport.of(UnitEvent(7, 1.0, Note("Ada", "3 times", 0))).count == 0
