# SPDX-License-Identifier: Apache-2.0
"""Calibration by the deprecated service, and identification by action."""

import gc
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import Transition
from rclpy.action.client import ActionClient

from ema_interfaces.action import IdentifyFaults
from ema_interfaces.msg import FaultEstimate, Health
from ema_interfaces.srv import Calibrate, GetHistory
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.optimizers import ALGORITHMS
from ema_ros import topics
from ema_ros.throttle import Throttle

from ..waiting import DEADLINE_S, wait_for
from .monitor_session import FLAP, Goal, MonitorSession, Source, corrupted, in_window, monitor
from .spinning import where_it_spins

NAME = "/ema/monitor/calibrate"
FORCED: dict[str, Any] = {"force": True, "person": "Ada"}
# Simultaneous goals: more than the threads of the node, and than the default depth of a service.
_GOALS = 50


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MonitorSession]:
    """A monitor that has identified one window of an actuator with friction."""
    folder = tmp_path_factory.mktemp("calibrations")
    settings = {"calibration_timeout_s": 1.0, "calibration_folder": str(folder)}
    with monitor(settings) as running:
        running.describe()
        running.feed(Source(friction=0.3).cycle())
        assert running.next_estimate().valid
        yield running


def calibrate(session: MonitorSession, **request: Any) -> Any:
    return session.call(Calibrate, NAME, Calibrate.Request(**request))


def waiting_calls(session: MonitorSession) -> list[Any]:
    works = session.node.work.worker.works.values()
    return [queue for work in works for queue in work.awaiting]


def until_waited_for(session: MonitorSession) -> None:
    wait_for(lambda: waiting_calls(session), "the call to wait for windows")


def test_inactive_monitor_refuses_a_calibration_in_one_line(tmp_path: Path, capfd):
    with monitor({"calibration_folder": str(tmp_path)}) as session:
        session.mount()
        assert session.change_state(Transition.TRANSITION_DEACTIVATE)
        capfd.readouterr()
        answer = calibrate(session, windows=1)
        assert (answer.success, answer.message) == (False, "the monitor is not active")
        printed = capfd.readouterr().err
    [line] = [line for line in printed.splitlines() if "calibrat" in line]
    assert "[WARN]" in line
    assert line.endswith("flap: not calibrated: the monitor is not active")


def test_latest_window_is_identified_with_the_requested_algorithm(session: MonitorSession):
    before = len(session.estimates())
    goal = Goal(session, algorithm="pso", budget=1500, seed=9)
    status, result = goal.result()
    assert (status, result.success) == (GoalStatus.STATUS_SUCCEEDED, True), result.message
    estimate = result.estimate
    assert (estimate.algorithm, estimate.seed, estimate.window) == ("pso", 9, 0)
    assert estimate.evaluations <= 1500
    assert estimate.window_start == session.estimates()[0].window_start
    generations = [item.generation for item in goal.feedback]
    assert generations == list(range(1, len(generations) + 1)) != []
    evaluations = [item.evaluations for item in goal.feedback]
    assert evaluations == sorted(evaluations)
    fitness = [item.best_fitness for item in goal.feedback]
    assert fitness == sorted(fitness, reverse=True)
    # After the search, insignificant faults are set to healthy and the rest is fitted again.
    assert goal.feedback[-1].best.friction == pytest.approx(estimate.faults.friction, abs=0.01)
    assert estimate.fitness < 1.1 * fitness[-1]
    assert not estimate.warm_start
    # The estimate is returned to the client and not published.
    assert len(session.estimates()) == before


def test_default_goal_gives_the_estimate_of_the_monitor(session: MonitorSession):
    _, result = Goal(session).result()
    published, returned = session.estimates()[0], result.estimate
    published.computing_time = returned.computing_time = 0.0
    assert str(published) == str(returned)


@pytest.mark.parametrize(
    ("goal", "texts"),
    [
        ({"algorithm": "tea_leaves"}, ["tea_leaves", *ALGORITHMS]),
        ({"seed": 2**63}, ["seed", "outside"]),
        ({"actuator_id": "rudder"}, ["rudder", "not monitored", "flap"]),
    ],
)
def test_impossible_goal_is_rejected_and_log_and_status_have_the_reason(
    session: MonitorSession, goal: dict[str, Any], texts: list[str], capfd
):
    session.node.work.goals._rejections = Throttle(1000.0)
    assert not any(Goal(session, **goal).is_accepted for _ in range(3))
    printed = capfd.readouterr().err
    assert printed.count("goal of identify_faults rejected") == 1
    assert all(text in printed for text in ("rejected", *texts)), printed
    [task] = [item for item in session.node.tasks() if item.name == "identification"]
    assert all(text in task.values["goal rejected"] for text in texts)


@pytest.mark.parametrize(
    ("goal", "texts"),
    [
        ({"budget": 20}, ["budget", "20", "at least"]),
        ({"next_window": True}, ["no window within 1 s"]),
    ],
)
def test_goal_that_fails_has_the_reason_and_no_figures(
    session: MonitorSession, goal: dict[str, Any], texts: list[str]
):
    status, result = Goal(session, **goal).result()
    assert (status, result.success) == (GoalStatus.STATUS_ABORTED, False)
    assert all(text in result.message for text in texts), result.message
    estimate = result.estimate
    assert (estimate.valid, estimate.verdict) == (False, FaultEstimate.REFUSED)
    assert math.isnan(estimate.faults.friction)
    assert math.isnan(estimate.fitness)
    assert all(map(math.isnan, estimate.covariance))


def test_identification_is_cancelled_within_a_generation(session: MonitorSession):
    goal = Goal(session, algorithm="pso", budget=10_000_000)
    wait_for(lambda: goal.feedback, "feedback")
    goal.cancel()
    status, result = goal.result()
    assert (status, result.success) == (GoalStatus.STATUS_CANCELED, False)
    assert "cancel" in result.message


def test_next_window_is_awaited_and_a_defective_one_has_its_reason(session: MonitorSession):
    assert session.set_parameters(calibration_timeout_s=DEADLINE_S)[0].successful
    source = Source(gain=0.6)
    blocks = source.cycle()
    blocks[in_window(blocks)] = corrupted(blocks[in_window(blocks)], "current", 0, float("nan"))
    for cycle, success in ((blocks, False), (source.cycle(), True)):
        goal = Goal(session, next_window=True)
        until_waited_for(session)
        session.feed(cycle)
        status, result = goal.result()
        assert result.success == success
        if success:
            assert result.estimate.faults.gain == pytest.approx(0.6, abs=0.02)
        else:
            assert status == GoalStatus.STATUS_ABORTED
            assert "current is nan" in result.message
    assert session.set_parameters(calibration_timeout_s=1.0)[0].successful


# Warnings of goals that were not begun when the node ended.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:coroutine:RuntimeWarning")
def test_many_waiting_goals_do_not_block_telemetry():
    with monitor() as session:
        session.describe()
        session.until_status("flap telemetry", "no telemetry so far")
        client = ActionClient(
            session.probe,
            IdentifyFaults,
            "/ema/monitor/identify_faults",
            goal_service_qos_profile=topics.SERVICE,
        )
        wait_for(client.server_is_ready, "the action")
        goal = IdentifyFaults.Goal(next_window=True, budget=617)
        sent = where_it_spins(
            session.probe, lambda: [client.send_goal_async(goal) for _ in range(_GOALS)]
        )
        wait_for(lambda sent=sent: all(item.done() for item in sent), "answers")
        answers = [item.result() for item in sent]
        assert [item is not None and item.accepted for item in answers].count(True) == 2
        session.feed(Source().cycle())
        assert session.next_estimate().valid
        del sent, answers
        where_it_spins(session.probe, client.destroy)
    gc.collect()


def test_calibration_is_fitted_stored_used_and_loaded(tmp_path: Path):
    file = f"{tmp_path}/{{actuator_id}}_{{serial_number}}.yaml"
    own_file = tmp_path / "flap_SIM-0001.yaml"
    source = Source()
    settings = {"calibration_file": file, "calibration_folder": str(tmp_path)}
    with monitor(settings) as session:
        session.describe()
        session.feed(source.cycle())
        refused = session.next_estimate()
        assert not refused.valid
        assert all(text in refused.reason for text in ("no calibration", str(own_file)))
        future = session.start(Calibrate, NAME, Calibrate.Request(windows=2))
        until_waited_for(session)
        blocks = source.cycle()
        # An unusable window is ignored by the calibration, and its estimate is published.
        session.feed(b for i, b in enumerate(blocks) if i != in_window(blocks))
        assert "gap" in session.next_estimate().reason
        session.feed(source.cycle())
        assert not session.next_estimate().valid
        assert not future.done()
        session.feed(source.cycle())
        answer = session.result(future)
        assert answer.success, answer.message
        assert str(own_file) in answer.message
        assert "not learned from the healthy windows: viscous friction" in answer.message
        calibration = Calibration.load(own_file)
        assert answer.calibration_id == calibration.calibration_id
        assert (calibration.windows, calibration.serial_number) == (2, FLAP.serial_number)
        session.next_estimate()
        session.feed(source.cycle())
        estimate = session.next_estimate()
        assert (estimate.valid, estimate.calibration_id) == (True, calibration.calibration_id)

        Calibration.builtin().save(tmp_path / "shipped.yaml")
        answer = calibrate(session, load=True, file="shipped.yaml")
        assert answer.success, answer.message
        assert answer.calibration_id == Calibration.builtin().calibration_id
        assert answer.message.endswith("this service is deprecated: use the action ~/calibrate")
        assert "not learned from the healthy windows: viscous friction" in answer.message
        session.feed(source.cycle())
        assert session.next_estimate().calibration_id == answer.calibration_id


def test_failed_calibration_states_the_reason(session: MonitorSession):
    for request, text in (
        ({"windows": 0}, "windows = 0"),
        ({"windows": 2**31 - 1}, "windows = 2147483647: expected 1 to 200 healthy windows"),
        ({"windows": 1}, "no healthy window within 1 s, after 0 of 1"),
        ({"windows": 1, "actuator_id": "rudder"}, "'rudder' is not monitored"),
        ({"load": True, "file": "nowhere.yaml"}, "nowhere.yaml does not exist: calibrate on"),
        ({"windows": 1, "file": "/dev/zero"}, "parameter calibration_folder"),
    ):
        answer = calibrate(session, **request, **FORCED)
        assert (answer.success, answer.calibration_id) == (False, "")
        assert text in answer.message


@pytest.mark.parametrize("request_", [{"windows": 1}, {"load": True, "file": "x.yaml"}])
def test_baseline_of_a_unit_in_warning_changes_only_if_forced_by_a_person(
    session: MonitorSession, request_: dict[str, Any]
):
    answer = calibrate(session, **request_)
    assert not answer.success
    for text in ("unit 'SIM-0001' of 'flap' is not healthy", "(warns above", "force and person"):
        assert text in answer.message
    answer = calibrate(session, **request_, person="Ada")
    assert "is not healthy" in answer.message
    answer = calibrate(session, **request_, force=True, person="\n")
    assert "person: expected 1 to 60 printable characters" in answer.message


def test_forced_calibration_of_a_worn_unit_is_not_a_repair(tmp_path: Path):
    """With a baseline of the worn state the level is OK, and the history shows the change."""
    source = Source()
    with monitor({"calibration_folder": str(tmp_path)}) as session:
        session.describe()
        for friction in (0.0, 0.0, 0.15, 0.15, 0.15):
            source.set(friction=friction)
            session.feed(source.cycle())
            assert session.next_estimate().valid
        session.until(lambda: session.healths()[-1].level == Health.WARN)
        request = Calibrate.Request(windows=2, **FORCED)
        future = session.start(Calibrate, NAME, request)
        until_waited_for(session)
        for _ in range(2):
            session.feed(source.cycle())
            session.next_estimate()
        answer = session.result(future)
        assert answer.success, answer.message
        for _ in range(8):
            session.feed(source.cycle())
            assert session.next_estimate().calibration_id == answer.calibration_id
        session.until(lambda: session.healths()[-1].level == Health.OK)
        history = session.call(GetHistory, "/ema/monitor/get_history", GetHistory.Request())
        events = history.history.events
        assert "repair" not in [event.kind for event in events]
        [change] = [event for event in events if "baseline changed by Ada, forced" in event.text]
        assert change.kind == "calibration"
        assert answer.calibration_id in change.text
        assert "which showed friction 0.1" in change.text


def test_request_that_fails_unexpectedly_is_answered(session: MonitorSession, monkeypatch):
    def fail(*_: Any) -> None:
        raise OverflowError("too large")

    monkeypatch.setattr(session.node.work.calibration_calls._store, "load", fail)
    answer = calibrate(session, load=True, file="x.yaml", **FORCED)
    assert (answer.success, answer.message) == (False, "failed: OverflowError('too large')")
    monkeypatch.setattr(session.node.work.identification_goals, "_identify", fail)
    _, result = Goal(session).result()
    assert (result.success, result.message) == (False, "failed: OverflowError('too large')")


def test_calls_that_wait_are_cancelled_or_answered_when_the_monitor_is_deactivated():
    with monitor() as session:
        session.describe()
        session.until_status("flap telemetry", "no telemetry so far")
        goal = Goal(session, next_window=True)
        goal.cancel()
        status, result = goal.result()
        assert (status, result.success) == (GoalStatus.STATUS_CANCELED, False)
        assert "cancel" in result.message
        future = session.start(Calibrate, NAME, Calibrate.Request(windows=1))
        goal = Goal(session, next_window=True)
        wait_for(lambda: len(waiting_calls(session)) == 2, "both calls to wait")
        assert session.node.trigger_deactivate()
        assert not session.result(future).success
        assert not goal.result()[1].success


def test_waiting_calibration_does_not_block_other_calls(tmp_path: Path):
    settings = {"calibration_timeout_s": 60.0, "calibration_folder": str(tmp_path)}
    with monitor(settings | {"calibration_file": str(tmp_path / "{actuator_id}.yaml")}) as session:
        session.describe()
        left = replace(FLAP, actuator_id="left")
        session.describe(left)
        session.until_status("left telemetry", "no telemetry so far")
        waiting = session.start(Calibrate, NAME, Calibrate.Request(actuator_id="left"))
        wait_for(lambda: waiting_calls(session), "the call to wait for windows")
        again = session.call(Calibrate, NAME, Calibrate.Request(actuator_id="left"))
        assert again.message == "actuator 'left' is already being calibrated"
        future = session.start(Calibrate, NAME, Calibrate.Request(actuator_id="flap", windows=1))
        wait_for(lambda: len(waiting_calls(session)) == 2, "both calls to wait")
        session.feed(Source().cycle())
        answer = session.result(future)
        assert answer.success, answer.message
        assert not waiting.done()
