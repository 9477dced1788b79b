"""Health as ``control_msgs/msg/HardwareStatus``, where that package is present.

It is younger than Jazzy, and its parts have had several names: they are found by their fields.
"""

from importlib import import_module
from typing import Any

from diagnostic_msgs.msg import KeyValue

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, OK, WARN
from ema_interfaces.msg import Health

_HEALTH = {OK: "HEALTH_OK", WARN: "HEALTH_WARNING", ERROR: "HEALTH_ERROR"}


def hardware_status_class() -> Any:
    """Return the class of the message; None where the package is missing or has none."""
    try:
        return import_module("control_msgs.msg").HardwareStatus
    except (ImportError, AttributeError):
        return None


def hardware_status(
    message_class: Any, health: Health, description: ActuatorDescription, hardware_id: str
) -> Any:
    """Return a health as the message of a class that ``hardware_status_class`` gave.

    Parameters
    ----------
    message_class
        The class.
    health, description
        Health and description of the actuator.
    hardware_id
        Its name in the status.
    """
    message = message_class(header=health.header, hardware_id=hardware_id)
    device = _element(message, "hardware_device_states")
    device.header, device.device_id = health.header, health.actuator_id
    for field in device.get_fields_and_field_types():
        state = _element(device, field)
        if hasattr(state, "health_status"):
            state.health_status = getattr(state, _HEALTH.get(health.level, "HEALTH_UNKNOWN"))
            state.error_domain = [state.ERROR_HW] if health.level == ERROR else []
            state.model = description.model
            state.state_details = [
                KeyValue(key=key, value=value)
                for key, value in (
                    ("serial_number", health.serial_number),
                    ("health_index", f"{health.health_index:.9g}"),
                    ("dominant_fault", health.dominant_fault),
                    ("severity", str(health.severity)),
                )
            ]
            setattr(device, field, [state])
            break
    message.hardware_device_states = [device]
    return message


def _element(message: Any, field: str) -> Any:
    """Return a new element of a sequence of messages; None where a field is no such sequence."""
    kind = message.get_fields_and_field_types()[field]
    package, _, name = kind.removeprefix("sequence<").removesuffix(">").partition("/")
    if not (kind.startswith("sequence<") and name):
        return None
    return getattr(import_module(f"{package}.msg"), name)()
