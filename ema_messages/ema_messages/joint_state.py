"""The user shaft as sensor_msgs/JointState, for the tools that draw joints."""

import array

from sensor_msgs.msg import JointState

from ema_messages.stamps import stamp_to_message


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
