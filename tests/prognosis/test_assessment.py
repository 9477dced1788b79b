"""What was found after each test is kept with it, and survives a restart."""

import math
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from ema_core.levels import ERROR, OK, WARN
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import (
    Assessment,
    UnitEvent,
    assessment_text,
    read_assessment,
)
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .kept_histories import UNIT, entry
from .made_tests import SIGMA, made_test

SETTINGS = PrognosisSettings(service=Service(hours_per_cycle=10.0))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "flap.sqlite"


def assessment(number: int, level: int = OK) -> Assessment:
    return Assessment(entry(number).stamp_ns, 10.0 * number, level, 0.9, "", (1.0, 2.0, math.inf))


def lived(path: Path | None, frictions: list[float], first: int = 0) -> tuple[Unit, Outlook]:
    """A unit with more tests, from the number ``first`` on, in the history at a path."""
    unit = Unit(History(*UNIT, path), SETTINGS, opened_ns=123)
    outlook = None
    for number, friction in enumerate(frictions, first):
        outlook = unit.update(made_test(number, friction=friction), None, SETTINGS)
    unit.history.close()
    assert outlook is not None
    return unit, outlook


@pytest.mark.parametrize("hours", [1.0, 50.0])
def test_level_of_a_healthy_unit_is_as_sharp_as_its_tests(hours):
    settings = PrognosisSettings(service=Service(hours_per_cycle=hours))
    unit, outlook = Unit(History(*UNIT, None), settings, opened_ns=123), None
    for number in range(20):
        outlook = unit.update(made_test(number), None, settings)
    assert outlook is not None
    for fault in outlook.health.faults:
        assert fault.sigma <= SIGMA, fault
        assert fault.level == OK


def kinds(unit: Unit) -> list[tuple[float, str, str]]:
    tests, _ = unit.latest_tests(1000)
    return [
        (event.hours, event.kind, event.text)
        for test in tests
        for event in (test.assessment.events if test.assessment else ())
    ]


def test_assessment_is_the_same_from_its_text():
    event = UnitEvent(7, math.nan, "fault", "friction 0.2 (fails above 0.5)")
    whole = replace(assessment(3, WARN), alarms={"friction": WARN}, events=(event,))
    assert str(read_assessment(assessment_text(whole))) == str(whole)
    unknown = replace(whole, hours=math.nan, health_index=math.nan, life=None)
    assert str(read_assessment(assessment_text(unknown))) == str(unknown)


def test_assessments_are_read_again_and_replaced_by_later_ones(path: Path):
    history = History(*UNIT, path)
    for number in range(3):
        history.append(entry(number))
        history.assess(assessment(number))
    history.assess(assessment(1, ERROR))
    history.close()
    again = History(*UNIT, path)
    again.close()
    assert again.assessments == history.assessments
    assert [one.level for one in again.assessments.values()] == [OK, ERROR, OK]


def test_damaged_assessment_sets_the_file_aside_and_loses_no_test(path: Path):
    lived(path, [0.05, 0.06, 0.07])
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("UPDATE assessment SET record = replace(record, '\"level\": ', '\"level\": 1')")
    history = History(*UNIT, path)
    assert "the assessment of the test at 1700000000000000000 ns is damaged" in history.problem
    assert len(history.entries) == 3
    history.close()


def test_failure_is_dated_over_a_restart(path: Path):
    _, outlook = lived(path, [0.3, 0.4, 0.55])
    assert (outlook.health.level, outlook.failed_since) == (ERROR, 30.0)
    _, later = lived(path, [0.6, 0.65], first=3)
    assert (later.hours, later.failed_since) == (50.0, 30.0)


def test_fault_restart_and_calibration_are_events_once(path: Path):
    unit, _ = lived(path, [0.02, 0.02, 0.3, 0.3])
    # A test that the tracker holds back is WARN by itself.
    assert [(hours, kind) for hours, kind, _ in kinds(unit) if kind == "fault"] == [(30.0, "fault")]
    unit, _ = lived(path, [0.3], first=4)
    [restart] = [event for event in kinds(unit) if event[1] == "restart"]
    assert restart[2] == "the monitor started and read 4 valid tests"
    assert sum(kind == "fault" for _, kind, _ in kinds(unit)) == 1
    other = replace(made_test(5, friction=0.3), calibration_id="another")
    unit.update(other, None, SETTINGS)
    [changed] = [text for _, kind, text in kinds(unit) if kind == "calibration"]
    assert changed == "another instead of some-calibration"


def test_an_outlook_has_what_its_history_keeps_of_it(path: Path):
    unit, outlook = lived(path, [0.02, 0.02, 0.3])
    found = unit.history.assessments[outlook.stamp_ns]
    assert outlook.events == found.events
    assert [event.kind for event in found.events] == ["outlier", "fault"]
    again = unit.resume(None, SETTINGS)  # as when the requirements have been fitted
    assert again is not None
    assert again.events == ()
    assert unit.history.assessments[outlook.stamp_ns].events == found.events
