# SPDX-License-Identifier: Apache-2.0
"""Messages that follow an estimate: health, life, forecast, advice, fit and history."""

import math
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from ema_core.telemetry import Telemetry
from ema_interfaces.msg import Advice, Health, HealthForecast
from ema_interfaces.srv import GetHistory, NoteEvent
from ema_monitor.identification.window_fit import MOST_VALUES
from ema_monitor.node.work import follow_ups as follow_ups_module
from ema_monitor.node.work.follow_ups import MOST_WAITING, FollowUps
from ema_monitor.unit import Unit
from ema_ros import topics

from ..waiting import DEADLINE_S, wait_for
from .monitor_session import FLAP, MonitorSession, monitor
from .spinning import figures
from .worn_actuator import HOURS, live, plain, predict, replaced, worn_cycles

WARN = 1
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
    costs = {"costs.removal": 1.0, "costs.failure": 10.0, "costs.unit": "removals"}
    settings = {"hours_per_cycle": HOURS, "history_folder": str(folder), **costs}
    with monitor(settings) as running:
        running.describe()
        for number, cycle in enumerate(cycles[:TESTS], 1):
            live(running, [cycle])
            for topic in (topics.HEALTH_FORECAST, topics.ADVICE, topics.WINDOW_FIT):
                # Latched topics keep the latest message only.
                running.until(lambda key=topic, n=number: len(running.received(key)) >= n)
        yield running


@pytest.fixture(scope="module")
def health(session: MonitorSession) -> Health:
    return session.healths()[TESTS - 1]


def test_status_contains_life_and_history(session: MonitorSession, folder: Path):
    history = session.until_status("flap history", f"{TESTS} tests", b"\x00")
    [file] = folder.glob("*.sqlite")
    assert {item.key: item.value for item in history.values}["file"] == str(file)
    life = session.until_status("flap health", f": {session.healths()[-1].dominant_fault}")
    values = figures(life)
    assert values["remaining life 50 % [h]"] == pytest.approx(
        session.healths()[-1].rul.hours_50, rel=1e-4
    )
    assert values["service hours [h]"] == HOURS * TESTS


def test_service_reports_life_at_another_duty_and_changes_nothing(
    session: MonitorSession, health: Health
):
    now, twice = predict(session, 1.0).health, predict(session, 2.0, "flap").health
    expected = health.rul_faults.hours_50 / 2
    assert twice.growth_factor == 2.0
    assert twice.rul_faults.hours_50 == pytest.approx(expected)
    assert twice.rul_faults.cycles_50 == pytest.approx(expected / HOURS)
    assert twice.assumption != now.assumption
    messages = [plain(replaced(message)) for message in (now, health)]
    assert messages[0] == messages[1]
    assert len(session.healths()) == TESTS


def test_each_test_has_its_health_forecast_advice_and_fit(session: MonitorSession):
    ends = [item.window_end for item in session.estimates()]
    for topic in (topics.HEALTH, topics.HEALTH_FORECAST, topics.ADVICE, topics.WINDOW_FIT):
        assert [item.header.stamp for item in session.received(topic)] == ends, topic


def test_forecast_has_the_quantiles_of_each_fault(session: MonitorSession):
    last, health = session.received(topics.HEALTH_FORECAST)[-1], session.healths()[-1]
    assert last.serial_number == FLAP.serial_number
    assert last.flight_hours == health.flight_hours
    assert list(last.probabilities) == [0.05, 0.5, 0.95]
    assert [item.name for item in last.faults] == [item.name for item in health.faults]
    for item in last.faults:
        assert np.all(np.diff(np.reshape(item.values, (3, len(last.hours))), axis=0) >= 0.0)


def test_fit_has_measured_and_modelled_signals(session: MonitorSession):
    fits, estimates = session.received(topics.WINDOW_FIT), session.estimates()
    assert [item.window for item in fits] == [item.window for item in estimates]
    last = fits[-1]
    assert last.verdict == estimates[-1].verdict
    assert len(last.current) <= MOST_VALUES
    measured, expected = np.array(last.current), np.array(last.estimated_current)
    assert len(expected) == len(measured) == len(last.command)
    # The estimate is valid: its model explains most of the measured current.
    assert np.std(measured - expected) < 0.3 * np.std(measured)


def test_advice_follows_the_costs(session: MonitorSession):
    (first, *_, last), health = session.received(topics.ADVICE), session.healths()[-1]
    # After one test no growth is known. After the last test the life is known and long.
    assert first.action == Advice.CONTINUE
    assert "the remaining life is unknown" in first.reason
    assert math.isnan(first.flight_hours)
    assert health.rul.known, health.rul.reason
    assert (last.action, last.cost_unit) == (Advice.CONTINUE, "removals")
    assert last.flight_hours == pytest.approx(last.from_now + health.flight_hours)
    assert 0.0 < last.expected_cost < last.cost_of_immediate_removal


def test_late_subscriber_receives_the_latest_forecast(session: MonitorSession):
    key = "late forecast"
    session.subscribe(HealthForecast, f"/ema/{topics.HEALTH_FORECAST}", topics.LATCHED_BY_MANY, key)
    [late] = session.until(lambda: session.received(key))
    assert late == session.received(topics.HEALTH_FORECAST)[-1]


def get_history(session: MonitorSession, **request: Any) -> Any:
    return session.call(GetHistory, "/ema/monitor/get_history", GetHistory.Request(**request))


def test_history_is_limited_to_the_latest_tests(session: MonitorSession):
    history = get_history(session, actuator_id=FLAP.actuator_id, most=3).history
    assert (len(history.tests), history.omitted) == (3, TESTS - 3)
    assert history.tests[-1].stamp == session.healths()[-1].header.stamp
    refused = get_history(session, most=5001)
    assert not refused.success
    assert refused.message == "most = 5001: expected at most 5000 tests"
    unknown = get_history(session, actuator_id="rudder")
    assert "rudder" in unknown.message


def test_note_of_a_person_is_published_and_in_the_history(session: MonitorSession):
    def note(text: str) -> Any:
        request = NoteEvent.Request(actuator_id=FLAP.actuator_id, person=" Ada\n", text=text)
        return session.call(NoteEvent, "/ema/monitor/note_event", request)

    assert note("x" * 501).message == "text: expected 1 to 500 printable characters, not 501"
    assert note("bell \a").message.startswith("text: expected")
    assert note("greased").success
    session.until(lambda: [event.kind for event in session.healths()[-1].events] == ["note"])
    [event] = session.healths()[-1].events
    assert event.text.startswith("Ada, 20")
    assert event.text.endswith(" UTC: greased")
    assert event in get_history(session, actuator_id=FLAP.actuator_id).history.events


def test_oldest_follow_ups_are_dropped_and_counted():
    begun, may_go_on, done = threading.Event(), threading.Event(), []
    follow_ups = FollowUps(Mock(), Mock(), Mock(), Mock(), Mock())

    def wait() -> None:
        begun.set()
        assert may_go_on.wait(DEADLINE_S)

    follow_ups.start()
    follow_ups._add(wait)
    assert begun.wait(DEADLINE_S)
    for number in range(MOST_WAITING + 9):
        follow_ups._add(partial(done.append, number))
    assert (follow_ups.waiting, follow_ups.dropped) == (MOST_WAITING, 9)
    may_go_on.set()
    follow_ups.stop()  # waiting follow-ups are processed first
    assert done == [*range(9, MOST_WAITING + 9)]


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
            wait_for(lambda: session.node.actuators["flap"].finder.blocks == 2, "the second block")
            assert not session.healths()
        finally:
            go_on.set()
        session.until(session.healths)
    # A window cut off at the end is refused by the thread that stops the monitor.
    assert threads[0] == "identification"


def test_failed_prognosis_does_not_suppress_estimate_or_alarm(
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


def test_follow_ups_of_a_new_thread_wait_for_the_old_thread(monkeypatch):
    """Two threads would publish an older forecast after a newer one."""
    monkeypatch.setattr(follow_ups_module, "_JOIN_S", 0.0)
    follow_ups, may_end = FollowUps(Mock(), Mock(), Mock(), Mock(), Mock()), threading.Event()
    begun, done = threading.Event(), list[str]()

    def last_long() -> None:
        begun.set()
        assert may_end.wait(DEADLINE_S)
        done.append("long")

    follow_ups.start()
    follow_ups._add(last_long)
    assert begun.wait(DEADLINE_S)
    follow_ups._add(lambda: done.append("dropped"))
    follow_ups.stop()
    assert (follow_ups.waiting, follow_ups.dropped) == (0, 1)
    follow_ups.start()
    follow_ups._add(lambda: done.append("new"))
    assert not done
    may_end.set()
    wait_for(lambda: len(done) == 2, "the follow-ups")
    follow_ups.stop()
    assert done == ["long", "new"]
