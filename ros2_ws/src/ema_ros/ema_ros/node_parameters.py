# SPDX-License-Identifier: Apache-2.0
"""ROS parameters from dataclasses: declaration, reading and validation."""

from collections.abc import Callable, Iterable, Mapping
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

from ema_core.settings_parameters import (
    SettingsParameter,
    field_values,
    parameters_of,
    refuse_old_names,
)
from ema_ros.rclpy_private import lifecycle_state, parameter_overrides

Definition = TypeVar("Definition")

LIVE: Final = "live"
"""Constraint of a parameter that can be changed at any time."""

AT_CONFIGURE: Final = "takes effect at the next configure; refused while the node is active"
"""Constraint of a parameter that is read when the node is configured."""

_STATES: Final = ("unconfigured", "inactive")


def declare(node: Node, definition: Any, prefix: str = "", *, is_fixed: bool = False) -> None:
    """Declare the fields of a dataclass as parameters that ``configure`` reads.

    They can be changed while the node is unconfigured or inactive. A new value takes effect at the
    next configure. While the node is active, a change is refused; the reason names the next step.

    Parameters
    ----------
    node
        The lifecycle node.
    definition
        Dataclass with fields created by ``quantity``, ``text``, ``texts`` or ``flag``, or an
        instance whose values are the defaults. Fields without description are ignored.
    prefix
        Prefix of the parameter names.
    is_fixed
        Whether the parameters are read-only.

    Raises
    ------
    ValueError
        If an override is out of range, or has an old name of a parameter.
    """
    _declare(node, definition, prefix, "" if is_fixed else AT_CONFIGURE)
    if not is_fixed:
        names = (item.name for item in parameters_of(definition, prefix))
        _AT_CONFIGURE.setdefault(node, []).extend(names)
        kind = definition if isinstance(definition, type) else type(definition)
        _Changes(node, kind, prefix, partial(_refuse_while_active, node, kind, prefix))


def read(node: Node, definition: type[Definition], prefix: str = "") -> Definition:
    """Read the declared parameters of a dataclass into an instance.

    Raises
    ------
    ValueError
        If a value is out of range; the message names the parameter.
    """
    names = [item.name for item in parameters_of(definition, prefix)]
    values = {name: node.get_parameter(name).value for name in names}
    try:
        return _settings(definition, values, prefix)
    except ValueError as error:
        raise ValueError(f"parameter {error}") from error


def values_at_configure(node: Node) -> dict[str, Any]:
    """Return the values of the parameters that ``configure`` reads, keyed by name."""
    return {name: node.get_parameter(name).value for name in _AT_CONFIGURE.get(node, ())}


class _Changes(Generic[Definition]):
    """Checks the changes of the parameters of a dataclass; refuses them with the reason.

    ``check`` is called with the changed settings and the names of the changed parameters; a
    ValueError refuses the change.
    """

    def __init__(
        self,
        node: Node,
        definition: type[Definition],
        prefix: str,
        check: Callable[[Definition, list[str]], object],
    ) -> None:
        self._node, self._definition, self._prefix = node, definition, prefix
        self._parameters = {item.name: item for item in parameters_of(definition, prefix)}
        self._check = check
        # One callback per node: rclpy returns a result per parameter for each such callback.
        changeable = _CHANGEABLE.setdefault(node, {})
        if not changeable:
            node.add_pre_set_parameters_callback(partial(_read_numbers, node, changeable))
        changeable |= self._parameters
        node.add_on_set_parameters_callback(self._answer)

    def names_in(self, parameters: Iterable[Parameter]) -> list[str]:
        """Return the names of the parameters that belong to the dataclass."""
        return [item.name for item in parameters if item.name in self._parameters]

    def _answer(self, parameters: list[Parameter]) -> SetParametersResult:
        names = self.names_in(parameters)
        if names:
            values = {name: self._node.get_parameter(name).value for name in self._parameters}
            values |= {item.name: item.value for item in parameters}
            try:
                self._check(_settings(self._definition, values, self._prefix), names)
            except ValueError as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


_CHANGEABLE: Final[WeakKeyDictionary[Node, dict[str, SettingsParameter]]] = WeakKeyDictionary()
_AT_CONFIGURE: Final[WeakKeyDictionary[Node, list[str]]] = WeakKeyDictionary()


class LiveSettings(Generic[Definition]):
    """Settings that can be changed at run time; invalid values are refused with the reason.

    Parameters
    ----------
    node, definition, prefix
        See ``declare``.
    on_change
        Called with the new settings after a change.
    check
        Called with new settings before a change; a ValueError refuses the change.

    Attributes
    ----------
    value
        Current settings.

    Raises
    ------
    ValueError
        If an initial value is out of range, or an override has an old name of a parameter.
    """

    def __init__(
        self,
        node: Node,
        definition: type[Definition],
        prefix: str = "",
        on_change: Callable[[Definition], object] = lambda _: None,
        check: Callable[[Definition], object] = lambda _: None,
    ) -> None:
        _declare(node, definition, prefix, LIVE)
        self.value: Definition = read(node, definition, prefix)
        changes = _Changes(node, definition, prefix, lambda new, _: check(new))

        def apply(parameters: list[Parameter]) -> None:
            if changes.names_in(parameters):
                self.value = read(node, definition, prefix)
                on_change(self.value)

        node.add_post_set_parameters_callback(apply)


def _settings(definition: type[Definition], values: Mapping[str, Any], prefix: str) -> Definition:
    """Return settings from values of all parameters; the message of an error has the prefix."""
    fields = field_values(definition, values, prefix)
    try:
        return definition(**fields)
    except ValueError as error:
        raise ValueError(f"{prefix}{error}") from error


def _refuse_while_active(
    node: Node, definition: type[Any], prefix: str, changed: Any, names: list[str]
) -> None:
    state = lifecycle_state(node)
    if state not in _STATES and changed != read(node, definition, prefix):
        raise ValueError(
            f"{', '.join(names)} cannot be changed while the node is {state}: deactivate it, set "
            "the parameter, then clean up, configure and activate"
        )


def _read_numbers(
    node: Node, changeable: Mapping[str, SettingsParameter], parameters: list[Parameter]
) -> list[Parameter]:
    """Convert numbers to the type of their field; refuse undeclared parameters."""
    for item in parameters:
        if not node.has_parameter(item.name):
            try:
                refuse_old_names(changeable.values(), (item.name,))
            except ValueError as error:
                raise _OldName(str(error)) from error
            # rclpy's error would not name the parameter.
            raise ParameterNotDeclaredException(item.name)
    return [
        Parameter(item.name, value=changeable[item.name].number_of(item.value))
        if item.name in changeable and item.value is not None
        else item
        for item in parameters
    ]


class _OldName(ParameterNotDeclaredException):
    """A parameter is set by its old name. rclpy responds with this message."""

    def __init__(self, message: str) -> None:
        Exception.__init__(self, message)


def _declare(node: Node, definition: Any, prefix: str, constraint: str) -> None:
    overrides = parameter_overrides(node)
    parameters = parameters_of(definition, prefix)
    refuse_old_names(parameters, overrides)
    for parameter in parameters:
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
            raise ValueError(f"{reason} {parameter.unit} ({parameter.description})") from error


def _descriptor(parameter: SettingsParameter, constraint: str) -> ParameterDescriptor:
    metadata = parameter.field.metadata
    # The dataclass checks the type, so that an integer is accepted for a float.
    descriptor = ParameterDescriptor(
        description=parameter.description, read_only=not constraint, dynamic_typing=True
    )
    constraints = [constraint] if constraint else []
    if "range" in metadata:
        low, high = metadata["range"]
        descriptor.description += f" [{parameter.unit}]"
        if isinstance(parameter.field.default, int):
            integers = IntegerRange(from_value=int(low), to_value=int(high), step=1)
            descriptor.integer_range = [integers]
        else:
            low, high = float(parameter.to_node(low)), float(parameter.to_node(high))
            floating = FloatingPointRange(from_value=low, to_value=high, step=0.0)
            descriptor.floating_point_range = [floating]
    elif metadata.get("choices"):
        constraints.append(f"one of {', '.join(metadata['choices'])}")
    descriptor.additional_constraints = "; ".join(constraints)
    return descriptor
