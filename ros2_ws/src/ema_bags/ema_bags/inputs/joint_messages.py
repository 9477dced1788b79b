# SPDX-License-Identifier: Apache-2.0
"""Message types with joint data: field paths of the quantities, and reading of their values."""

import re
from collections.abc import Callable, Hashable
from operator import attrgetter
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

JOINT_STATE: Final = "sensor_msgs/msg/JointState"
DYNAMIC_JOINT_STATE: Final = "control_msgs/msg/DynamicJointState"
CONTROLLER_STATE: Final = "control_msgs/msg/JointTrajectoryControllerState"
PID_STATE: Final = "control_msgs/msg/SingleDOFStateStamped"

JOINT_KINDS: Final = frozenset((JOINT_STATE, DYNAMIC_JOINT_STATE, CONTROLLER_STATE, PID_STATE))
"""Message types that name their joints."""

NUMBERS: Final = frozenset(
    f"std_msgs/msg/{kind}"
    for kind in ("Float64", "Float32", "Float64MultiArray", "Float32MultiArray")
)
"""Message types with numbers but without joint names."""

KINDS: Final = JOINT_KINDS | NUMBERS
"""Message types from which joints are recognised."""

_PAYLOADS: Final = frozenset(f"std_msgs/msg/{kind}" for kind in ("Float64", "Float32", "Bool"))

_ARRAYS: Final = {
    JOINT_STATE: ("position", "velocity", "effort"),
    CONTROLLER_STATE: (
        *("feedback.positions", "feedback.velocities", "reference.positions"),
        *("actual.positions", "actual.velocities", "desired.positions"),
    ),
}
_PID_FIELDS: Final = tuple(
    f"dof_state.{name}" for name in ("reference", "feedback", "feedback_dot", "output")
)
_INTERFACE: Final = "interface_values[joint_names={joint}].values[interface_names=%s]"
# The joint is empty in the paths of a mapping with several joints.
_INTERFACE_PATH: Final = re.compile(
    r"interface_values\[joint_names=(?:\{joint\})?\]\.values\[interface_names=([^\[\]=]+)\]"
)
_CURRENT: Final = _INTERFACE % "current"

PATHS: Final[dict[str, tuple[tuple[str, tuple[str, ...]], ...]]] = {
    "position": (
        (JOINT_STATE, ("position",)),
        (DYNAMIC_JOINT_STATE, (_INTERFACE % "position",)),
        (CONTROLLER_STATE, ("feedback.positions", "actual.positions")),
        (PID_STATE, ("dof_state.feedback",)),
    ),
    "speed": (
        (JOINT_STATE, ("velocity",)),
        (DYNAMIC_JOINT_STATE, (_INTERFACE % "velocity",)),
        (CONTROLLER_STATE, ("feedback.velocities", "actual.velocities")),
        (PID_STATE, ("dof_state.feedback_dot",)),
    ),
    "current": (
        (JOINT_STATE, ("effort",)),
        (DYNAMIC_JOINT_STATE, (_INTERFACE % "effort", _INTERFACE % "torque", _CURRENT)),
    ),
    "command": (
        (CONTROLLER_STATE, ("reference.positions", "desired.positions")),
        (PID_STATE, ("dof_state.reference",)),
    ),
    "temperature": (
        (DYNAMIC_JOINT_STATE, (_INTERFACE % "temperature", _INTERFACE % "motor_temperature")),
    ),
}
"""Message types and field paths of each quantity, in order of preference."""


class Reading(NamedTuple):
    """Numbers of one message."""

    form: Hashable
    """Key that is equal for messages with the same columns."""
    values: NDArray[np.float64]
    """The numbers, ``(n,)``."""
    columns: Callable[[], list[tuple[str, str]]]
    """Function that returns joint and field path of each number; the joint is "" if not named."""


def is_payload(topic: str, kind: str) -> bool:
    """Return whether a topic's name and message type mark it as the payload of a robot."""
    return kind in _PAYLOADS and topic.rpartition("/")[2] == "payload"


def is_read(topic: str, kind: str) -> bool:
    """Return whether joints or a payload can be read from a topic."""
    return kind in KINDS or is_payload(topic, kind)


def is_electric(path: str) -> bool:
    """Return whether the name of an effort field denotes a current."""
    return path == _CURRENT


def names_of(message: Any) -> tuple[str, ...]:
    """Return the joints of a message, in the order of its arrays; empty if it names none."""
    state = getattr(message, "dof_state", None)
    if state is not None:
        return (state.name,)
    return tuple(getattr(message, "name", ()) or getattr(message, "joint_names", ()))


def joint_reader(path: str) -> Callable[[Any], Any] | None:
    """Return a function that reads one value per joint of a message; None for other paths.

    Parameters
    ----------
    path
        Field path in a message of ``JOINT_KINDS``.
    """
    if path in _PID_FIELDS:
        of_joint = attrgetter(path)
        return lambda message: (of_joint(message),)
    if interface := _INTERFACE_PATH.fullmatch(path):
        name = interface[1].strip()
        return lambda message: [_interface(item, name) for item in message.interface_values]
    if any(path in paths for paths in _ARRAYS.values()):
        return attrgetter(path)
    return None


def read_message(kind: str, message: Any) -> Reading:
    """Return the numbers of a message of one of ``KINDS``, or of a payload."""
    if kind in _ARRAYS:
        names = names_of(message)
        present = [(path, _array(message, path)) for path in _ARRAYS[kind]]
        arrays = [(path, values[: len(names)]) for path, values in present if len(values)]
        form = names, *((path, len(values)) for path, values in arrays)
        return Reading(
            form,
            np.concatenate([np.empty(0), *(values for _, values in arrays)]),
            lambda: [(n, path) for path, v in arrays for n, _ in zip(names, v, strict=False)],
        )
    if kind == DYNAMIC_JOINT_STATE:
        pairs = [
            (joint, list(zip(item.interface_names, item.values, strict=False)))
            for joint, item in zip(message.joint_names, message.interface_values, strict=False)
        ]
        form = tuple((joint, tuple(name for name, _ in items)) for joint, items in pairs)
        return Reading(
            form,
            np.array([value for _, items in pairs for _, value in items], dtype=float),
            lambda: [(joint, _INTERFACE % name) for joint, names in form for name in names],
        )
    if kind == PID_STATE:
        [name] = names_of(message)
        values = np.array([attrgetter(path)(message) for path in _PID_FIELDS], dtype=float)
        return Reading(name, values, lambda: [(name, path) for path in _PID_FIELDS])
    data = np.atleast_1d(np.asarray(message.data, dtype=float))
    is_array = kind.endswith("Array")
    return Reading(
        len(data),
        data,
        lambda: [("", f"data[{k}]" if is_array else "data") for k in range(len(data))],
    )


def _array(message: Any, path: str) -> NDArray[np.float64]:
    value = message
    for name in path.split("."):
        value = getattr(value, name, ())
    return np.asarray(value, dtype=float)


def _interface(item: Any, name: str) -> float:
    """Return the value of an interface of one joint; NaN if the joint lacks it."""
    names = list(item.interface_names)
    index = names.index(name) if name in names else len(item.values)
    return float(item.values[index]) if index < len(item.values) else np.nan
