"""A monitor leaves earlier tests of a unit to the file of its history, and knows the same."""

import gc
import threading
import tracemalloc
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from ema_core.levels import ERROR
from ema_monitor.duty.flown import FlownDuty, Share
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.assessment import Assessment
from ema_monitor.prognosis.count_log import CountLog
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.tracker import Event, Tracker
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count, Entry, UnusedCycle
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.prognostics import Prognostics
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings

from .kept_histories import UNIT
from .made_tests import made_test

SPARING = replace(PrognosisSettings(), damage=DamageSettings(least_coverage=1e-6))
SETTINGS = replace(PrognosisSettings(), service=Service(hours_per_cycle=10.0))
IN_MEMORY = 20


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "flap.sqlite"


def add(history: History, numbers: range) -> None:
    for number in numbers:
        test = made_test(number, seed=1, friction=0.1)
        history.append(UnusedCycle(test.start_ns))
        history.append(Entry(test, 10.0 * number, number + 1))
        history.assess(Assessment(test.end_ns, 10.0 * number, ERROR, 0.5, "friction", None))
    history.write_assessments()


def check(history: History, numbers: range) -> None:
    """Check that all of these tests can be read, to the last bit."""
    assert len(history.entries) == len(history.assessments) == len(numbers)
    for entry, number in zip(history.entries, numbers, strict=True):
        test = made_test(number, seed=1, friction=0.1)
        for item in fields(Estimate):
            np.testing.assert_array_equal(
                getattr(entry.estimate, item.name), getattr(test, item.name)
            )
        assert history.assessments[entry.stamp_ns].hours == 10.0 * number


def duty(number: int) -> FlownDuty:
    travel = (Share(0, 0.05 + 1e-3 * number, 0.05), Share(2, 5e-3, 0.23))
    return FlownDuty(0.5 + 1e-3 * number, travel, (Share(12, 0.5, 20.0),))


def left(history: History) -> int:
    return sum(entry.in_memory is None for entry in history.entries)


def test_earlier_tests_are_read_from_the_file_to_the_last_bit(path: Path):
    history = History(*UNIT, path, spares_memory=True)
    add(history, range(60))
    assert left(history) == 60 - IN_MEMORY
    check(history, range(60))
    history.close()
    again = History(*UNIT, path, spares_memory=True)
    # All can be read at once, as what follows from them is found anew.
    assert (left(again), again.problem) == (0, "")
    add(again, range(60, 70))
    assert left(again) == 70 - IN_MEMORY
    check(again, range(70))
    assert again.assessments.get(1) is None
    again.close()


def test_memory_of_a_test_in_a_file_is_below_200_bytes(path: Path):
    history = History(*UNIT, path, spares_memory=True)
    add(history, range(100))
    gc.collect()
    tracemalloc.start()
    add(history, range(100, 500))
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    history.close()
    # Each is a test cycle with an estimate and one without; the latest 20 are as they were found.
    assert grown < 400 * 200 + IN_MEMORY * 4000


def test_memory_of_a_test_that_growth_follows_is_below_400_bytes(path: Path):
    """Each has a count of service hours and duty of its own, by which its growth counts."""
    history = History(*UNIT, path, spares_memory=True)
    log = CountLog()
    record = GrowthRecord(SPARING.limits, SPARING.tracker, history.entries, damage=SPARING.damage)

    def test(numbers: range) -> int:
        for number in numbers:
            estimate = made_test(number, seed=1, friction=0.1)
            log.add(UNIT, Count(estimate.start_ns, 10.0 * number, number + 1))
            count = log.latest(UNIT, estimate.end_ns)
            entry = Entry(estimate, np.nan, number + 1, count, duty(number))
            record.add(entry)
            history.append(entry)
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    before = test(range(50))
    grown = test(range(50, 200)) - before
    tracemalloc.stop()
    assert record.duty is not None
    assert record.tests == 200
    history.close()
    assert grown < 150 * 400


def test_unused_cycles_and_duty_are_written_anew_where_the_file_is_gone(path: Path):
    """They are in the file alone once it has them."""
    history = History(*UNIT, path, spares_memory=True)
    for number in range(0, 60, 2):
        history.append(UnusedCycle(made_test(number).end_ns, duty(number)))
        history.append(Entry(made_test(number + 1), 10.0 * number, number + 2, None, duty(number)))
    history.append(UnusedCycle(made_test(60).end_ns, duty(60)))
    path.unlink()
    history.append(UnusedCycle(made_test(61).end_ns, duty(61)))
    assert (history.unused_cycles, history.unused_duty) == (2, duty(60) + duty(61))
    history.close()
    again = History(*UNIT, path)
    assert again.problem == ""
    assert (again.unused_cycles, again.unused_duty) == (2, duty(60) + duty(61))
    assert [entry.flown for entry in again.entries] == [duty(n) for n in range(0, 60, 2)]
    assert all(again.holds(made_test(number).end_ns) for number in range(62))
    assert not again.holds(made_test(62).end_ns)
    again.close()


def test_earlier_tests_are_read_while_others_are_added(path: Path):
    history = History(*UNIT, path, spares_memory=True)
    add(history, range(30))
    stamps_ns = [made_test(number).end_ns for number in range(80)]
    wrong: list[str] = []
    is_done = threading.Event()

    def read() -> None:
        while not is_done.is_set():
            known = len(history.entries)
            found = [history.entries[place].stamp_ns for place in range(known)]
            if found != stamps_ns[:known]:
                wrong.append(f"{found} of {known}")

    reader = threading.Thread(target=read)
    reader.start()
    add(history, range(30, 60))
    path.unlink()
    add(history, range(60, 80))
    is_done.set()
    reader.join()
    history.close()
    assert wrong == []


@pytest.mark.parametrize("is_moved", [True, False])
def test_file_that_is_gone_is_written_anew_with_all_tests(path: Path, is_moved: bool):
    history = History(*UNIT, path, spares_memory=True)
    add(history, range(50))
    if is_moved:
        path.rename(path.with_name("moved.sqlite"))
    else:
        path.unlink()
    add(history, range(50, 60))
    assert "was deleted or moved while it was in use" in history.problem
    check(history, range(60))
    assert left(history) == 60 - IN_MEMORY
    history.close()
    again = History(*UNIT, path)
    check(again, range(60))
    again.close()


def test_tests_go_on_in_memory_where_another_monitor_took_the_place_of_the_file(path: Path):
    other = History(*UNIT, path.with_name("other.sqlite"))
    add(other, range(3))
    other.close()
    history = History(*UNIT, path, spares_memory=True)
    add(history, range(50))
    path.with_name("other.sqlite").replace(path)
    add(history, range(50, 60))
    assert history.path is None
    assert "written by another monitor" in history.problem
    check(history, range(60))
    assert left(history) == 0


def test_test_that_cannot_be_read_is_named(path: Path):
    history = History(*UNIT, path, spares_memory=True)
    add(history, range(30))
    db = history._db
    assert db is not None
    db.execute("UPDATE test SET crc32 = crc32 + 1 WHERE number = 4")
    db.execute("UPDATE assessment SET crc32 = crc32 + 1")
    with pytest.raises(ValueError, match=r"test 4 .*: its checksum is wrong"):
        _ = history.entries[1].estimate
    assert history.assessments.get(history.entries[1].stamp_ns) is None
    assert "an assessment is damaged" in history.problem
    # All the others are taken into the new file.
    path.unlink()
    history.append(Entry(made_test(30), 300.0, 31))
    assert "test 4 of ('flap', 'SIM-0001') cannot be read" in history.problem
    history.close()
    again = History(*UNIT, path)
    assert [entry.cycles for entry in again.entries] == [
        number + 1 for number in range(31) if number != 1
    ]
    again.close()


def test_closed_file_gives_no_tests(path: Path):
    history = History(*UNIT, path, spares_memory=True)
    add(history, range(30))
    history.close()
    with pytest.raises(ValueError, match=r"test 2 .* cannot be read: it is closed"):
        _ = history.entries[0].estimate


def figures(outlook: Outlook | None) -> tuple:
    assert outlook is not None
    return (outlook.failed_since, outlook.rul, outlook.trends, outlook.health, outlook.lives)


def test_prognosis_is_the_same_to_the_last_digit(path: Path):
    """Friction grows beyond its limit: what is found rests on earlier tests again and again."""
    tests = [made_test(n, seed=1, friction=min(0.02 * n, 0.9)) for n in range(70)]
    in_memory = Prognostics(History(*UNIT), SETTINGS)
    in_file = Prognostics(History(*UNIT, path, spares_memory=True), SETTINGS)
    expected = None
    for number, test in enumerate(tests):
        if number == 60:
            in_file.history.close()
            in_file = Prognostics(History(*UNIT, path, spares_memory=True), SETTINGS)
        expected = in_memory.update(test, None, SETTINGS)
        assert repr(figures(in_file.update(test, None, SETTINGS))) == repr(figures(expected))
        in_memory.write()
        in_file.write()
    assert expected is not None
    assert expected.failed_since < expected.hours - 200.0
    assert left(in_file.history) == 50
    for most in (5, 70):
        found, omitted = in_file.latest_tests(most)
        expected_tests, expected_omitted = in_memory.latest_tests(most)
        assert omitted == expected_omitted
        assert [(item.hours, item.assessment) for item in found] == [
            (item.hours, item.assessment) for item in expected_tests
        ]
    # Another tracker is fed with all tests anew.
    other = replace(SETTINGS, tracker=replace(SETTINGS.tracker, samples=300))
    assert repr(figures(in_file.outlook(None, other))) == repr(
        figures(in_memory.outlook(None, other))
    )
    in_file.history.close()


def test_prognosis_goes_on_the_same_where_the_file_is_gone(path: Path):
    """Tests on one count wait for the next; meanwhile the file that has earlier ones is deleted."""
    in_memory = Prognostics(History(*UNIT), SPARING)
    in_file = Prognostics(History(*UNIT, path, spares_memory=True), SPARING)
    for number in range(60):
        test = made_test(number, seed=1, friction=0.01 * number)
        counted = number - number % 25
        count = Count(made_test(counted).start_ns, 10.0 * counted, 0)
        expected = in_memory.update(test, None, SPARING, count, duty(number))
        if number == 45:
            path.unlink()
        found = in_file.update(test, None, SPARING, count, duty(number))
        assert repr(figures(found)) == repr(figures(expected))
        in_file.write()
        in_memory.write()
    assert len(in_file.growth.service.used) == 51
    assert left(in_file.history) == 40
    assert in_file.growth.state() == in_memory.growth.state()
    in_file.history.close()


def test_growth_is_found_anew_without_a_test_that_was_lost_with_the_file(path: Path):
    """Its row is damaged, the file deleted, and then other hours have all tests fed again."""
    monitor = Prognostics(History(*UNIT, path, spares_memory=True), PrognosisSettings())

    def update(number: int, hours: float) -> Outlook | None:
        test = made_test(number, seed=1, friction=0.1)
        return monitor.update(test, None, PrognosisSettings(), Count(test.start_ns, hours, 0))

    for number in range(40):
        update(number, 10.0 * number)
    db = monitor.history._db
    assert db is not None
    db.execute("UPDATE test SET crc32 = crc32 + 1 WHERE number = 4")
    path.unlink()
    update(40, 400.0)
    assert "test 4 of ('flap', 'SIM-0001') cannot be read" in monitor.history.problem
    # A counter that was replaced: the hours at all tests after 200 h are others.
    update(41, 200.0)
    outlook = update(42, 210.0)
    assert outlook is not None
    assert any("growth is found anew from all tests" in event for event in outlook.events)
    assert len(monitor.history.entries) == 42
    assert monitor.growth.tests == 22
    monitor.history.close()


def test_test_that_growth_cannot_take_leaves_what_follows_as_it_would_be(monkeypatch):
    """What is known of growth has no part of it, and neither has the history."""
    monitor, other = (Prognostics(History(*UNIT), SETTINGS) for _ in range(2))
    tests = [made_test(number, seed=1, friction=0.01 * number) for number in range(30)]
    known = Tracker.update

    def fail(tracker: Tracker, measurement: Measurement) -> list[Event]:
        if measurement.faults[0] == tests[25].faults[0]:
            raise FloatingPointError("overflow")
        return known(tracker, measurement)

    for test in tests[:25]:
        monitor.update(test, None, SETTINGS)
        other.update(test, None, SETTINGS)
    monkeypatch.setattr(Tracker, "update", fail)
    with pytest.raises(FloatingPointError):
        monitor.update(tests[25], None, SETTINGS)
    monkeypatch.undo()
    found = monitor.update(tests[26], None, SETTINGS)
    assert repr(figures(found)) == repr(figures(other.update(tests[26], None, SETTINGS)))
    assert len(monitor.history.entries) == 26
