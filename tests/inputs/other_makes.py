# SPDX-License-Identifier: Apache-2.0
"""Bags from other publishers: JointState, ros2_control and ODrive messages, written by rosbags."""

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ema_core.telemetry import Telemetry

CONTROL = {
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values\n",
    "control_msgs/msg/DynamicJointState": "std_msgs/Header header\nstring[] joint_names\n"
    "InterfaceValue[] interface_values\n",
    "control_msgs/msg/SingleDOFState": "string name\nfloat64 reference\nfloat64 feedback\n"
    "float64 feedback_dot\nfloat64 error\nfloat64 error_dot\nfloat64 time_step\nfloat64 output\n",
    "control_msgs/msg/SingleDOFStateStamped": "std_msgs/Header header\nSingleDOFState dof_state\n",
    "control_msgs/msg/Keys": "std_msgs/Header header\nstring[] keys\n",
    "control_msgs/msg/Float64Values": "std_msgs/Header header\nfloat64[] values\n",
    "control_msgs/msg/JointTrajectoryControllerState": "std_msgs/Header header\n"
    "string[] joint_names\ntrajectory_msgs/JointTrajectoryPoint reference\n"
    "trajectory_msgs/JointTrajectoryPoint feedback\n",
    "odrive_can/msg/ControllerStatus": "float32 pos_estimate\nfloat32 vel_estimate\n"
    "float32 torque_target\nfloat32 torque_estimate\nfloat32 iq_setpoint\nfloat32 iq_measured\n"
    "uint32 active_errors\nuint8 axis_state\nuint8 procedure_result\nbool trajectory_done_flag\n",
    "odrive_can/msg/ControlMessage": "uint32 control_mode\nuint32 input_mode\n"
    "float32 input_pos\nfloat32 input_vel\nfloat32 input_torque\n",
}
START_NS = 1_700_000_000_000_000_000
TAU = 1 / 500


class OtherBag:
    """A context manager that writes a bag."""

    def __init__(self, path: Path, storage: str = "sqlite3", compression: str = "") -> None:
        self.store = get_typestore(Stores.ROS2_JAZZY)
        for name, text in CONTROL.items():
            self.store.register(get_types_from_msg(text, name))
        plugin = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}[storage]
        self._writer = Writer(path, version=9, storage_plugin=plugin)
        if compression:
            self._writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> "OtherBag":
        self._writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def make(self, kind: str, *arguments: Any, **more: Any) -> Any:
        return self.store.types[kind](*arguments, **more)

    def header(self, stamp_ns: int) -> Any:
        seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
        stamp = self.make("builtin_interfaces/msg/Time", seconds, nanoseconds)
        return self.make("std_msgs/msg/Header", stamp, "")

    def write(self, topic: str, message: Any, received_ns: int) -> None:
        kind = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self.store
            )
        data = self.store.serialize_cdr(message, kind)
        self._writer.write(self._connections[topic], received_ns, data)

    def write_raw(self, topic: str, data: bytes, received_ns: int) -> None:
        """Write arbitrary bytes to a topic that already has messages."""
        self._writer.write(self._connections[topic], received_ns, data)


def stamps_of(telemetry: Telemetry) -> list[int]:
    return [START_NS + int(stamp) for stamp in telemetry.stamps_ns]


def write_joint_states(
    bag: OtherBag, telemetry: Telemetry, *, stamped: bool = True, delays: Any = None
) -> None:
    """Write JointState of two joints, and the command of the second as Float64MultiArray."""
    for i, stamp in enumerate(stamps_of(telemetry)):
        received = stamp + (200_000 if delays is None else int(delays[i]))
        layout = bag.make("std_msgs/msg/MultiArrayLayout", [], 0)
        command = bag.make(
            "std_msgs/msg/Float64MultiArray", layout, np.array([0.0, telemetry.command[i]])
        )
        bag.write("/commands", command, received - 1000)
        rows = ((telemetry.position, 1.0), (telemetry.speed, TAU), (telemetry.current, 1.0))
        state = bag.make(
            "sensor_msgs/msg/JointState",
            bag.header(stamp if stamped else 0),
            ["other", "flap"],
            *(np.array([0.5, values[i] * factor]) for values, factor in rows),
        )
        bag.write("/joint_states", state, received)


def write_interface_values(bag: OtherBag, telemetry: Telemetry) -> None:
    """Write interface values; their names follow later, as for a recorder that starts late."""
    keys = ["flap/position", "flap/velocity", "flap/current", "flap/reference"]
    for i, stamp in enumerate(stamps_of(telemetry)):
        values = [
            telemetry.position[i],
            telemetry.speed[i] * TAU,
            telemetry.current[i],
            telemetry.command[i],
        ]
        message = bag.make("control_msgs/msg/Float64Values", bag.header(stamp), np.array(values))
        bag.write("/broadcaster/values", message, stamp)
        if i == 5:
            names = bag.make("control_msgs/msg/Keys", bag.header(stamp), keys)
            bag.write("/broadcaster/names", names, stamp)


def write_odrive(bag: OtherBag, telemetry: Telemetry, delays: Any) -> None:
    turn = 2.0 * np.pi
    for i, stamp in enumerate(stamps_of(telemetry)):
        received = stamp + int(delays[i])
        command = bag.make(
            "odrive_can/msg/ControlMessage", 3, 1, telemetry.command[i] / TAU / turn, 0.0, 0.0
        )
        bag.write("/axis0/control_message", command, received - 1000)
        status = bag.make(
            "odrive_can/msg/ControllerStatus",
            telemetry.position[i] / TAU / turn,
            telemetry.speed[i] / turn,
            *(0.0, 0.0, 0.0),
            telemetry.current[i],
            *(0, 8, 0, True),
        )
        bag.write("/axis0/controller_status", status, received)
