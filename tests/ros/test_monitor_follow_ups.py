"""What a monitor publishes beside estimate and health: forecast and fit, latched, in order."""

import threading
from collections.abc import Iterator
from functools import partial
from math import isnan
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from ema_interfaces.msg import Advice, HealthForecast
from ema_interfaces.srv import GetHistory
from ema_monitor.identification.window_fit import MOST_VALUES
from ema_monitor.node.follow_ups import MOST_WAITING, FollowUps
from ema_ros import topics

from ..waiting import DEADLINE_S
from .monitor_session import FLAP, MonitorSession, monitor
from .worn_actuator import HOURS, live, worn_cycles

TESTS = 16


@pytest.fixture(scope="module")
def session() -> Iterator[MonitorSession]:
    costs = {"costs.removal": 1.0, "costs.failure": 10.0, "costs.unit": "removals"}
    with monitor({"hours_per_cycle": HOURS, "history_folder": "", **costs}) as running:
        running.describe()
        for number, cycle in enumerate(worn_cycles(TESTS), 1):
            live(running, [cycle])
            for topic in (topics.HEALTH_FORECAST, topics.ADVICE, topics.WINDOW_FIT):
                # Latched topics keep the latest message alone.
                running.until(lambda key=topic, n=number: len(running.received(key)) >= n)
        yield running


def test_each_health_has_its_forecast(session: MonitorSession):
    healths = session.healths()
    forecasts = session.received(topics.HEALTH_FORECAST)
    assert [item.header.stamp for item in forecasts] == [item.header.stamp for item in healths]
    last, health = forecasts[-1], healths[-1]
    assert last.serial_number == FLAP.serial_number
    assert last.flight_hours == health.flight_hours
    assert list(last.probabilities) == [0.05, 0.5, 0.95]
    assert [item.name for item in last.faults] == [item.name for item in health.faults]
    for item, tracked in zip(last.faults, health.faults, strict=True):
        values = np.reshape(item.values, (3, len(last.hours)))
        assert np.all(np.diff(values, axis=0) >= 0.0)
        # Five standard deviations of the mean of 500 samples and the spread between the quantiles.
        assert values[0, 0] - 0.01 <= tracked.value <= values[2, 0] + 0.01


def test_each_estimate_has_the_fit_of_its_window(session: MonitorSession):
    fits, estimates = session.received(topics.WINDOW_FIT), session.estimates()
    assert [item.window for item in fits] == [item.window for item in estimates]
    last = fits[-1]
    assert (last.header.stamp, last.verdict) == (estimates[-1].window_end, estimates[-1].verdict)
    assert len(last.current) <= MOST_VALUES
    measured, expected = np.array(last.current), np.array(last.estimated_current)
    assert len(expected) == len(measured) == len(last.command)
    # The estimate is valid: its model is much nearer to the measured current than nothing is.
    assert np.std(measured - expected) < 0.3 * np.std(measured)


def test_each_health_has_an_advice(session: MonitorSession):
    advised, healths = session.received(topics.ADVICE), session.healths()
    assert [item.header.stamp for item in advised] == [item.header.stamp for item in healths]
    first, last = advised[0], advised[-1]
    # After one test nothing is known to grow; after sixteen, life is, and its end is far away.
    assert first.action == Advice.CONTINUE
    assert "no remaining life is known" in first.reason
    assert isnan(first.flight_hours)
    assert healths[-1].rul.known, healths[-1].rul.reason
    assert (last.action, last.cost_unit) == (Advice.CONTINUE, "removals")
    assert last.flight_hours == pytest.approx(last.from_now + healths[-1].flight_hours)
    assert last.from_now == pytest.approx(HOURS)
    assert 0.0 < last.expected_cost < last.cost_of_immediate_removal
    assert "the decision can wait for the next test" in last.reason


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


def test_the_oldest_are_dropped_and_counted():
    begun, may_go_on, done = threading.Event(), threading.Event(), []
    follow_ups = FollowUps(Mock())

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
    follow_ups.stop()  # what waits comes first
    assert done == [*range(9, MOST_WAITING + 9)]
