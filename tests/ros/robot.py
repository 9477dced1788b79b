"""A robot of another make, as a process: one joint of our simulator, published as others do it.

python robot.py RATE_HZ CYCLES FRICTION: JointState on /joint_states with the current as effort, and
the command on /command, as Float64MultiArray sent before each state.
"""

import array
import sys
import time

import rclpy
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from ema_core.description import ActuatorDescription
from ema_ros.stamps import stamp_to_message
from ema_sim import simulate

JOINT = "flap_joint"


def main(rate_hz: float, cycles: int, friction: float) -> None:
    h = 1.0 / rate_hz
    description = ActuatorDescription(sample_period=h)
    telemetry = simulate({"friction": friction}, cycles, description=description)
    tau = description.parameters.tau
    rclpy.init()
    node = rclpy.create_node("robot")
    many = QoSProfile(depth=5000)
    states = node.create_publisher(JointState, "/joint_states", many)
    commands = node.create_publisher(Float64MultiArray, "/command", many)
    while not (states.get_subscription_count() and commands.get_subscription_count()):
        time.sleep(0.05)
    time.sleep(0.5)  # the subscriptions learn of their match after the publishers
    start_s, start_ns = time.monotonic(), time.time_ns()
    # Other joints stand in the same message, as with any robot.
    state = JointState(name=["other", JOINT])
    for i in range(len(telemetry)):
        late = start_s + i * h - time.monotonic()
        if late > 0.0:
            time.sleep(late)
        stamp_ns = start_ns + round((i + 1) * h * 1e9)
        commands.publish(Float64MultiArray(data=array.array("d", [0.1, telemetry.command[i]])))
        state.header.stamp = stamp_to_message(stamp_ns)
        state.position = array.array("d", [0.0, telemetry.position[i]])
        state.velocity = array.array("d", [0.0, telemetry.speed[i] * tau])
        state.effort = array.array("d", [0.0, telemetry.current[i]])
        states.publish(state)
    time.sleep(1.0)  # what is sent has to arrive before the publishers are gone
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))
