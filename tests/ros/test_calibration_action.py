# SPDX-License-Identifier: Apache-2.0
"""Calibration by action: feedback, cancellation and refused goals."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import Transition

from ema_interfaces import srv
from ema_interfaces.action import Calibrate
from ema_monitor.calibration.calibration import Calibration

from ..waiting import DEADLINE_S, wait_for
from .monitor_session import FLAP, Goal, MonitorSession, Source, in_window, monitor

calibrate = partial(Goal, kind=Calibrate, name="calibrate")


@pytest.fixture
def session(tmp_path: Path) -> Iterator[MonitorSession]:
    """A monitor that expects a calibration file for each actuator, with one actuator."""
    settings = {
        "calibration_file": f"{tmp_path}/{{actuator_id}}.yaml",
        "calibration_folder": str(tmp_path),
    }
    with monitor(settings) as running:
        running.mount()
        yield running


def rejections(session: MonitorSession) -> str:
    [task] = [item for item in session.node.tasks() if item.name == "identification"]
    return task.values["goal rejected"]


def test_feedback_counts_healthy_windows_and_names_refused_ones(
    session: MonitorSession, tmp_path: Path
):
    goal, source = calibrate(session, windows=2), Source()
    wait_for(lambda: goal.feedback, "the first feedback")
    blocks = source.cycle()
    session.feed(block for i, block in enumerate(blocks) if i != in_window(blocks))
    session.feed(source.cycle())
    session.feed(source.cycle())
    status, result = goal.result()
    assert (status, result.success) == (GoalStatus.STATUS_SUCCEEDED, True), result.message
    calibration = Calibration.load(tmp_path / "flap.yaml")
    assert (calibration.calibration_id, calibration.windows) == (result.calibration_id, 2)
    assert "fitted to 2 windows" in result.message
    assert "deprecated" not in result.message
    wait_for(lambda: len(goal.feedback) >= 4, "the last feedback")
    counts = [(item.windows, item.missing) for item in goal.feedback]
    assert counts == [(0, 2), (0, 2), (1, 1), (2, 0)]
    assert ["gap" in item.refused for item in goal.feedback] == [False, True, False, False]


def test_cancelled_calibration_changes_nothing_and_allows_another(
    session: MonitorSession, tmp_path: Path
):
    goal, source = calibrate(session, windows=2), Source()
    session.feed(source.cycle())
    wait_for(lambda: goal.feedback and goal.feedback[-1].windows == 1, "a window")
    goal.cancel()
    status, result = goal.result()
    assert (status, result.success) == (GoalStatus.STATUS_CANCELED, False)
    assert (result.message, result.calibration_id) == ("cancelled", "")
    assert not list(tmp_path.iterdir())
    goal = calibrate(session, windows=1)
    session.feed(source.cycle())
    assert goal.result()[1].success


def test_second_goal_for_an_actuator_is_rejected_by_its_name(session: MonitorSession, capfd):
    session.describe(replace(FLAP, actuator_id="left"))
    session.until_status("left telemetry", "no telemetry so far")
    first = calibrate(session, actuator_id="left")
    wait_for(lambda: first.feedback, "the first feedback")
    assert not calibrate(session, actuator_id="left").is_accepted
    reason = "actuator 'left' is already being calibrated"
    assert f"goal of calibrate rejected: {reason}" in capfd.readouterr().err
    assert rejections(session) == reason
    request = srv.Calibrate.Request(actuator_id="left")
    assert session.call(srv.Calibrate, "/ema/monitor/calibrate", request).message == reason
    second = calibrate(session, actuator_id="flap", windows=1)
    session.feed(Source().cycle())
    assert second.result()[1].success
    first.cancel()
    assert first.result()[0] == GoalStatus.STATUS_CANCELED


def test_goal_reserves_its_actuator_when_it_is_accepted(session: MonitorSession, monkeypatch):
    begin = threading.Event()
    baselines = session.node.work.baselines
    monkeypatch.setattr(baselines, "learns", lambda _: not begin.wait(DEADLINE_S))
    first = calibrate(session, actuator_id="")
    # So far the first goal has only been accepted.
    assert not calibrate(session).is_accepted
    assert rejections(session) == "actuator 'flap' is already being calibrated"
    begin.set()
    wait_for(lambda: first.feedback, "the first feedback")
    first.cancel()
    assert first.result()[0] == GoalStatus.STATUS_CANCELED
    # A failed goal releases its actuator.
    assert calibrate(session, windows=0).result()[0] == GoalStatus.STATUS_ABORTED
    assert calibrate(session).is_accepted


@pytest.mark.parametrize(
    ("goal", "text"),
    [
        ({"windows": 0}, "windows = 0: expected 1 to 200 healthy windows"),
        ({"load": True, "file": "nowhere.yaml"}, "nowhere.yaml does not exist: calibrate on"),
        ({"force": True}, "person: expected 1 to 60 printable characters"),
    ],
)
def test_impossible_calibration_is_aborted_with_the_reason(session: MonitorSession, goal, text):
    status, result = calibrate(session, **goal).result()
    assert (status, result.success, result.calibration_id) == (GoalStatus.STATUS_ABORTED, False, "")
    assert text in result.message


def test_monitor_calibrates_known_actuators_while_it_is_active(session: MonitorSession):
    assert not calibrate(session, actuator_id="rudder").is_accepted
    assert "'rudder' is not monitored" in rejections(session)
    waiting = calibrate(session)
    wait_for(lambda: waiting.feedback, "the first feedback")
    assert session.change_state(Transition.TRANSITION_DEACTIVATE)
    status, result = waiting.result()
    assert (status, result.message) == (GoalStatus.STATUS_ABORTED, "the monitor is not active")
    assert not calibrate(session).is_accepted
    assert rejections(session) == "the monitor is not active"


def test_impossible_request_is_logged_once(session: MonitorSession, capfd):
    def logged() -> list[str]:
        printed = capfd.readouterr().err.splitlines()
        return [line.partition("flap: ")[2] for line in printed if "flap: " in line]

    for windows in (0, 500):
        calibrate(session, windows=windows).result()
        text = f"not calibrated: windows = {windows}: expected 1 to 200 healthy windows"
        assert logged() == [text]
    goal = calibrate(session)
    wait_for(lambda: goal.feedback, "the first feedback")
    assert logged() == ["calibration is requested"]
    session.call(srv.Calibrate, "/ema/monitor/calibrate", srv.Calibrate.Request())
    assert logged() == ["not calibrated: actuator 'flap' is already being calibrated"]


def test_inactive_monitor_loads_a_calibration(session: MonitorSession, tmp_path: Path):
    shipped = Calibration.builtin()
    shipped.save(tmp_path / "shipped.yaml")
    assert session.change_state(Transition.TRANSITION_DEACTIVATE)
    status, result = calibrate(session, load=True, file="shipped.yaml").result()
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert result.calibration_id == shipped.calibration_id
    assert not calibrate(session).is_accepted


@pytest.mark.parametrize(
    "transitions",
    [
        (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP),
        (Transition.TRANSITION_ACTIVE_SHUTDOWN,),
    ],
    ids=["cleanup", "shutdown"],
)
def test_goal_gets_its_result_before_its_action_is_destroyed(session: MonitorSession, transitions):
    goal = calibrate(session)
    wait_for(lambda: goal.feedback, "the first feedback")
    for transition in transitions:
        assert session.change_state(transition)
    status, result = goal.result()
    assert (status, result.message) == (GoalStatus.STATUS_ABORTED, "the monitor is not active")
