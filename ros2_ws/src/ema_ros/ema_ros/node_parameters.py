# SPDX-License-Identifier: Apache-2.0
"""ROS parameters from dataclasses: declaration, reading and validation."""

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

from ema_core.settings_parameters import SettingsParameter, parameters_of
from ema_ros.rclpy_private import parameter_overrides

Definition = TypeVar("Definition")

LIVE: Final = "live"
"""Constraint for a parameter that can be changed at any time."""

WHILE_UNCONFIGURED: Final = "can only be changed while the node is unconfigured"
"""Constraint for a parameter that is read when the node is configured."""


def declare(node: Node, definition: Any, prefix: str = "", *, constraint: str = "") -> None:
    """Declare the fields of a dataclass as node parameters.

    Parameters
    ----------
    node
        The node.
    definition
        Dataclass with fields created by ``quantity``, ``text``, ``texts`` or ``flag``, or an
        instance whose values are the defaults. Fields without description are ignored.
    prefix
        Prefix of the parameter names.
    constraint
        When the parameters can be changed; "" for read-only parameters.

    Raises
    ------
    ValueError
        If an override is out of range.
    """
    overrides = parameter_overrides(node)
    for parameter in parameters_of(definition, prefix):
        item = parameter.field
        default = getattr(definition, item.name, item.default)
        descriptor = _descriptor(parameter, constraint)
        override = overrides[parameter.name].value if parameter.name in overrides else None
        number = parameter.number_of(override)
        # An override of another numeric type is converted to the type of the field.
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
    """Read the declared parameters of a dataclass into an instance.

    Raises
    ------
    ValueError
        If a value is out of range; the message names the parameter.
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
    """Settings that can be changed at run time; invalid values are refused with the reason.

    Parameters
    ----------
    node, definition, prefix
        See ``declare``.
    on_change
        Called with the new settings after a change.
    why_fixed
        Returns why the settings currently cannot be changed; empty if they can. If omitted, they
        can always be changed.
    check
        Called with new settings before a change; a ValueError refuses the change.

    Attributes
    ----------
    value
        Current settings.

    Raises
    ------
    ValueError
        If an initial value is out of range.
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
        # One callback per node: rclpy returns a result per parameter for each such callback.
        live = _LIVE_PARAMETERS.setdefault(node, {})
        if not live:
            node.add_pre_set_parameters_callback(partial(_read_numbers, node, live))
        live |= self._parameters
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _changed(self, parameters: list[Parameter]) -> Definition | None:
        items = [
            (self._parameters[item.name], item)
            for item in parameters
            if item.name in self._parameters
        ]
        changes = {setting.field.name: setting.from_node(item.value) for setting, item in items}
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
    node: Node, live: Mapping[str, SettingsParameter], parameters: list[Parameter]
) -> list[Parameter]:
    """Convert numbers to the type of their field; refuse undeclared parameters."""
    for item in parameters:
        # rclpy's error would not name the parameter.
        if not node.has_parameter(item.name):
            raise ParameterNotDeclaredException(item.name)
    return [
        Parameter(item.name, value=live[item.name].number_of(item.value))
        if item.name in live and item.value is not None
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
