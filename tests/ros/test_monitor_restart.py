"""What a monitor that begins again knows of its units, and when."""

import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.unit import Unit

from ..waiting import DEADLINE_S, wait_for
from .monitor_session import FLAP, monitor
from .mounted_units import all_received, mount
from .worn_actuator import HOURS, live, plain, use, worn_cycles


@pytest.fixture(scope="module")
def cycles() -> list[Telemetry]:
    return worn_cycles(3)


def test_health_is_known_again_after_a_restart_without_a_new_test(
    cycles: list[Telemetry], tmp_path: Path
):
    # The stamps of telemetry are those of the wall clock here, as with a real actuator.
    shift_ns = time.time_ns() - int(cycles[2].stamps_ns[-1])
    recent = [replace(block, stamp_ns=block.stamp_ns + shift_ns) for block in cycles[:3]]
    given = {
        "hours_per_cycle": HOURS,
        "history_folder": str(tmp_path),
        "expected_period_s": 1000.0,
    }
    with monitor(given) as session:
        mount(session, FLAP)
        expected = live(session, recent)[-1]
    with monitor(given) as session:
        mount(session, FLAP)
        [health] = session.until(session.healths)
        assert [event.kind for event in health.events] == ["restart"]
        expected.events = health.events
        assert plain(health) == plain(expected)

        def hours() -> str:
            life = session.until_status("flap health", "", bytes([health.level]))
            return {item.key: item.value for item in life.values}["flight hours [h]"]

        wait_for(lambda: hours() == "30", "the hours of the history in the status")


def test_no_history_is_kept_where_memory_is_its_folder(
    cycles: list[Telemetry], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    with monitor({"hours_per_cycle": HOURS, "history_folder": "memory"}) as session:
        mount(session, FLAP)
        live(session, cycles[:1])
    assert list(tmp_path.iterdir()) == []


def test_telemetry_is_received_while_a_history_is_read(
    cycles: list[Telemetry], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with monitor({"hours_per_cycle": HOURS, "history_folder": str(tmp_path)}) as session:
        mount(session, FLAP)
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
            use(session, 500.0, 1)
            all_received(session)
            wait_for(lambda: session.node.units["flap"].finder.blocks == 1, "the block")
            assert not session.healths()
        finally:
            go_on.set()
        [health] = session.until(session.healths)
        assert (health.flight_hours, health.cycles) == (HOURS, 1)


def test_search_after_a_restart_begins_where_an_uninterrupted_one_does(
    cycles: list[Telemetry], tmp_path: Path
):
    given = {"hours_per_cycle": HOURS, "history_folder": str(tmp_path / "one")}
    with monitor(given) as session:
        mount(session, FLAP)
        *_, expected = live(session, cycles[:3])
        [_, _, estimate] = session.estimates()
    given["history_folder"] = str(tmp_path / "two")
    with monitor(given) as session:
        mount(session, FLAP)
        live(session, cycles[:2])
    with monitor(given) as session:
        mount(session, FLAP)
        session.until(session.healths)
        [health] = live(session, cycles[2:3])
        [again] = session.estimates()
    assert again.warm_start
    assert (again.faults, again.evaluations) == (estimate.faults, estimate.evaluations)
    assert plain(health) == plain(expected)
