"""ROS parameters declared from, and read into, the dataclasses that validate them."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final, Generic, TypeVar
from weakref import WeakKeyDictionary

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterValueException, ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ema_core.parameter import SettingsParameter, parameters_of
from ema_ros.rclpy_private import given_parameters

Definition = TypeVar("Definition")

LIVE: Final = "live"
"""Constraint of a parameter that can be changed at any time."""

WHILE_UNCONFIGURED: Final = "changed while the node is unconfigured"
"""Constraint of a parameter that is read when the node is configured."""


def declare(node: Node, definition: Any, prefix: str = "", *, constraint: str = "") -> None:
    """Declare the fields of a dataclass as parameters of a node.

    The definition is a dataclass whose fields were made by ``quantity``, ``text``, ``texts`` and
    ``flag``, or an instance of one whose values are the defaults; other fields are ignored. The
    constraint says when they can be changed; without it they cannot. A given value that is
    impossible is a ValueError.
    """
    given = given_parameters(node)
    for parameter in parameters_of(definition, prefix):
        item = parameter.field
        default = getattr(definition, item.name, item.default)
        descriptor = _descriptor(parameter, constraint)
        override = given[parameter.name].value if parameter.name in given else None
        number = parameter.number_of(override)
        # A number given as another type is declared with the type of the field.
        is_read = number is not override
        value = number if is_read else parameter.to_node(default)
        try:
            node.declare_parameter(parameter.name, value, descriptor, ignore_override=is_read)
        except InvalidParameterValueException as error:
            reason = str(error).partition("Reason: ")[2].rpartition(":")[0]
            raise ValueError(
                f"{reason} {parameter.unit} ({item.metadata['description']})"
            ) from error


def read(node: Node, definition: type[Definition], prefix: str = "") -> Definition:
    """Return an instance of a dataclass with the values of parameters that were declared by it.

    A value that is impossible is a ValueError that names the parameter.
    """
    values = {
        item.field.name: item.from_node(node.get_parameter(item.name).value)
        for item in parameters_of(definition, prefix)
    }
    try:
        return definition(**values)
    except ValueError as error:
        raise ValueError(f"parameter {prefix}{error}") from error


_LIVE_PARAMETERS: Final[WeakKeyDictionary[Node, dict[str, SettingsParameter]]] = WeakKeyDictionary()


class LiveSettings(Generic[Definition]):
    """Settings that can be changed; impossible values are refused with the reason.

    Parameters
    ----------
    node, definition, prefix
        As in ``declare``; an initial value that is impossible is a ValueError.
    on_change
        Called with the new settings after a change.
    why_fixed
        Gives why they cannot be changed at present; empty when they can. Without it they are live.
    check
        Called with new settings before a change; a ValueError refuses it.

    Attributes
    ----------
    value
        The settings as they are now.
    """

    def __init__(
        self,
        node: Node,
        definition: type[Definition],
        prefix: str = "",
        on_change: Callable[[Definition], object] = lambda _: None,
        why_fixed: Callable[[], str] | None = None,
        check: Callable[[Definition], object] = lambda _: None,
    ) -> None:
        self._prefix = prefix
        self._parameters = {item.name: item for item in parameters_of(definition, prefix)}
        self._on_change, self._check_new = on_change, check
        self._why_fixed = why_fixed
        constraint = WHILE_UNCONFIGURED if why_fixed else LIVE
        declare(node, definition, prefix, constraint=constraint)
        self.value: Definition = read(node, definition, prefix)
        # One such callback a node: rclpy answers each parameter as often as there are some.
        known = _LIVE_PARAMETERS.setdefault(node, {})
        if not known:
            node.add_pre_set_parameters_callback(partial(_read_numbers, node, known))
        known |= self._parameters
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _changed(self, parameters: list[Parameter]) -> Definition | None:
        items = [
            (self._parameters[item.name], item)
            for item in parameters
            if item.name in self._parameters
        ]
        changes = {known.field.name: known.from_node(item.value) for known, item in items}
        return replace(self.value, **changes) if changes else None  # pyright: ignore

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            changed = self._changed(parameters)
            if changed is not None:
                self._check_new(changed)
            reason = self._why_fixed() if changed is not None and self._why_fixed else ""
            if reason and changed != self.value:
                names = ", ".join(item.name for item in parameters if item.name in self._parameters)
                return SetParametersResult(successful=False, reason=f"{names}: {reason}")
        except ValueError as error:
            return SetParametersResult(successful=False, reason=f"{self._prefix}{error}")
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        changed = self._changed(parameters)
        if changed is not None:
            self.value = changed
            self._on_change(changed)


def _read_numbers(
    node: Node, known: Mapping[str, SettingsParameter], parameters: list[Parameter]
) -> list[Parameter]:
    """Return the parameters, numbers with their fields' types; refuse undeclared ones."""
    for item in parameters:
        # rclpy would not name it.
        if not node.has_parameter(item.name):
            raise ParameterNotDeclaredException(item.name)
    return [
        Parameter(item.name, value=known[item.name].number_of(item.value))
        if item.name in known and item.value is not None
        else item
        for item in parameters
    ]


def _descriptor(parameter: SettingsParameter, constraint: str) -> ParameterDescriptor:
    metadata = parameter.field.metadata
    # The dataclass checks the type, so that an integer is accepted for a float.
    descriptor = ParameterDescriptor(
        description=metadata["description"], read_only=not constraint, dynamic_typing=True
    )
    constraints = [constraint] if constraint else []
    if "range" in metadata:
        low, high = metadata["range"]
        descriptor.description += f" [{parameter.unit}]"
        if isinstance(parameter.field.default, int):
            whole = IntegerRange(from_value=int(low), to_value=int(high), step=1)
            descriptor.integer_range = [whole]
        else:
            low, high = float(parameter.to_node(low)), float(parameter.to_node(high))
            floating = FloatingPointRange(from_value=low, to_value=high, step=0.0)
            descriptor.floating_point_range = [floating]
    elif metadata.get("choices"):
        constraints.append(f"one of {', '.join(metadata['choices'])}")
    descriptor.additional_constraints = "; ".join(constraints)
    return descriptor
