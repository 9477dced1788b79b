"""Replays and clocks that are wrong never enter the history of a unit."""

import sqlite3
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from lifecycle_msgs.msg import Transition

from ema_core.telemetry import Telemetry
from ema_interfaces.msg import Health

from .monitor_session import FLAP, MonitorSession, monitor
from .mounted_units import mount
from .worn_actuator import HOURS, live, worn_cycles

OK, WARN = b"\x00", b"\x01"
DAY_NS = 86_400_000_000_000
OFFSET_S = 3600.0


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


def test_test_of_another_time_is_identified_but_not_recorded(
    cycles: list[Telemetry], given: dict[str, object], tmp_path: Path
):
    """A replayed bag, and a clock that is ten years ahead."""
    with monitor(given) as session:
        mount(session, FLAP)
        [first] = follow(session, now(cycles[:1]), 1)
        assert "not recorded" not in first.reason
        odd = now(cycles[1:2], later_ns=3650 * DAY_NS)
        session.feed(odd)
        session.until(lambda: len(session.estimates()) == 2)
        status = session.until_status("flap history", "3650.0 days after the clock", WARN)
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


def test_history_in_memory_takes_tests_of_any_time(cycles: list[Telemetry]):
    with monitor({"hours_per_cycle": HOURS, "history_max_offset_s": OFFSET_S}) as session:
        mount(session, FLAP)
        assert [health.cycles for health in live(session, cycles[:2])] == [1, 2]
        session.until_status("flap history", "2 tests", OK)


def test_clock_can_be_changed_while_nothing_of_it_is_there():
    with monitor() as session:
        [answer] = session.set_parameters(use_sim_time=True)
        assert not answer.successful
        assert "while the node is unconfigured" in answer.reason
        assert session.node.get_clock().now().nanoseconds > 0
        for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
            assert session.change_state(transition)
        assert session.set_parameters(use_sim_time=True)[0].successful
        assert session.change_state(Transition.TRANSITION_CONFIGURE)
        assert session.change_state(Transition.TRANSITION_ACTIVATE)


def test_unit_that_was_mounted_again_is_one_after_three_tests(cycles: list[Telemetry]):
    other = replace(FLAP, serial_number="SIM-0002")
    with monitor({"hours_per_cycle": HOURS}) as session:
        for description in (FLAP, other, FLAP):
            mount(session, description)
        live(session, cycles[:2])
        session.until_status("flap telemetry", "units SIM-0001, SIM-0002 alternate", WARN)
        live(session, cycles[2:3])
        session.until_status("flap telemetry", "3 valid estimates", OK)
