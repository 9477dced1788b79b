"""ROS parameters that are true or false."""

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node


def declare_flag(node: Node, name: str, description: str) -> None:
    """Declare a parameter that is false unless it is set; any type is taken, and judged later."""
    descriptor = ParameterDescriptor(description=description, dynamic_typing=True)
    node.declare_parameter(name, False, descriptor)


def read_flag(node: Node, name: str) -> bool:
    """Return whether a flag is set.

    Raises
    ------
    ValueError
        When it is neither true nor false.
    """
    value = node.get_parameter(name).value
    if not isinstance(value, bool):
        raise ValueError(f"parameter {name} = {value!r}: expected true or false")
    return value
