"""Health as the message of ros2_control, where that is present: here stand-ins of it."""

import sys
from types import ModuleType
from typing import Any, ClassVar

import pytest
from std_msgs.msg import Header

from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_interfaces.msg import Health
from ema_monitor.node.hardware_status import hardware_status, hardware_status_class


class Definition:
    """A message with the fields that its class names."""

    FIELDS: ClassVar[dict[str, str]] = {}

    def __init__(self, **given: Any) -> None:
        for name in self.FIELDS:
            setattr(self, name, given.get(name))

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        return cls.FIELDS


class CANopenState(Definition):
    FIELDS: ClassVar = {"node_id": "uint8"}


class GenericState(Definition):
    HEALTH_UNKNOWN, HEALTH_OK, HEALTH_WARNING, HEALTH_ERROR, ERROR_HW = 0, 1, 3, 4, 2
    FIELDS: ClassVar = {
        **{"health_status": "uint8", "error_domain": "sequence<uint8>", "model": "string"},
        "state_details": "sequence<diagnostic_msgs/KeyValue>",
    }


class HardwareDeviceStatus(Definition):
    FIELDS: ClassVar = {
        **{"header": "std_msgs/Header", "device_id": "string"},
        "canopen_states": "sequence<control_msgs/CANopenState>",
        "hardware_status": "sequence<control_msgs/GenericState>",
    }


class HardwareStatus(Definition):
    FIELDS: ClassVar = {
        **{"header": "std_msgs/Header", "hardware_id": "string"},
        "hardware_device_states": "sequence<control_msgs/HardwareDeviceStatus>",
    }


@pytest.fixture
def control_msgs(monkeypatch: pytest.MonkeyPatch) -> None:
    package, messages = ModuleType("control_msgs"), ModuleType("control_msgs.msg")
    for kind in (CANopenState, GenericState, HardwareDeviceStatus, HardwareStatus):
        setattr(messages, kind.__name__, kind)
    monkeypatch.setitem(sys.modules, "control_msgs", package)
    monkeypatch.setitem(sys.modules, "control_msgs.msg", messages)


@pytest.mark.usefixtures("control_msgs")
@pytest.mark.parametrize(
    ("level", "expected", "domain"), [(OK, 1, []), (WARN, 3, []), (ERROR, 4, [2]), (STALE, 0, [])]
)
def test_health_is_that_of_one_device(level: int, expected: int, domain: list[int]):
    health = Health(header=Header(frame_id="x"), actuator_id="flap", level=level, severity=2)
    kind = hardware_status_class()
    message = hardware_status(kind, health, ActuatorDescription(), "/ema/flap/1")
    assert message.hardware_id == "/ema/flap/1"
    [device] = message.hardware_device_states
    assert (device.device_id, device.header) == ("flap", health.header)
    [state] = device.hardware_status
    assert (state.health_status, state.error_domain) == (expected, domain)
    assert state.model == ActuatorDescription().model
    assert {item.key: item.value for item in state.state_details}["severity"] == "2"
    assert device.canopen_states is None


def test_without_the_package_there_is_no_class(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "control_msgs.msg", None)
    assert hardware_status_class() is None
    monkeypatch.setitem(sys.modules, "control_msgs.msg", ModuleType("control_msgs.msg"))
    assert hardware_status_class() is None
