"""Replays and clocks that are wrong never enter the history of a unit."""

import sqlite3
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from ema_core.telemetry import Telemetry
from ema_interfaces.msg import Health

from .monitor_session import CYCLE, FLAP, MonitorSession, monitor
from .mounted_units import mount
from .worn_actuator import HOURS, live, plain, worn_cycles

OK, WARN = b"\x00", b"\x01"
DAY_NS = 86_400_000_000_000
OFFSET_S = 3600.0
MIDDLE = (CYCLE.start + CYCLE.stop) // 2


@pytest.fixture(scope="module")
def cycles() -> list[Telemetry]:
    return worn_cycles(5)


@pytest.fixture
def given(tmp_path: Path) -> dict[str, object]:
    """A history on disk, with the most that a stamp may be off as it is by default."""
    return {
        "hours_per_cycle": HOURS,
        "history_folder": str(tmp_path),
        "history_max_offset_s": OFFSET_S,
        "expected_period_s": 1e6,
    }


def now(blocks: list[Telemetry], *, later_ns: int = 0) -> list[Telemetry]:
    """The blocks as if they ended just now, or some time later."""
    shift_ns = time.time_ns() - int(blocks[-1].stamps_ns[-1]) + later_ns
    return [replace(block, stamp_ns=block.stamp_ns + shift_ns) for block in blocks]


def kept(folder: Path) -> int:
    """The number of tests in the file of the history."""
    [file] = folder.glob("flap*.sqlite")
    with closing(sqlite3.connect(file)) as db:
        return db.execute("SELECT count(*) FROM test").fetchone()[0]


def follow(session: MonitorSession, cycles: list[Telemetry], valid: int) -> list[Health]:
    healths = live(session, cycles)
    assert [estimate.valid for estimate in session.estimates()] == [True] * valid
    return healths


@pytest.mark.parametrize(
    ("later_days", "words"),
    [(3650, "3650.0 days after the clock"), (-400, "400.0 days before the clock")],
)
def test_test_of_another_time_is_identified_but_not_recorded(
    cycles: list[Telemetry], given: dict[str, object], tmp_path: Path, later_days: int, words: str
):
    """A replayed bag, and a clock that is ten years ahead."""
    with monitor(given) as session:
        mount(session, FLAP)
        [first] = follow(session, now(cycles[:1]), 1)
        assert "not recorded" not in first.reason
        odd = now(cycles[1:2], later_ns=later_days * DAY_NS)
        session.feed(odd)
        session.until(lambda: len(session.estimates()) == 2)
        status = session.until_status("flap history", words, WARN)
        for expected in ("not recorded", "use_sim_time", "history_max_offset_s"):
            assert expected in status.message
        # Which of them came first is not known: it leads no test of the history.
        assert len(session.healths()) == 1
        year = time.gmtime(int(odd[0].stamps_ns[-1]) // 10**9).tm_year
        assert f"the test of {year}-" in status.message
        [again] = follow(session, now(cycles[2:3]), 3)
        assert (again.cycles, again.flight_hours) == (2, 2 * HOURS)
        session.until_status("flap history", "2 tests", OK)
    assert kept(tmp_path) == 2


def test_refused_window_of_a_replay_is_no_test_cycle_of_the_unit(
    cycles: list[Telemetry], given: dict[str, object], tmp_path: Path
):
    with monitor(given) as session:
        mount(session, FLAP)
        live(session, now(cycles[:1]))
        old = cycles[1]
        session.feed([old.part(0, MIDDLE), old.part(MIDDLE + 500, len(old))])
        session.until(lambda: len(session.estimates()) == 2)
        assert not session.estimates()[1].valid
        session.until_status("flap history", "not recorded", WARN)
        [health] = live(session, now(cycles[2:3]))
        assert health.cycles == 2
    assert kept(tmp_path) == 2


def test_history_in_memory_takes_tests_of_any_time(cycles: list[Telemetry]):
    with monitor({"hours_per_cycle": HOURS, "history_max_offset_s": OFFSET_S}) as session:
        mount(session, FLAP)
        assert [health.cycles for health in live(session, cycles[:2])] == [1, 2]
        session.until_status("flap history", "2 tests", OK)


def test_use_sim_time_at_run_time_closes_the_history_on_disk_at_once(
    cycles: list[Telemetry], given: dict[str, object], tmp_path: Path
):
    with monitor(given) as session:
        mount(session, FLAP)
        [real] = live(session, now(cycles[:1]))
        [file] = tmp_path.glob("flap*.sqlite")
        assert session.set_parameters(use_sim_time=True)[0].successful
        before = file.read_bytes()
        status = session.until_status("flap history", "0 tests; use_sim_time was set", OK)
        assert {item.key: item.value for item in status.values}["file"] == "none, in memory only"
        # What is replayed begins a life of its own.
        replayed = live(session, cycles[1:3])
        assert [health.cycles for health in replayed] == [1, 2]
        assert not any("not recorded" in health.reason for health in replayed)
        assert file.read_bytes() == before
        heard = len(session.healths())
        assert session.set_parameters(use_sim_time=False)[0].successful
        session.until(lambda: len(session.healths()) > heard)
        again = session.healths()[-1]
        assert (again.cycles, again.header) == (real.cycles, real.header)
        assert plain(again.faults) == plain(real.faults)
        session.until_status("flap history", "1 test; use_sim_time was reset", OK)
        [health] = live(session, now(cycles[3:4]))
        assert (health.cycles, health.flight_hours) == (2, 2 * HOURS)
    assert kept(tmp_path) == 2


def test_window_that_the_change_of_the_clock_cuts_off_enters_no_history(
    cycles: list[Telemetry], given: dict[str, object], tmp_path: Path
):
    with monitor(given) as session:
        mount(session, FLAP)
        live(session, now(cycles[:1]))
        [whole] = now(cycles[1:2])
        session.feed([whole.part(0, MIDDLE)])
        session.until_status("flap telemetry", "")
        session.until(lambda: session.node._units["flap"].finder.is_open)
        assert session.set_parameters(use_sim_time=True)[0].successful
        session.feed([whole.part(MIDDLE, len(whole))])
        session.until(lambda: len(session.estimates()) == 2)
        assert not session.estimates()[1].valid
        [health] = live(session, cycles[2:3])
        assert health.cycles == 1
    assert kept(tmp_path) == 1


def test_units_that_alternate_under_one_name_are_named_at_once():
    other = replace(FLAP, serial_number="SIM-0002")
    with monitor() as session:
        for description in (FLAP, other):
            mount(session, description)
        session.until_status("flap telemetry", "no telemetry so far")
        assert not any("alternate" in one.message for one in session.statuses("flap telemetry"))
        mount(session, FLAP)
        session.until_status("flap telemetry", "units SIM-0001, SIM-0002 alternate", WARN)


def test_unit_that_was_mounted_again_is_one_after_three_tests(cycles: list[Telemetry]):
    other = replace(FLAP, serial_number="SIM-0002")
    with monitor({"hours_per_cycle": HOURS}) as session:
        for description in (FLAP, other, FLAP):
            mount(session, description)
        live(session, cycles[:2])
        session.until_status("flap telemetry", "units SIM-0001, SIM-0002 alternate", WARN)
        live(session, cycles[2:3])
        session.until_status("flap telemetry", "3 valid estimates", OK)
