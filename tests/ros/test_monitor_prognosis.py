"""Remaining useful life as other nodes see it: health, usage, the service and the history."""

import math
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ema_core.telemetry import Telemetry
from ema_interfaces.msg import Health
from ema_monitor.unit import Unit

from ..waiting import DEADLINE_S, wait_for
from .monitor_session import MonitorSession, monitor
from .spinning import figures
from .worn_actuator import HOURS, live, plain, predict, replaced, worn_cycles

WARN, STALE = 1, 3
TESTS = 18


@pytest.fixture(scope="module")
def cycles() -> list[Telemetry]:
    return worn_cycles(TESTS + 2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("histories")


@pytest.fixture(scope="module")
def session(cycles: list[Telemetry], folder: Path) -> Iterator[MonitorSession]:
    """A monitor that has followed an actuator over its tests."""
    with monitor({"hours_per_cycle": HOURS, "history_folder": str(folder)}) as running:
        running.describe()
        live(running, cycles[:TESTS])
        yield running


@pytest.fixture(scope="module")
def health(session: MonitorSession) -> Health:
    return session.healths()[TESTS - 1]


def test_health_tells_how_long_it_will_last(health: Health):
    truth = math.log(11.0) / 0.0075 - HOURS * (TESTS - 1)
    [item] = [item for item in health.faults if item.name == "friction"]
    for life in (item.rul, health.rul_faults):
        assert life.known, life.reason
        assert life.hours_05 < truth < life.hours_95
        assert life.cycles_50 == pytest.approx(life.hours_50 / HOURS)
        assert (life.criterion, life.reason) == ("friction exceeds 0.5", "")
    assert health.rul.known
    assert health.rul.hours_50 <= health.rul_faults.hours_50
    assert health.rul.cycles_05 == pytest.approx(health.rul.hours_05 / HOURS)
    assert (health.flight_hours, health.cycles, health.duty) == (HOURS * TESTS, TESTS, 1.0)
    assert health.assumption
    assert health.dominant_fault in ("friction", *(item.name for item in health.requirements))


def test_status_carries_life_and_history(session: MonitorSession, folder: Path):
    history = session.until_status("flap history", f"{TESTS} tests", b"\x00")
    [file] = folder.glob("*.sqlite")
    assert {item.key: item.value for item in history.values}["file"] == str(file)
    life = session.until_status("flap health", f": {session.healths()[-1].dominant_fault}")
    values = figures(life)
    assert values["remaining life 50 % [h]"] == pytest.approx(
        session.healths()[-1].rul.hours_50, rel=1e-4
    )
    assert values["flight hours [h]"] == HOURS * TESTS


def test_service_tells_life_at_another_duty_and_changes_nothing(
    session: MonitorSession, health: Health
):
    now, twice = predict(session, 1.0).health, predict(session, 2.0, "flap").health
    expected = health.rul_faults.hours_50 / 2
    assert twice.duty == 2.0
    assert twice.rul_faults.hours_50 == pytest.approx(expected)
    assert twice.rul_faults.cycles_50 == pytest.approx(expected / HOURS)
    assert twice.assumption != now.assumption
    messages = [plain(replaced(message)) for message in (now, health)]
    assert messages[0] == messages[1]
    assert len(session.healths()) == TESTS


@pytest.mark.parametrize(
    ("request_", "texts"),
    [
        ((math.nan, ""), ["duty = nan", "[0.001, 1000]"]),
        ((1.0, "rudder"), ["rudder", "not monitored", "flap"]),
    ],
)
def test_service_refuses_what_is_impossible_by_name(
    session: MonitorSession, request_: tuple[float, str], texts: list[str]
):
    answer = predict(session, *request_)
    assert not answer.success
    assert all(text in answer.message for text in texts), answer.message


def test_restart_tells_what_was_known_as_old(folder: Path, session):
    """Of what the first monitor left in the file alone, while that one still runs."""
    copy = folder.with_name("copied")
    copy.mkdir()
    [file] = folder.glob("*.sqlite")
    (copy / file.name).write_bytes(file.read_bytes())
    with monitor({"hours_per_cycle": HOURS, "history_folder": str(copy)}) as restarted:
        restarted.describe()
        restarted.until_status("flap telemetry", "no telemetry so far")
        before = predict(restarted, 1.0)
        assert before.success, before.message
        # What was known is published before any new test, marked as old.
        [again] = restarted.until(restarted.healths)
        assert (again.level, again.confidence, again.header) == (
            STALE, 0.0, session.healths()[TESTS - 1].header,
        )  # fmt: skip
        assert again.reason == "no valid estimate for more than 3000 s"
        first = session.healths()[TESTS - 1]
        assert (before.health.level, before.health.last_level) == (STALE, first.level)
        for item in ("rul", "rul_faults", "rul_requirements", "removal", "cycles"):
            assert str(getattr(again, item)) == str(getattr(before.health, item))
            assert str(getattr(again, item)) == str(getattr(first, item))


def test_telemetry_is_received_while_a_prognosis_is_made(
    cycles: list[Telemetry], monkeypatch: pytest.MonkeyPatch
):
    begun, go_on = threading.Event(), threading.Event()
    threads = []
    update = Unit.update

    def slow(self: Unit, *args: Any) -> Any:
        threads.append(threading.current_thread().name)
        begun.set()
        assert go_on.wait(DEADLINE_S)
        return update(self, *args)

    monkeypatch.setattr(Unit, "update", slow)
    with monitor() as session:
        session.describe()
        session.feed(cycles[:1])
        assert begun.wait(DEADLINE_S)
        try:
            session.feed([cycles[1].part(0, 5000)])
            wait_for(lambda: session.node.units["flap"].finder.blocks == 2, "the second block")
            assert not session.healths()
        finally:
            go_on.set()
        session.until(session.healths)
    # What the end cuts off is refused by who ends it.
    assert threads[0] == "identification"


def test_prognosis_that_fails_costs_neither_estimate_nor_alarm(
    cycles: list[Telemetry], monkeypatch: pytest.MonkeyPatch
):
    def fail(*_: Any) -> Any:
        raise FloatingPointError("made up")

    monkeypatch.setattr(Unit, "update", fail)
    with monitor({"hours_per_cycle": HOURS}) as session:
        session.describe()
        [health] = live(session, cycles[TESTS + 1 :])
        assert [estimate.valid for estimate in session.estimates()] == [True]
        assert (health.level, health.dominant_fault) == (WARN, "friction")
        assert "made up" in health.rul.reason
        assert "made up" in health.reason
        assert health.header.stamp == session.estimates()[0].window_end
