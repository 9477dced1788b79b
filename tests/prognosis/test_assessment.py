# SPDX-License-Identifier: Apache-2.0
"""Assessments and growth are stored with the tests, and survive a restart."""

import math
import sqlite3
from contextlib import closing
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from ema_core.levels import ERROR, OK, WARN
from ema_monitor import unit as unit_module
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.event_texts import text_of
from ema_monitor.prognosis.events import Note, UnitEvent
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Assessment, assessment_text, read_assessment
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.pending_events import MOST_NOTES, MOST_PERSONS
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .lived_units import TEN_HOURS, Cycle, drawn_count, follow, plain, worn
from .made_tests import SIGMA, UNIT, entry, made_test


def assessment(number: int, level: int = OK) -> Assessment:
    return Assessment(entry(number).stamp_ns, 10.0 * number, level, 0.9, "", (1.0, 2.0, math.inf))


def lived(
    path: Path | None, frictions: list[float], first: int = 0, hours: float = 10.0
) -> tuple[Unit, Outlook]:
    """Return a unit with more tests from number ``first`` on, stored in the history at a path."""
    settings = PrognosisSettings(service=Service(hours_per_cycle=hours))
    unit = Unit(History(*UNIT, path), settings, opened_ns=123)
    outlook = None
    for number, friction in enumerate(frictions, first):
        outlook = unit.update(made_test(number, friction=friction), None, settings)
    unit.history.close()
    assert outlook is not None
    return unit, outlook


@pytest.mark.parametrize("hours", [1.0, 50.0])
def test_level_of_a_healthy_unit_is_as_sharp_as_its_tests(hours):
    _, outlook = lived(None, [0.0] * 20, hours=hours)
    for fault in outlook.health.faults:
        assert fault.sigma <= SIGMA, fault
        assert fault.level == OK


def kinds(unit: Unit) -> list[tuple[float, str, str]]:
    tests, _ = unit.latest_tests(1000)
    return [
        (event.flight_hours, event.kind, text_of(event.occurrence))
        for test in tests
        for event in (test.assessment.events if test.assessment else ())
    ]


def test_assessment_survives_conversion_to_text():
    event = UnitEvent(7, math.nan, Note("Ada", "seen", 0))
    whole = replace(assessment(3, WARN), alarms={"friction": WARN}, events=(event,))
    assert str(read_assessment(assessment_text(whole))) == str(whole)
    unknown = replace(whole, flight_hours=math.nan, health_index=math.nan, life=None)
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
    assert [stored.level for stored in again.assessments.values()] == [OK, ERROR, OK]


def test_damaged_assessment_renames_the_file_and_loses_no_test(path: Path):
    lived(path, [0.05, 0.06, 0.07])
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("UPDATE assessment SET record = replace(record, '\"level\": ', '\"level\": 1')")
    history = History(*UNIT, path)
    assert "the assessment of the test at 1700000000000000000 ns is damaged" in history.problem
    assert len(history.entries) == 3
    history.close()


def test_failure_keeps_its_date_over_a_restart(path: Path):
    _, outlook = lived(path, [0.3, 0.4, 0.55])
    assert (outlook.health.level, outlook.failed_since) == (ERROR, 30.0)
    _, later = lived(path, [0.6, 0.65], first=3)
    assert (later.flight_hours, later.failed_since) == (50.0, 30.0)


def test_fault_restart_and_calibration_are_reported_once_as_events(path: Path):
    unit, _ = lived(path, [0.02, 0.02, 0.3, 0.3])
    # A test that the tracker holds back gives WARN by itself.
    assert [(hours, kind) for hours, kind, _ in kinds(unit) if kind == "fault"] == [(30.0, "fault")]
    unit, _ = lived(path, [0.3], first=4)
    [restart] = [event for event in kinds(unit) if event[1] == "restart"]
    assert restart[2] == "the monitor started and read 4 valid tests"
    assert sum(kind == "fault" for _, kind, _ in kinds(unit)) == 1
    recalibrated = replace(made_test(5, friction=0.3), calibration_id="another")
    unit.update(recalibrated, None, TEN_HOURS)
    [changed] = [text for _, kind, text in kinds(unit) if kind == "calibration"]
    assert changed == "another instead of some-calibration"


def test_note_of_a_person_is_one_event_and_survives_restarts_and_tests(path: Path):
    lived(path, [0.02, 0.3])
    unit = Unit(History(*UNIT, path), TEN_HOURS)
    first_ns = unit.history.entries[0].stamp_ns
    unit.note("Ada", "seen", stamp_ns=first_ns)
    outlooks = [unit.resume(None, TEN_HOURS) for _ in range(2)]
    events = [outlook.events for outlook in outlooks if outlook]
    assert events == [(UnitEvent(first_ns, 10.0, Note("Ada", "seen", 0)),), ()]
    unit.history.close()
    unit, _ = lived(path, [0.3], first=2)
    assert (10.0, "note", "Ada, seen") in kinds(unit)


def test_notes_of_one_person_leave_room_for_notes_of_others(path: Path):
    lived(path, [0.02, 0.3])
    unit = Unit(History(*UNIT, path), TEN_HOURS)
    for _ in range(MOST_NOTES):
        unit.note("Mallory", "again")
    unit.resume(None, TEN_HOURS)
    with pytest.raises(ValueError, match="already has 50 notes of Mallory"):
        unit.note("Mallory", "again")
    unit.note("Ada", "connector replaced")
    unit.note("Mallory, again", "is another person")
    for number in range(3, MOST_PERSONS):
        unit.note(f"person {number}", "seen")
    with pytest.raises(ValueError, match=f"notes of {MOST_PERSONS} persons other than"):
        unit.note("Grace", "seen")
    unit.note("Ada", "seen")
    unit.history.close()
    unit, _ = lived(path, [0.3], first=2)
    unit.note("Mallory", "once more")


def test_outlook_has_the_stored_assessment_of_its_history(path: Path):
    unit, outlook = lived(path, [0.02, 0.02, 0.3])
    stored = unit.history.assessments[outlook.stamp_ns]
    assert outlook.events == stored.events
    assert [event.kind for event in stored.events] == ["outlier", "fault"]
    again = unit.resume(None, TEN_HOURS)  # as after the requirements were fitted
    assert again is not None
    assert again.events == ()
    assert unit.history.assessments[outlook.stamp_ns].events == stored.events


N = 8


@pytest.fixture(autouse=True)
def kept_each_fourth_test(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unit_module, "KEPT_EVERY", 4)


@pytest.fixture
def fed(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return the hours of the tests with which any tracker is updated from now on."""
    hours: list[float] = []
    update = Tracker.update

    def counting(self: Tracker, measurement: Measurement) -> object:
        hours.append(measurement.hours)
        return update(self, measurement)

    monkeypatch.setattr(Tracker, "update", counting)
    return hours


def followed(path: Path, cycles: list[Cycle], settings: PrognosisSettings = TEN_HOURS) -> list[str]:
    """Return the outlook of each cycle as text, from a separate run that writes everything."""
    unit = Unit(History(*UNIT, path), settings)
    printed = []
    for cycle in cycles:
        [outlook] = follow(unit, [cycle], settings)
        unit.write()
        printed.append(plain(outlook) if outlook else "")
    unit.history.close()
    return printed


def resumed(path: Path, settings: PrognosisSettings = TEN_HOURS) -> str:
    unit = Unit(History(*UNIT, path), settings)
    outlook = unit.resume(None, settings)
    unit.history.close()
    assert (outlook is not None, unit.history.problem) == (True, "")
    return plain(outlook) if outlook else ""


@pytest.mark.slow
@pytest.mark.parametrize("by_cycles", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_restart_from_stored_growth_gives_bit_identical_results(
    tmp_path: Path, path: Path, seed: int, by_cycles: bool
):
    """Tests with and without estimates, outliers, and with right, missing and wrong counts."""
    rng = np.random.default_rng(seed)
    settings = PrognosisSettings(service=Service(hours_per_cycle=7.0 if by_cycles else 0.0))
    cycles = []
    for number in range(16):
        hours = drawn_count(rng, number)
        cycle = worn(number, math.nan if by_cycles else hours, valid=rng.random() > 0.2)
        if cycle.estimate.valid and rng.random() < 0.2:
            odd = cycle.estimate.faults._replace(friction=0.6)
            cycle = cycle._replace(estimate=replace(cycle.estimate, faults=odd))
        cycles.append(cycle)
    expected = [
        plain(outlook) if outlook else ""
        for outlook in follow(Unit(History(*UNIT)), cycles, settings)
    ]
    printed = []
    for first in range(0, 16, 3):
        printed += followed(path, cycles[first : first + 3], settings)
    assert printed == expected


def test_restart_replays_only_the_tests_since_growth_was_stored(path: Path, fed: list[float]):
    followed(path, [worn(number) for number in range(N + 2)])
    fed.clear()
    resumed(path)
    assert fed == [90.0, 100.0]


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE growth SET state = zeroblob(length(state))",
        "UPDATE growth SET crc32 = crc32 + 1",
        "DELETE FROM growth",
    ],
)
def test_damaged_growth_is_recomputed_from_the_tests(path: Path, fed: list[float], statement: str):
    followed(path, [worn(number) for number in range(N)])
    expected = resumed(path)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(statement)
    fed.clear()
    assert resumed(path) == expected
    assert len(fed) == N


def test_stored_growth_of_other_settings_is_not_used(path: Path, fed: list[float]):
    followed(path, [worn(number) for number in range(N)])
    changed = replace(TEN_HOURS, tracker=TrackerSettings(process_noise=0.2))
    fed.clear()
    assert resumed(path, changed) != resumed(path)
    assert len(fed) == N


@pytest.mark.parametrize("method", [1, 99])
def test_unreadable_archive_of_growth_counts_as_missing(method: int):
    """Other packers than numpy raise errors of various types."""
    stream = BytesIO()
    np.savez(stream, used_hours=np.zeros(1))
    kept = bytearray(stream.getvalue())
    for mark, place in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        kept[kept.index(mark) + place] = method
    record = GrowthRecord(HealthLimits(), TrackerSettings(), [], bytes(kept))
    assert (record.kept_tests, record.tests) == (0, 0)
