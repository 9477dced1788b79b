"""State of the user shaft as sensor_msgs/JointState, for tools that display joints."""

import array

from sensor_msgs.msg import JointState

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_ros.stamps import stamp_to_message


def joint_state_after(
    block: Telemetry, motor_torque: float, description: ActuatorDescription
) -> JointState:
    """Return the state of an actuator's user shaft at the end of a block as a message.

    Parameters
    ----------
    block
        Telemetry of the actuator.
    motor_torque
        Motor torque at the end of the block [N.m].
    description
        The actuator, whose id is the name of the joint.

    Raises
    ------
    ValueError
        When the stamp is out of range.
    """
    tau = description.parameters.tau
    message = JointState(name=[description.actuator_id])
    message.header.stamp = stamp_to_message(block.stamp_at(len(block) - 1))
    message.position = array.array("d", [block.position[-1]])
    message.velocity = array.array("d", [block.speed[-1] * tau])
    message.effort = array.array("d", [motor_torque / tau])
    return message
