"""ROS parameters declared from, and read into, the dataclasses that validate them."""

from collections.abc import Callable
from dataclasses import Field, fields, replace
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

Definition = TypeVar("Definition")


def declare(node: Node, definition: Any, prefix: str = "", *, read_only: bool = True) -> None:
    """Declare the fields of a dataclass as parameters of a node.

    Parameters
    ----------
    definition
        A dataclass whose fields were made by ``quantity``, ``text`` and ``flag``, or an
        instance of one whose values are the defaults. Other fields are ignored.
    read_only
        Whether they cannot be changed while the node runs.

    Raises
    ------
    ValueError
        When a given value is impossible.
    """
    is_type = isinstance(definition, type)
    for item in _declared(definition):
        default = item.default if is_type else getattr(definition, item.name)
        descriptor = _descriptor(item, read_only)
        try:
            node.declare_parameter(prefix + item.name, default, descriptor)
        except InvalidParameterValueException as error:
            reason = str(error).partition("Reason: ")[2].rpartition(":")[0]
            raise ValueError(
                f"{reason} {item.metadata.get('unit', '')} ({item.metadata['description']})"
            ) from error


def read(node: Node, definition: type[Definition], prefix: str = "") -> Definition:
    """Return an instance of a dataclass with the values of a node's parameters.

    Parameters
    ----------
    node, definition, prefix
        As given to ``declare``, which must have been called.

    Raises
    ------
    ValueError
        When a value is impossible; the message names the parameter.
    """
    values = {
        item.name: node.get_parameter(prefix + item.name).value for item in _declared(definition)
    }
    try:
        return definition(**values)
    except ValueError as error:
        raise ValueError(f"parameter {prefix}{error}") from error


class LiveSettings(Generic[Definition]):
    """Settings that can be changed while the node runs; impossible values are refused.

    Parameters
    ----------
    node, definition, prefix
        As in ``declare``.
    on_change
        Called with the new settings after a change.

    Raises
    ------
    ValueError
        When an initial value is impossible.
    """

    def __init__(
        self,
        node: Node,
        definition: type[Definition],
        prefix: str = "",
        on_change: Callable[[Definition], None] | None = None,
    ) -> None:
        self._prefix = prefix
        self._names = {prefix + item.name: item.name for item in _declared(definition)}
        self._on_change = on_change
        declare(node, definition, prefix, read_only=False)
        self.value: Definition = read(node, definition, prefix)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _changed(self, parameters: list[Parameter]) -> Definition | None:
        changes = {
            self._names[item.name]: item.value for item in parameters if item.name in self._names
        }
        return replace(self.value, **changes) if changes else None  # pyright: ignore

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._changed(parameters)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=f"{self._prefix}{error}")
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        changed = self._changed(parameters)
        if changed is not None:
            self.value = changed
            if self._on_change is not None:
                self._on_change(changed)


def _declared(definition: Any) -> list[Field[Any]]:
    return [item for item in fields(definition) if "description" in item.metadata]


def _descriptor(item: Field[Any], read_only: bool) -> ParameterDescriptor:
    metadata = item.metadata
    # The dataclass checks the type, so that an integer is accepted for a float.
    descriptor = ParameterDescriptor(
        description=metadata["description"], read_only=read_only, dynamic_typing=True
    )
    if "range" in metadata:
        lowest, highest = metadata["range"]
        descriptor.description += f" [{metadata['unit']}]"
        if isinstance(item.default, int):
            descriptor.integer_range = [
                IntegerRange(from_value=int(lowest), to_value=int(highest), step=1)
            ]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(lowest), to_value=float(highest), step=0.0)
            ]
    elif metadata.get("choices"):
        descriptor.additional_constraints = f"one of {', '.join(metadata['choices'])}"
    return descriptor
