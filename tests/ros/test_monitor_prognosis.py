"""Remaining useful life as other nodes see it: health, usage, the service and the history."""

import math
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import Health
from ema_monitor.unit import Unit
from ema_ros import topics

from ..waiting import DEADLINE_S, wait_for
from .graph import Graph
from .monitor_session import FLAP, MonitorSession, monitor
from .spinning import figures
from .worn_actuator import HOURS, count, friction, live, plain, predict, replaced, worn_cycles

OK, WARN, ERROR, STALE = 0, 1, 2, 3
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


def test_health_tells_growth_and_what_is_not_known(health: Health):
    items = {item.name: item for item in health.faults}
    now = friction(TESTS - 1)
    assert items["friction"].value == pytest.approx(now, abs=0.02)
    assert items["friction"].trend == pytest.approx(0.0075 * (now + 0.05), rel=0.4)
    assert items["friction"].sigma > 0.0
    assert not items["gain"].rul.known
    assert items["gain"].rul.reason == "no significant growth"
    assert np.isnan([items["gain"].rul.hours_50, items["gain"].rul.cycles_50]).all()


def test_health_tells_of_required_performances_in_their_units(health: Health):
    items = {item.name: item for item in health.requirements}
    units = {name: item.unit for name, item in items.items()}
    assert units == {
        "tracking_error": "rad",
        "bandwidth": "Hz",
        "free_play": "rad",
        "torque_margin": "1",
    }
    assert items["bandwidth"].limit_is_lower
    assert items["bandwidth"].limit == 12.0
    assert items["bandwidth"].value > 20.0
    # Friction grows, and takes torque.
    assert items["torque_margin"].trend < 0.0


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
        ((0.0, ""), ["duty = 0 -", "[0.001, 1000]"]),
        ((-2.0, ""), ["duty = -2 -", "[0.001, 1000]"]),
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


def test_law_that_becomes_known_has_the_history_told_anew(session: MonitorSession):
    def width() -> float:
        life = predict(session, 1.0).health.rul_faults
        return life.hours_95 - life.hours_05

    unknown = width()
    law = {"known_law.friction": "exponential:7.5e-3:0.05"}
    assert session.set_parameter_values(law)[0].successful
    try:
        assert width() < 0.7 * unknown
    finally:
        assert session.set_parameter_values({"known_law.friction": ""})[0].successful
    assert width() == unknown


def test_impossible_settings_of_prognosis_are_refused_by_name(session: MonitorSession):
    wanted = {
        "duty": 0.0,
        "hours_per_cycle": -1.0,
        "requirements.bandwidth": -1.0,
        "tracker.process_noise": 9.0,
        "known_law.friction": "cubic",
        "history_folder": "elsewhere",
    }
    for name, value in wanted.items():
        [answer] = session.set_parameter_values({name: value})
        assert not answer.successful, name
        assert name in answer.reason or "read-only" in answer.reason


def test_restart_goes_on_where_the_history_ends(cycles: list[Telemetry], folder: Path, session):
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
        [after] = live(restarted, cycles[TESTS : TESTS + 1])
        assert (after.flight_hours, after.cycles) == (HOURS * (TESTS + 1), TESTS + 1)
        assert after.rul.known
        assert after.rul_faults.hours_50 == pytest.approx(
            before.health.rul_faults.hours_50 - HOURS, rel=0.3
        )


def test_second_monitor_of_a_unit_leaves_the_history_alone(
    cycles: list[Telemetry], folder: Path, session: MonitorSession
):
    [file] = folder.glob("*.sqlite")
    content = file.read_bytes()
    with monitor({"hours_per_cycle": HOURS, "history_folder": str(folder)}) as second:
        second.describe()
        live(second, cycles[:1])
        second.until_status("flap history", "in use by another monitor", b"\x01")
    assert file.read_bytes() == content


def test_corrupted_history_is_told_in_health_and_status(cycles: list[Telemetry], tmp_path: Path):
    file = tmp_path / "flap+SIM-0001.sqlite"
    file.write_text("not a history\n")
    with monitor({"hours_per_cycle": HOURS, "history_folder": str(tmp_path)}) as session:
        session.describe()
        first, second = live(session, cycles[:2])
        session.until_status("flap history", "set aside", b"\x01")
    assert any("set aside" in event.text for event in first.events)
    assert (second.cycles, second.events) == (2, [])
    assert (tmp_path / "flap+SIM-0001.set_aside_1.sqlite").read_text() == "not a history\n"


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
            wait_for(lambda: session.node._units["flap"].finder.blocks == 2, "the second block")
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


def count_at(session: MonitorSession, stamp_ns: int) -> bool:
    """Return whether the monitor has received the count of a stamp."""
    unit = FLAP.actuator_id, FLAP.serial_number
    latest = session.node._prognosis._histories.counts.latest(unit, stamp_ns)
    return latest is not None and latest.stamp_ns == stamp_ns


@pytest.mark.slow
def test_replayed_bag_gives_the_health_of_the_live_monitor(cycles: list[Telemetry], tmp_path: Path):
    """Usage included; and leaves the history of the living as it is."""
    n = 8
    path, living = tmp_path / "tests.mcap", tmp_path / "living"
    tests = [[b.part(i, min(i + 500, len(b))) for i in range(0, len(b), 500)] for b in cycles[:n]]
    counts = [count(HOURS * (number + 3), tests[number][0].stamp_ns) for number in range(n)]
    writer = BagWriter(path)
    usage = f"{topics.NAMESPACE}/{topics.USAGE}"
    with SimulatedActuatorBag(writer, ActuatorDescription()) as recording:
        for usage_message, parts in zip(counts, tests, strict=True):
            stamp_ns = parts[0].stamp_ns
            writer.write(usage, usage_message, stamp_ns, stamp_ns)
            for part in parts:
                recording.write_block(part, 0.0)
    with monitor({"history_folder": str(living)}) as session:
        session.describe()
        for number, (usage_message, parts) in enumerate(zip(counts, tests, strict=True), 1):
            session.send(topics.USAGE, usage_message)
            # Nothing orders messages of two topics, and these blocks come all at once.
            stamp_ns = parts[0].stamp_ns
            wait_for(lambda stamp_ns=stamp_ns: count_at(session, stamp_ns), "the count")
            session.feed(parts)
            session.until(lambda number=number: len(session.healths()) >= number)
        expected = session.healths()
    [file] = living.glob("*.sqlite")
    content = file.read_bytes()
    with Graph() as graph:
        graph.start("monitor", use_sim_time=True, history_folder=living)
        graph.wait_for(lambda: graph.status, "the monitor")
        graph.start("player", bag=path, rate=3.0, actuator_only=True)
        graph.wait_for(lambda: len(graph.healths) >= n, "the health after each test")
        assert graph.status["/ema/monitor: flap history"][2]["file"] == "none, in memory only"
    assert [plain(item) for item in graph.healths] == [plain(item) for item in expected]
    assert file.read_bytes() == content
    assert [item.flight_hours for item in expected] == [HOURS * (i + 3) for i in range(n)]
