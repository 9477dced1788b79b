"""The user shaft as sensor_msgs/JointState, for the tools that draw joints."""

import array

from sensor_msgs.msg import JointState

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_ros.stamps import stamp_to_message


def joint_state(
    stamp_ns: int, name: str, position: float, speed: float, torque: float
) -> JointState:
    """Return the state of the user shaft as a message.

    Parameters
    ----------
    stamp_ns
        When the state was measured [ns].
    name
        Name of the joint.
    position
        Angle of the user shaft [rad].
    speed
        Speed of the user shaft [rad/s].
    torque
        Torque on the user shaft [N.m].

    Raises
    ------
    ValueError
        When the stamp is out of range.
    """
    message = JointState(name=[name])
    message.header.stamp = stamp_to_message(stamp_ns)
    message.position = array.array("d", [position])
    message.velocity = array.array("d", [speed])
    message.effort = array.array("d", [torque])
    return message


def joint_state_after(
    block: Telemetry, motor_torque: float, description: ActuatorDescription
) -> JointState:
    """Return the state of an actuator's user shaft at the end of a block as a message.

    Parameters
    ----------
    block
        Telemetry of the actuator.
    motor_torque
        Torque of the motor at the block's end [N.m].
    description
        The actuator; its name is that of the joint.

    Raises
    ------
    ValueError
        When the stamp is out of range.
    """
    tau = description.parameters.tau
    return joint_state(
        block.stamp_at(len(block) - 1),
        description.actuator_id,
        float(block.position[-1]),
        float(block.speed[-1]) * tau,
        motor_torque / tau,
    )
