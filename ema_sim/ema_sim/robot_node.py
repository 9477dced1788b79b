# SPDX-License-Identifier: Apache-2.0
"""ROS node of a simulated robot arm, with the topics of a real arm."""

import math
from array import array
from dataclasses import asdict
from typing import Any, Final

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from ema_ros import topics
from ema_ros.node_parameters import LiveSettings, declare, read
from ema_ros.run import run
from ema_ros.stamps import stamp_to_message
from ema_sim.robot.arm import JOINT_NAMES, arm_unit
from ema_sim.robot.bench import ArmBench, ArmSample, ArmWork, RobotSettings
from ema_sim.robot.joint import Vector
from ema_sim.robot.urdf import robot_description
from ema_sim.robot.work import WearSettings, WorkSettings
from ema_sim.simulation_node import SimulationNode

_OFFERS: Final = {
    topics.JOINT_STATES: (JointState, topics.STREAM),
    topics.JOINT_COMMANDS: (JointState, topics.STREAM),
    topics.ROBOT_DESCRIPTION: (String, topics.LATCHED),
    topics.TRUE_FRICTION: (JointState, topics.LATCHED),
    topics.PAYLOAD: (Float64, topics.LATCHED),
}
_CLOCK_PERIOD_NS: Final = 10_000_000


class RobotNode(SimulationNode):
    """ROS node that runs a simulated six-joint arm through pick-and-place cycles.

    Raises
    ------
    ValueError
        If a parameter is out of range.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("robot", **kwargs)
        declare(self, RobotSettings)
        self._work = LiveSettings(self, WorkSettings, on_change=self._change_work)
        self._wear = LiveSettings(self, WearSettings, "wear.", on_change=self._change_work)

    def configure(self) -> None:
        """Create the arm and the publishers."""
        settings = read(self, RobotSettings)
        self._bench = ArmBench(settings, self._work.value, asdict(self._wear.value))
        self._description = robot_description(arm_unit(settings.seed))
        self._state = JointState(name=JOINT_NAMES)
        self._command = JointState(name=JOINT_NAMES)
        self._clock_ns = 0
        self._payload = math.nan
        self.run_bench(self._bench, settings.rate, _OFFERS)

    def activate(self) -> None:
        """Publish the robot description, and start the thread that runs cycles."""
        self.publish(topics.ROBOT_DESCRIPTION, String(data=self._description))
        super().activate()

    def publish_cycle(self, cycle: ArmWork) -> None:
        """Publish the true friction at the start of a cycle."""
        message = JointState(name=JOINT_NAMES, effort=_row(cycle.friction_ratio))
        message.header.stamp = stamp_to_message(cycle.start_ns)
        self.publish(topics.TRUE_FRICTION, message)

    def publish_block(self, block: ArmSample) -> None:
        """Publish a sample of all joints, and the payload if it has changed."""
        if abs(block.stamp_ns - self._clock_ns) >= _CLOCK_PERIOD_NS:
            self._clock_ns = block.stamp_ns
            self.publish_clock(block.stamp_ns)
            self.report_pace()
        state, command = self._state, self._command
        state.header.stamp = command.header.stamp = stamp_to_message(block.stamp_ns)
        state.position, state.velocity = _row(block.position), _row(block.velocity)
        state.effort = _row(block.effort)
        command.position = _row(block.position_command)
        command.velocity = _row(block.velocity_command)
        if block.payload != self._payload:
            self._payload = block.payload
            self.publish(topics.PAYLOAD, Float64(data=block.payload))
        self.publish(topics.JOINT_STATES, state)
        self.publish(topics.JOINT_COMMANDS, command)

    def _change_work(self, _: Any) -> None:
        if self.is_configured:
            self._bench.work, self._bench.wear = self._work.value, asdict(self._wear.value)


def _row(values: Vector) -> "array[float]":
    # rclpy checks and copies each number of a list, but not of a typed array.
    return array("d", values.tobytes())


def main(args: list[str] | None = None) -> int:
    """Run the robot node and return the exit status."""
    return run(RobotNode, args)
