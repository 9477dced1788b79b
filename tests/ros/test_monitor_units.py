# SPDX-License-Identifier: Apache-2.0
"""Tests and service life are assigned to the right unit, and restored after a restart."""

import math
import sqlite3
import threading
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition

from ema_core.levels import OK, STALE, WARN
from ema_core.telemetry import Telemetry
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.unit import Unit

from ..waiting import DEADLINE_S, wait_for
from .monitor_session import FLAP, monitor
from .worn_actuator import HOURS, live, plain, predict, use, worn_cycles

DAY_NS = 86_400_000_000_000
OFFSET_S = 3600.0
OTHER = replace(FLAP, serial_number="SIM-0002")


@pytest.fixture(scope="module")
def cycles() -> list[Telemetry]:
    return worn_cycles(6)


def now(blocks: list[Telemetry], *, later_ns: int = 0) -> list[Telemetry]:
    """Return blocks with stamps shifted so that they end now, or ``later_ns`` later."""
    shift_ns = time.time_ns() - int(blocks[-1].stamps_ns[-1]) + later_ns
    return [replace(block, stamp_ns=block.stamp_ns + shift_ns) for block in blocks]


def test_hours_are_taken_from_the_usage_topic(cycles: list[Telemetry]):
    ends = [int(block.stamps_ns[-1]) for block in cycles]
    with monitor() as session:
        session.describe()
        [first] = live(session, cycles[:1])
        assert math.isnan(first.flight_hours)
        assert "usage" in first.reason
        assert "hours_per_cycle" in first.rul.reason
        # A count with a later stamp, or an impossible one, does not count for this test.
        for hours, stamp_ns in ((123.0, ends[0]), (-5.0, ends[0] + 1), (999.0, ends[1])):
            use(session, hours, stamp_ns, cycles=40)
        session.until_status("flap telemetry", "flight_hours = -5 h")
        [second] = live(session, cycles[1:2])
        assert (second.flight_hours, second.cycles) == (123.0, 40)


def test_exchanged_unit_has_a_separate_history(cycles: list[Telemetry], tmp_path: Path):
    settings = {"hours_per_cycle": HOURS, "history_folder": str(tmp_path)}
    with monitor(settings) as session:
        session.describe()
        live(session, cycles[:2])
        session.mount(OTHER)
        session.feed(cycles[2:3])
        # The built-in calibration belongs to the first unit.
        session.until_status("flap telemetry", "SIM-0002")
        answer = predict(session, 1.0)
        assert "no history yet" in answer.message
        before = len(session.healths())
        session.describe()
        # The history of the first unit continues.
        session.until(lambda: len(session.healths()) > before)
        [back] = live(session, cycles[3:4])
        assert (back.serial_number, back.cycles) == ("SIM-0001", 3)


def test_failure_after_an_estimate_is_reported_and_a_new_unit_has_no_health(
    cycles: list[Telemetry], monkeypatch: pytest.MonkeyPatch
):
    def fail(*_: Any) -> Any:
        raise FloatingPointError("made up")

    with monitor({"hours_per_cycle": HOURS}) as session:
        session.mount()
        live(session, cycles[:1])
        with monkeypatch.context() as patched:
            patched.setattr(Unit, "outlook", fail)
            answer = predict(session, 1.0)
        assert not answer.success
        assert "the prognosis failed: FloatingPointError('made up')" in answer.message
        assert predict(session, 1.0).success
        with monkeypatch.context() as patched:
            patched.setattr(ActuatorStatus, "record", fail)
            session.feed(cycles[1:2])
            words = "publishing health failed: FloatingPointError"
            session.until_status("flap telemetry", words)
        live(session, cycles[2:3])
        assert [(item.window, item.valid) for item in session.estimates()] == [
            (number, True) for number in range(3)
        ]
        session.until_status("flap health", "", bytes([OK]))
        printed = len(session.statuses("flap health"))
        session.mount(OTHER)
        status = session.until_status("flap health", "no valid estimate so far", since=printed)
        assert (status.hardware_id, status.level) == ("/ema/flap/SIM-0002", bytes([STALE]))


def test_telemetry_is_received_while_a_history_is_read(
    cycles: list[Telemetry], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with monitor({"hours_per_cycle": HOURS, "history_folder": str(tmp_path)}) as session:
        session.mount()
        live(session, cycles[:1])
    begun, go_on = threading.Event(), threading.Event()
    begin = Unit.__init__

    def slow(self: Unit, *args: Any) -> None:
        begun.set()
        assert go_on.wait(DEADLINE_S)
        begin(self, *args)

    monkeypatch.setattr(Unit, "__init__", slow)
    with monitor({"hours_per_cycle": HOURS, "history_folder": str(tmp_path)}) as session:
        session.describe()
        assert begun.wait(DEADLINE_S)
        try:
            session.feed([cycles[1].part(0, 5000)])
            for hours in (500.0, -1.0):
                use(session, hours, 1)
            # When the impossible count is reported, all messages before it have been received.
            session.until_status("flap telemetry", "flight_hours = -1 h")
            wait_for(lambda: session.node.actuators["flap"].finder.blocks == 1, "the block")
            assert not session.healths()
        finally:
            go_on.set()
        [health] = session.until(session.healths)
        assert (health.flight_hours, health.cycles) == (HOURS, 1)


def test_health_and_start_of_the_search_are_restored_after_a_restart(
    cycles: list[Telemetry], tmp_path: Path
):
    recent = now(cycles[:3])  # with the stamps of a real actuator
    settings = {"hours_per_cycle": HOURS, "history_folder": str(tmp_path / "one")}
    with monitor(settings) as session:
        session.mount()
        *_, expected = live(session, recent)
        [_, _, estimate] = session.estimates()
    settings["history_folder"] = str(tmp_path / "two")
    with monitor(settings) as session:
        session.mount()
        *_, before = live(session, recent[:2])
    with monitor(settings) as session:
        session.mount()
        [restored] = session.until(session.healths)
        assert [event.kind for event in restored.events] == ["restart"]
        before.events = restored.events
        assert plain(restored) == plain(before)

        def hours() -> str:
            life = session.until_status("flap health", "", bytes([restored.level]))
            return {item.key: item.value for item in life.values}["service hours [h]"]

        wait_for(lambda: hours() == "20", "the hours of the history in the status")
        [health] = live(session, recent[2:])
        [again] = session.estimates()
    assert again.warm_start
    assert (again.faults, again.evaluations) == (estimate.faults, estimate.evaluations)
    assert plain(health) == plain(expected)
    with monitor({**settings, "expected_period_s": 0.1}) as session:
        session.mount()
        # An old health is published as stale before any new test.
        old = session.until(session.healths)[0]
        assert (old.level, old.last_level, old.confidence) == (STALE, health.level, 0.0)
        assert old.reason.startswith("no valid estimate for more than 0.3 s")
        assert (str(old.rul), old.header) == (str(health.rul), health.header)


def kept(folder: Path) -> int:
    """Return the number of tests in the history file."""
    [file] = folder.glob("flap*.sqlite")
    with closing(sqlite3.connect(file)) as db:
        return db.execute("SELECT count(*) FROM test").fetchone()[0]


def test_test_with_a_distant_stamp_is_identified_but_not_recorded(
    cycles: list[Telemetry], tmp_path: Path
):
    """The test is from a replayed bag, or a clock that is ten years ahead."""
    settings = {"history_folder": str(tmp_path), "history_max_offset_s": OFFSET_S}
    with monitor({"hours_per_cycle": HOURS, "expected_period_s": 1e6, **settings}) as session:
        session.mount()
        [first] = live(session, now(cycles[:1]))
        assert "not recorded" not in first.reason
        odd = now(cycles[1:2], later_ns=3650 * DAY_NS)
        session.feed(odd)
        session.until(lambda: len(session.estimates()) == 2)
        status = session.until_status("flap history", "3650.0 days after the clock", bytes([WARN]))
        for expected in ("not recorded", "use_sim_time", "history_max_offset_s"):
            assert expected in status.message
        # The order of the tests is unknown, so the level is unknown too.
        [unknown] = session.until(lambda: session.healths()[1:])
        assert (unknown.level, unknown.last_level, unknown.cycles) == (STALE, first.level, 1)
        assert "not recorded" in unknown.reason
        year = time.gmtime(int(odd[0].stamps_ns[-1]) // 10**9).tm_year
        assert f"the test of {year}-" in status.message
        [again] = live(session, now(cycles[2:3]))
        assert [estimate.valid for estimate in session.estimates()] == [True] * 3
        assert (again.cycles, again.flight_hours) == (2, 2 * HOURS)
        session.until_status("flap history", "2 tests", bytes([OK]))
    assert kept(tmp_path) == 2


def test_clock_can_be_changed_only_while_unconfigured():
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


def test_remounted_unit_is_accepted_after_three_tests(
    cycles: list[Telemetry], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The history is in memory and leaves no file."""
    monkeypatch.chdir(tmp_path)
    with monitor({"hours_per_cycle": HOURS, "history_max_offset_s": OFFSET_S}) as session:
        for description in (FLAP, OTHER, FLAP):
            session.mount(description)
        assert [health.cycles for health in live(session, cycles[:2])] == [1, 2]
        session.until_status("flap telemetry", "units SIM-0001, SIM-0002 alternate", bytes([WARN]))
        live(session, cycles[2:3])
        session.until_status("flap telemetry", "3 valid estimates", bytes([OK]))
        session.until_status("flap history", "3 tests", bytes([OK]))
    assert list(tmp_path.iterdir()) == []
