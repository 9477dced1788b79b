# SPDX-License-Identifier: Apache-2.0
"""Estimates from ordinary motion in a live monitor equal the offline estimates."""

from dataclasses import replace

import numpy as np
import pytest
from action_msgs.msg import GoalStatus

from ema_core.commands import Command
from ema_core.faults import FAULT_NAMES, fault_vector
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import FaultEstimate
from ema_monitor import CombinationSettings, identify_motion
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.identification.estimate import refusal
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.node.moment import Moment
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.publish.unit_status import unit_tasks
from ema_monitor.node.receive.arrivals import Arrivals
from ema_monitor.prognosis.outlook import unknown_outlook
from ema_monitor.reasons import NoCalibration, StatedReason
from ema_monitor.windows.finder import WindowFinder
from ema_monitor.windows.trigger import Refusal, TriggerSettings
from ema_ros.stamps import stamp_from_message
from ema_sim.actuator import SimulatedActuator

from .monitor_session import FLAP, START_NS, Goal, monitor

MOTION = {"windows": "any_motion", "wanted_sigma": 0.05, "pause_s": 0.0}
BLOCK = 500


def blocks(command: np.ndarray, **faults: float) -> list[Telemetry]:
    actuator = SimulatedActuator(stamp_ns=START_NS)
    actuator.faults = fault_vector(faults)
    actuator.causes = {"load_torque": 0.3}
    whole = actuator.advance(command)
    return [whole.part(i, min(i + BLOCK, len(whole))) for i in range(0, len(whole), BLOCK)]


@pytest.fixture(scope="module")
def moves() -> list[Telemetry]:
    command = Command("moves", amplitude=0.008, rate=0.3, duration=3.0, seed=3).sample(1e-4)
    return blocks(command, friction=0.2, short_circuit_b=0.1)


@pytest.mark.slow
def test_live_estimates_of_motion_equal_the_offline_estimates(moves: list[Telemetry]):
    """Stretches and estimates are equal to the last bit."""
    expected = identify_motion(moves, settings=CombinationSettings(wanted_sigma=0.05, pause_s=0.0))
    assert [estimate.stretches for estimate in expected[:-1]] == [2, 1, 1]
    with monitor({**MOTION, "waiting_windows": 1000}) as session:
        session.describe()
        session.feed(moves)
        # The last estimate comes at the end of the motion, when the monitor is deactivated.
        for estimate in expected[:-1]:
            live = session.next_estimate()
            faults = [getattr(live.faults, name) for name in FAULT_NAMES]
            np.testing.assert_array_equal(faults, estimate.faults)
            assert live.stretches == estimate.stretches >= 1
            assert stamp_from_message(live.window_start) == estimate.start_ns
            assert stamp_from_message(live.window_end) == estimate.end_ns
            assert live.verdict == FaultEstimate.VALID
        assert [estimate.window for estimate in session.estimates()] == list(
            range(len(expected) - 1)
        )


@pytest.mark.slow
def test_a_stretch_is_not_identified_as_a_test_cycle(moves: list[Telemetry]):
    with monitor(MOTION) as session:
        session.describe()
        session.feed(moves[:20])
        session.until(lambda: session.node.work.worker.of("flap").latest)
        status, result = Goal(session, algorithm="pso").result()
        assert (status, result.success) == (GoalStatus.STATUS_ABORTED, False)
        assert "set `windows` to 'test_cycle'" in result.message


def test_an_estimate_of_later_motion_ends_a_defect():
    """Stretches and the estimates made from them are counted separately."""
    finder = WindowFinder(TriggerSettings(windows="any_motion"))
    unit = ActuatorStatus(FLAP.actuator_id, finder, lambda _: None, 0, Arrivals())
    unit.finder.describe(FLAP)
    unit.finder.windows = 40
    unit.add_defect("invalid description")
    estimate = replace(
        refusal(
            Refusal(5, 9, StatedReason("")),
            NoCalibration("calibration.yaml"),
            SearchSettings(),
            StatedReason(""),
        ),
        valid=True,
    )
    for last, is_open in ((39, True), (40, False)):
        unit.record(Diagnosed(3, last, FLAP, estimate), unknown_outlook("no test"), Moment(0, 0))
        assert ("invalid description" in unit_tasks(unit, 0)[0].message) == is_open
