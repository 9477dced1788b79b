# SPDX-License-Identifier: Apache-2.0
"""A joint without a baseline learns until a person or a setting accepts its records."""

import os
import re
import subprocess
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import BaselineStatus, FaultEstimate, Health
from ema_interfaces.srv import Calibrate, ChangeBaseline, GetHistory
from ema_monitor.baselines.unit_baseline import InUseError, UnitBaseline
from ema_ros import topics

from .monitor_session import START_NS, MonitorSession, monitor

JOINT = ActuatorDescription(sample_period=1e-2, drive="unknown")
SECOND_NS = 10**9
CURVES = ("speed", "healthy_high", "latest")


def work(number: int, friction: float = 1.0) -> Telemetry:
    """Return the telemetry of minute ``number``: 20 s of motion and 7 s of rest."""
    rng = np.random.default_rng(number)
    period = JOINT.sample_period
    time = np.arange(0.0, 20.0, period)
    pace = 2.0 * np.pi * (0.3 + 0.01 * rng.standard_normal())
    moving = 0.5 * np.sin(pace * time) + 0.25 * np.sin(2.3 * pace * time)
    position = np.concatenate([np.zeros(100), moving, np.full(700, moving[-1])])
    speed = np.gradient(position, period)
    dry = 0.8 * friction * (1.0 + 0.01 * rng.standard_normal())
    effort = dry * np.tanh(speed / 0.02) + 0.3 * speed + 0.1 * np.gradient(speed, period)
    effort += 0.05 + 0.02 * rng.standard_normal(len(position))
    motor_speed = speed / JOINT.parameters.tau
    stamp_ns = START_NS + 60 * number * SECOND_NS
    return Telemetry(stamp_ns, period, 6000 * number, position, effort, position, motor_speed)


class Learner:
    """A learning monitor, with functions to send records and wait for statuses."""

    def __init__(self, session: MonitorSession) -> None:
        self.session = session
        session.mount(JOINT)

    def feed(self, numbers: Iterable[int], friction: float = 1.0) -> FaultEstimate:
        """Send records one by one. Return the estimate of the last one."""
        estimates = []
        for number in numbers:
            self.session.feed([work(number, friction)])
            estimates.append(self.session.next_estimate())
        return estimates[-1]

    def status(self, state: int, records: int) -> BaselineStatus:
        """Wait for a baseline status with this state and number of records."""

        def matching() -> list[BaselineStatus]:
            received = self.session.received(topics.BASELINE)
            return [item for item in received if (item.state, item.records) == (state, records)]

        return self.session.until(matching)[-1]

    def health(self, level: int, words: str) -> Health:
        def matching() -> list[Health]:
            healths = self.session.healths()[-1:]
            return [item for item in healths if item.level == level and words in item.reason]

        return self.session.until(matching)[-1]

    def change(self, change: int, person: str = "Ada", **more: object) -> ChangeBaseline.Response:
        request = ChangeBaseline.Request(change=change, person=person, **more)
        return self.session.call(ChangeBaseline, "/ema/monitor/change_baseline", request)


def test_joint_without_effort_is_not_learning(tmp_path: Path):
    """Such a joint can never be judged, which the reason states."""
    with monitor({"baseline_folder": str(tmp_path / "baselines")}) as session:
        session.mount(replace(JOINT, acquisition=Acquisition("none")))

        def unjudged() -> list[Health]:
            healths = session.healths()[-1:]
            return [item for item in healths if "cannot be judged: no effort" in item.reason]

        [health] = session.until(unjudged)
        assert health.level == Health.STALE
        session.feed([replace(work(0), current=np.empty(0))])
        assert "cannot be judged: no effort" in session.next_estimate().reason
        assert session.received(topics.BASELINE) == []


@pytest.mark.slow
def test_person_accepts_the_records_of_a_learning_joint(tmp_path: Path):
    settings = {"baseline_folder": str(tmp_path / "baselines")}
    with monitor(settings) as session:
        joint = Learner(session)
        joint.status(BaselineStatus.LEARNING, 0)
        joint.health(Health.STALE, "learning: 0 records")
        estimate = joint.feed(range(2))
        assert (estimate.verdict, estimate.reason_codes) == (FaultEstimate.REFUSED, ["learning"])
        assert estimate.reason.startswith("learning: 2 records on 1 day")
        refused = joint.change(ChangeBaseline.Request.ACCEPT)
        assert not refused.success
        assert "at least 3" in refused.message
        joint.feed(range(2, 6))
        status = joint.status(BaselineStatus.LEARNING, 6)
        assert (status.days, status.records_needed, status.reason) == (1, 0, "")
        assert 0.01 < status.detectable_same_day < status.detectable_other_day < 0.5
        assert 0.5 < status.slowest <= status.fastest < 2.0
        assert status.forward_share == pytest.approx(0.5, abs=0.1)
        assert any("further days" in sentence for sentence in status.advice)
        health = joint.health(Health.STALE, "learning: 6 records on 1 day")
        assert health.last_level == Health.STALE
        task = next(task for task in session.node.tasks("flap") if task.name == "flap health")
        assert (task.level, task.message[:9]) == (int(DiagnosticStatus.STALE[0]), "learning:")
        nobody = joint.change(ChangeBaseline.Request.ACCEPT, person="")
        assert not nobody.success
        assert "person" in nobody.message
        answer = joint.change(ChangeBaseline.Request.ACCEPT, note="new robot")
        assert answer.success, answer.message
        status = joint.status(BaselineStatus.ACCEPTED, 6)
        assert status.author == "Ada"
        assert status.calibration_id in answer.message
        joint.health(Health.STALE, "accepted by Ada: the next record gives the level")
        assert joint.feed([6]).verdict == FaultEstimate.VALID
        joint.health(Health.OK, "")
        worn = joint.feed([7], friction=1.6)
        assert worn.verdict == FaultEstimate.DEPARTED
        curve = session.until(lambda: session.received(topics.FRICTION_CURVE)[1:])[0]
        assert (curve.actuator_id, curve.unit) == ("flap", "A")
        speed, high, latest = (np.array(getattr(curve, name)) for name in CURVES)
        forward = (speed > 0.0) & np.isfinite(latest)
        assert np.count_nonzero(forward) > 5
        assert np.all(latest[forward] > high[forward])
        session.until(lambda: [item for item in session.healths() if item.level == Health.WARN])
        # The monitor keeps records that do not depart, and adds them on a person's request only.
        refused = joint.change(ChangeBaseline.Request.EXTEND)
        assert not refused.success
        assert "not healthy" in refused.message
        answer = joint.change(ChangeBaseline.Request.EXTEND, force=True)
        assert answer.success, answer.message
        joint.status(BaselineStatus.ACCEPTED, 7)
        answer = joint.change(ChangeBaseline.Request.RESET, note="gear replaced", force=True)
        assert answer.success, answer.message
        joint.status(BaselineStatus.LEARNING, 0)
        joint.health(Health.STALE, "learning: 0 records")
        answer = session.call(GetHistory, "/ema/monitor/get_history", GetHistory.Request())
        events = [event.text for event in answer.history.events]
        assert any(text.startswith("baseline changed by Ada, forced, 20") for text in events)
        assert any(re.match(r"Ada reset the baseline \S+ \(forced\), 20", text) for text in events)
        refused = session.call(Calibrate, "/ema/monitor/calibrate", Calibrate.Request())
        assert "use ~/change_baseline" in refused.message
        with pytest.raises(InUseError):
            UnitBaseline(tmp_path / "baselines", JOINT)
    with UnitBaseline(tmp_path / "baselines", JOINT) as baseline:
        kinds = [str(change.kind) for change in baseline.changes]
        assert kinds == ["accept", "extend", "reset"]


@pytest.mark.slow
def test_setting_accepts_the_records_and_a_restart_continues_with_them(tmp_path: Path):
    # Provisional fits are made with 6 and 8 records.
    settings = {"baseline_folder": str(tmp_path), "accept_after": 7}
    with monitor(settings) as session:
        Learner(session).feed(range(3))
    with monitor(settings) as session:
        joint = Learner(session)
        status = joint.status(BaselineStatus.LEARNING, 3)
        assert (status.records_needed, status.days) == (7, 1)
        last = joint.feed(range(3, 7))
        assert "accepted by accept_after = 7" in last.reason
        status = joint.status(BaselineStatus.ACCEPTED, 7)
        assert status.author == "accept_after = 7"
        assert joint.feed([7]).verdict == FaultEstimate.VALID
        joint.health(Health.OK, "")
    with monitor(settings) as session:
        joint = Learner(session)
        joint.status(BaselineStatus.ACCEPTED, 7)
        assert joint.feed([8]).verdict == FaultEstimate.VALID


@pytest.mark.slow
def test_records_that_depart_from_each_other_are_not_accepted_by_a_setting(tmp_path: Path):
    with monitor({"baseline_folder": str(tmp_path), "accept_after": 6}) as session:
        joint = Learner(session)
        joint.feed(range(4))
        joint.feed([4], friction=1.6)
        joint.feed(range(5, 7))
        status = joint.status(BaselineStatus.LEARNING, 7)
        assert "differs from the other healthy records" in status.reason
        answer = joint.change(ChangeBaseline.Request.ACCEPT)
        assert not answer.success
        answer = joint.change(ChangeBaseline.Request.ACCEPT, force=True, note="payload")
        assert answer.success, answer.message


@pytest.mark.slow
def test_record_without_information_is_not_collected(tmp_path: Path):
    with monitor({"baseline_folder": str(tmp_path)}) as session:
        joint = Learner(session)
        telemetry = work(0)
        one_way = np.linspace(0.0, 3.0, len(telemetry))
        forward = replace(
            telemetry, position=one_way, command=one_way, speed=np.abs(telemetry.speed)
        )
        session.feed([forward, work(1)])
        refused = session.next_estimate()
        assert refused.reason_codes == ["learning", "too_few_strokes"]
        assert refused.reason.startswith("learning: 0 records")
        assert session.next_estimate().reason.startswith("learning: 1 record on 1 day")
        joint.status(BaselineStatus.LEARNING, 1)


@pytest.mark.slow
def test_command_requests_changes_of_the_running_monitor(tmp_path: Path):
    with monitor({"baseline_folder": str(tmp_path)}) as session:
        joint = Learner(session)
        joint.feed(range(5))
        environment = os.environ | {"ROS_DOMAIN_ID": str(session.node.context.get_domain_id())}

        def ema(*words: str) -> subprocess.CompletedProcess[str]:
            command = ["ema", "baseline", *words]
            return subprocess.run(command, env=environment, capture_output=True, text=True)

        listed = ema("list")
        assert listed.stdout.splitlines()[1].split()[:4] == ["flap", "SIM-0001", "LEARNING", "5"]
        accepted = ema("accept", "flap", "--person", "Ada", "--note", "new robot")
        assert accepted.returncode == 0, accepted.stderr
        assert joint.status(BaselineStatus.ACCEPTED, 5).author == "Ada"
        refused = ema("extend", "flap", "--person", "Ada")
        assert refused.returncode == 1
        assert "nothing to extend the baseline with" in refused.stderr
