# SPDX-License-Identifier: Apache-2.0
"""Messages of a simulated actuator by topic, for the node and for recordings."""

import array
from typing import Any

from numpy.typing import ArrayLike
from sensor_msgs.msg import JointState

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import FaultVectorStamped, Usage
from ema_ros import topics
from ema_ros.messages import faults_to_message, telemetry_to_message
from ema_ros.stamps import stamp_to_message


def messages_of_cycle(
    description: ActuatorDescription, stamp_ns: int, cycle: int, hours: float, faults: ArrayLike
) -> dict[str, Any]:
    """Return the messages at the start of a test cycle: service hours and true faults.

    Cycles are numbered from 0.
    """
    truth = FaultVectorStamped(
        actuator_id=description.actuator_id, cycle=cycle, faults=faults_to_message(faults)
    )
    truth.header.stamp = stamp_to_message(stamp_ns)
    return {
        topics.USAGE: usage_at_cycle(description, stamp_ns, hours, cycle),
        topics.SIMULATED_FAULTS: truth,
    }


def messages_of_block(
    description: ActuatorDescription, block: Telemetry, motor_torque: float | None
) -> dict[str, Any]:
    """Return a block's messages: telemetry, and the joint state if the torque is known."""
    messages: dict[str, Any] = {
        topics.TELEMETRY: telemetry_to_message(block, description.actuator_id)
    }
    if motor_torque is not None:
        messages[topics.JOINT_STATES] = joint_state_after(block, motor_torque, description)
    return messages


def usage_at_cycle(
    description: ActuatorDescription, stamp_ns: int, hours: float, cycle: int
) -> Usage:
    """Return the service hours and cycles at the start of a cycle; the count includes the cycle."""
    message = Usage(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        flight_hours=float(hours),
        cycles=cycle + 1,
    )
    message.header.stamp = stamp_to_message(stamp_ns)
    return message


def joint_state_after(
    block: Telemetry, motor_torque: float, description: ActuatorDescription
) -> JointState:
    """Return the state of the user shaft at the end of a block, for tools that display joints.

    The velocity is empty if the speed is not measured.
    """
    tau = description.parameters.tau
    message = JointState(name=[description.actuator_id])
    message.header.stamp = stamp_to_message(block.stamp_at(len(block) - 1))
    message.position = array.array("d", [block.position[-1]])
    if len(block.speed):
        message.velocity = array.array("d", [block.speed[-1] * tau])
    message.effort = array.array("d", [motor_torque / tau])
    return message
