# SPDX-License-Identifier: Apache-2.0
"""A reloaded page shows the whole history of a unit: the monitor's history and later tests."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from ema_dashboard import unit_history
from ema_dashboard.unit_history import ActuatorHistory
from ema_interfaces.msg import (
    ActuatorDescription,
    FaultEstimate,
    Health,
    NodeStatus,
    TelemetryStatus,
    UnitEvent,
    UnitHistory,
    UnitTest,
)
from ema_interfaces.srv import GetHistory
from ema_ros import topics

from ...waiting import wait_for
from .session import DashboardSession

HISTORY = "/ema/unit_history"


class Monitor:
    """A fake monitor that publishes estimates and healths and answers GetHistory."""

    def __init__(self, session: DashboardSession, tests: int = 3, name: str = "monitor") -> None:
        self.node = session.node(name)
        self.tests, self.serial, self.asked = tests, "1", 0
        self.while_asked: Callable[[], None] = lambda: None
        self._estimates = self.node.create_publisher(FaultEstimate, "fault_estimate", topics.STATE)
        self._healths = self.node.create_publisher(Health, "health", topics.ALIVE)
        self.node.create_service(GetHistory, "~/get_history", self._answer)

    def publish(self, sec: int, window: int = 0, *, events: tuple[UnitEvent, ...] = ()) -> None:
        self._estimates.publish(estimate(sec, window))
        self._healths.publish(health(sec, events))

    def _answer(self, request: GetHistory.Request, response: GetHistory.Response) -> Any:
        self.asked += 1
        response.success = request.actuator_id == "flap"
        response.history = UnitHistory(actuator_id="flap", serial_number=self.serial, omitted=7)
        response.history.tests = [unit_test(sec) for sec in range(self.tests)]
        self.while_asked()
        return response


def estimate(sec: int, window: int = 0) -> FaultEstimate:
    message = FaultEstimate(actuator_id="flap", serial_number="1", window=window, valid=True)
    message.header.stamp.sec = sec
    message.faults.friction, message.faults.gain = 0.25, 0.5
    message.covariance[0] = 1e-4
    message.unobservable = FaultEstimate.BACKLASH
    message.insignificant = FaultEstimate.GAIN
    return message


def event(sec: int, kind: str, text: str) -> UnitEvent:
    message = UnitEvent(kind=kind, text=text)
    message.stamp.sec = sec
    return message


def health(sec: int, events: tuple[UnitEvent, ...] = ()) -> Health:
    message = Health(actuator_id="flap", serial_number="1", level=1, health_index=0.5)
    message.header.stamp.sec = sec
    message.flight_hours, message.cycles, message.events = 10.0 * sec, sec, list(events)
    message.rul.known, message.rul.hours_50 = True, 321.0
    return message


def unit_test(sec: int) -> UnitTest:
    test = UnitTest(flight_hours=float(sec))
    test.stamp.sec = sec
    return test


def news(history: ActuatorHistory) -> UnitHistory:
    message = history.news()
    assert message is not None
    assert message.is_addition
    return message


def stamps(message: Any) -> list[int]:
    return [test.stamp.sec for test in message.tests]


def latest(viewer: Any) -> Any:
    return viewer.received[HISTORY][-1][1] if viewer.received[HISTORY] else None


def test_history_survives_a_reload_and_continues_with_published_tests(session):
    monitor = Monitor(session)
    monitor.publish(2)
    node = session.dashboard()
    first = session.view(node, HISTORY)
    wait_for(lambda: latest(first) and stamps(latest(first)) == [0, 1, 2], "the base")
    assert latest(first).omitted == 7
    watcher = session.view(node, "/ema/health")
    monitor.publish(3, 1, events=(event(3, "step", "friction rose"), event(1, "restart", "x")))
    watcher.wait_until_received("/ema/health", lambda received: received.header.stamp.sec == 3)
    first.close()

    def reloaded() -> Any:
        again = session.view(node, HISTORY)
        message = again.wait_for(HISTORY)[-1]
        return stamps(message) == [0, 1, 2, 3] and message

    message = wait_for(reloaded, "the history with the new test")
    test = message.tests[-1]
    assert test.faults[0] == 0.25
    assert test.sigmas[0] == pytest.approx(0.01, rel=1e-12)  # a square root, exact but for rounding
    assert math.isnan(test.faults[1])
    assert math.isnan(test.sigmas[1])
    assert (test.flight_hours, test.cycles, test.level) == (30.0, 3, 1)
    assert (test.rul_known, test.rul_50, test.insignificant) == (True, 321.0, FaultEstimate.GAIN)
    events = [(event.kind, event.text, event.stamp.sec) for event in message.events]
    assert events == [("step", "friction rose", 3), ("restart", "x", 1)]
    assert monitor.asked == 1


def test_history_is_requested_again_after_a_restart_of_the_monitor(session):
    monitor = Monitor(session)
    viewer = session.view(session.dashboard(), HISTORY, "/ema/fault_estimate")
    monitor.publish(2, 5)
    viewer.wait_for("/ema/fault_estimate")
    wait_for(lambda: monitor.asked == 1 and latest(viewer), "the first question")
    monitor.tests = 6
    monitor.publish(5, 0)
    wait_for(lambda: stamps(latest(viewer)) == list(range(6)), "the new base")


def test_history_is_requested_again_if_the_monitor_restarts_meanwhile(session):
    monitor, dashboard = Monitor(session), session.dashboard()
    viewer = session.view(dashboard, HISTORY)

    def begin_anew() -> None:
        # The answer to this request is still on its way.
        if monitor.asked == 1:
            monitor.tests = 6
            dashboard._histories["/ema"].note(estimate(5, 0))

    monitor.while_asked = begin_anew
    monitor.publish(2, 5)
    wait_for(lambda: latest(viewer) and stamps(latest(viewer)) == list(range(6)), "the new base")


def test_replaced_unit_has_a_separate_history(session):
    monitor = Monitor(session)
    monitor.publish(2)
    description = session.source.create_publisher(
        ActuatorDescription, "actuator_description", topics.LATCHED
    )
    viewer = session.view(session.dashboard(), HISTORY)
    wait_for(lambda: latest(viewer) and stamps(latest(viewer)) == [0, 1, 2], "the base")
    monitor.serial, monitor.tests = "2", 1
    description.publish(ActuatorDescription(actuator_id="flap", serial_number="2"))
    wait_for(
        lambda: latest(viewer).serial_number == "2" and stamps(latest(viewer)) == [0],
        "the history of the new unit",
    )


def test_tests_are_shown_without_a_monitor_that_has_histories(session):
    node = session.dashboard()
    estimates = session.source.create_publisher(FaultEstimate, "fault_estimate", topics.STATE)
    healths = session.source.create_publisher(Health, "health", topics.ALIVE)
    watcher = session.view(node, "/ema/health", "/ema/fault_estimate")
    # Publish the health first: there is no order between topics.
    healths.publish(health(4))
    watcher.wait_for("/ema/health")
    wait_for(estimates.get_subscription_count, "a subscription")
    estimates.publish(estimate(4))
    watcher.wait_for("/ema/fault_estimate")
    [message] = session.view(node, HISTORY).wait_for(HISTORY)
    assert stamps(message) == [4]


def test_a_history_is_bounded(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(unit_history, "MOST_TESTS", 20)
    monkeypatch.setattr(unit_history, "MOST_EVENTS", 5)
    history = ActuatorHistory("flap", "1")
    for sec in range(30):
        history.note_estimate(estimate(sec, sec))
        history.note_health(health(sec, (event(sec, "outlier", f"number {sec}"),)))
    message: Any = history.message()
    assert len(message.tests) == 20
    assert message.omitted == 10
    assert message.tests[-1].stamp.sec == 29
    assert len(message.events) == 5


def test_repeated_event_is_stored_once():
    history, reported = ActuatorHistory("flap", "1"), event(5, "step", "friction rose")
    history.note_health(health(5, (reported,)))
    history.note_health(health(5, (reported,)))
    history.set_base(UnitHistory(actuator_id="flap", serial_number="1", events=[reported]))
    history.note_health(health(5, (reported,)))
    assert history.message().events == [reported]


def test_events_of_the_dashboard_stay_in_the_history():
    history = ActuatorHistory("flap", "1")
    refused = estimate(6, 1)
    refused.valid, refused.verdict = False, FaultEstimate.REFUSED
    refused.reason, refused.lacks_calibration = "there is no calibration yet", True
    history.note_health(health(5))
    assert not history.note_estimate(estimate(5, 0))
    assert [test.cycles for test in news(history).tests] == [5]
    assert not history.note_estimate(refused)
    [missing] = news(history).events
    assert (missing.kind, missing.text) == ("calibration", refused.reason)
    assert not history.note_estimate(refused)
    assert history.news() is None
    assert history.note_estimate(estimate(7, 0))
    [restart] = news(history).events
    assert restart.kind == "restart"
    history.note_gap(restart.stamp, 1)
    [gap] = news(history).events
    assert (gap.kind, gap.text, gap.flight_hours) == ("gap", "1 sample of telemetry missing", 50.0)
    base = UnitHistory(actuator_id="flap", serial_number="1", tests=[unit_test(5), unit_test(9)])
    history.set_base(base)  # as after another request to the monitor
    assert history.message().events == [missing, restart, gap]


def test_refusal_that_mentions_a_calibration_is_not_a_calibration_event():
    """The reason may compare the record with the calibration."""
    history = ActuatorHistory("flap", "1")
    refused = estimate(6, 1)
    refused.valid, refused.verdict = False, FaultEstimate.REFUSED
    refused.reason = "the effort differs from the effort of the calibration: compare the mapping"
    assert not history.note_estimate(refused)
    assert history.news() is None


def test_record_of_a_learning_joint_is_not_a_calibration_event():
    history = ActuatorHistory("flap", "1")
    for sec, codes in ((6, ["learning"]), (7, ["learning", "samples_lost"]), (8, ["learning"])):
        record = estimate(sec, sec)
        record.valid, record.verdict = False, FaultEstimate.REFUSED
        record.lacks_calibration, record.reason_codes = True, codes
        record.reason = "learning: 4 records on 1 day"
        history.note_estimate(record)
    assert history.news() is None


def test_tests_that_a_monitor_lost_are_reported_as_an_event():
    history = ActuatorHistory("flap", "1")
    base = UnitHistory(actuator_id="flap", serial_number="1", tests=[unit_test(n) for n in (1, 2)])
    history.set_base(base)
    base.tests, base.omitted = [unit_test(2), unit_test(3)], 1
    history.set_base(base)
    assert not history.message().events
    base.tests, base.omitted = [unit_test(8)], 0
    history.set_base(base)
    [reported] = history.message().events
    assert (reported.stamp.sec, reported.kind) == (8, "history")
    assert reported.text == "the monitor started a new history, without 2 earlier tests"


def test_a_restart_that_the_monitor_reports_is_not_reported_twice():
    history = ActuatorHistory("flap", "1")
    history.note_estimate(estimate(5, 3))
    history.note_health(health(5, (event(6, "restart", "the monitor started"),)))
    history.news()
    assert history.note_estimate(estimate(7, 0))
    assert history.news() is None


def test_a_gap_is_reported_at_once_and_shown_after_a_reload(session):
    monitor = Monitor(session)
    status = session.source.create_publisher(NodeStatus, "node_status", 10)
    node = session.dashboard()
    viewer = session.view(node, HISTORY)
    monitor.publish(2)
    wait_for(lambda: latest(viewer) and stamps(latest(viewer)) == [0, 1, 2], "the base")

    def lost(samples: int) -> None:
        counts = TelemetryStatus(actuator_id="flap", samples_lost=samples)
        status.publish(NodeStatus(node="/ema/monitor", telemetry=[counts]))

    def is_told() -> bool:
        lost(3)
        lost(8)  # same stamp: the same event, even if repeated
        return latest(viewer).is_addition

    wait_for(is_told, "what is new")
    [reported] = latest(viewer).events
    assert (reported.kind, reported.text) == ("gap", "5 samples of telemetry missing")
    assert latest(viewer).tests == []
    viewer.close()
    reloaded = session.view(node, HISTORY).wait_for(HISTORY)[0]
    assert not reloaded.is_addition
    assert stamps(reloaded) == [0, 1, 2]
    assert [item.text for item in reloaded.events] == [reported.text]


def test_base_keeps_tests_received_after_it():
    history = ActuatorHistory("flap", "1")
    for sec in (5, 6):
        history.note_estimate(estimate(sec, sec))
        history.note_health(health(sec))
    base = UnitHistory(actuator_id="flap", serial_number="1", tests=[unit_test(0), unit_test(5)])
    base.events = [UnitEvent(kind="repair", text="new gear")]
    history.set_base(base)
    assert stamps(history.message()) == [0, 5, 6]
    history.rewind(5 * 10**9)
    assert stamps(history.message()) == [0, 5]


def test_stale_health_does_not_replace_the_health_after_the_test():
    history = ActuatorHistory("flap", "1")
    history.note_estimate(estimate(5))
    history.note_health(health(5))
    overdue = health(5)
    overdue.level, overdue.health_index = 3, math.nan
    history.note_health(overdue)
    [test] = history.message().tests
    assert (test.level, test.health_index) == (1, 0.5)
