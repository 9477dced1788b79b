# SPDX-License-Identifier: Apache-2.0
"""A monitor of an unknown drive ends a record when the telemetry or the monitor ends."""

import numpy as np
from lifecycle_msgs.msg import Transition
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_ros.stamps import stamp_from_message, stamp_to_message

from ..waiting import wait_for
from .monitor_session import START_NS, MonitorSession, monitor

H = 0.01
UNKNOWN = ActuatorDescription(sample_period=H, drive="unknown")
S = 1_000_000_000


def feed_motion(session: MonitorSession, seconds: int) -> None:
    """Publish motion in blocks of 1 s from ``START_NS`` on, and wait until all are received."""
    second = 0.3 * np.sin(2.0 * np.pi * H * np.arange(1.0, 101.0))
    session.feed(
        Telemetry(START_NS + number * S, H, 1 + 100 * number, second, second, second, second)
        for number in range(seconds)
    )
    finder = session.node.actuators["flap"].finder
    wait_for(lambda: finder.blocks == seconds, "the telemetry")


def test_record_ends_when_the_actuator_is_silent():
    with monitor({"use_sim_time": True}) as session:
        best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        clock = session.probe.create_publisher(Clock, "/clock", best_effort)

        def until_it_is(moment_ns: int) -> None:
            def is_set() -> bool:
                clock.publish(Clock(clock=stamp_to_message(moment_ns)))
                return session.node.get_clock().now().nanoseconds == moment_ns

            wait_for(is_set, "the clock")

        until_it_is(START_NS)
        session.mount(UNKNOWN)
        feed_motion(session, 6)
        until_it_is(START_NS + 9 * S)
        assert session.node.actuators["flap"].finder.windows == 0
        # An actuator counts as silent after 10 s.
        until_it_is(START_NS + 20 * S)
        estimate = session.next_estimate()
        assert stamp_from_message(estimate.window_start) == START_NS
        assert stamp_from_message(estimate.window_end) == START_NS + 6 * S - S // 100


def test_record_that_is_open_when_the_monitor_stops_is_refused_with_the_reason():
    with monitor() as session:
        session.mount(UNKNOWN)
        feed_motion(session, 6)
        assert session.change_state(Transition.TRANSITION_DEACTIVATE)
        estimate = session.next_estimate()
        assert not estimate.valid
        assert estimate.reason == "the monitor was stopped during the record"
