# SPDX-License-Identifier: Apache-2.0
"""Conversions between numerics and messages are lossless and refuse impossible values."""

import array
from dataclasses import fields, replace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message

from ema_core.acquisition import CURRENT_SAMPLINGS, EFFORT_UNITS, Acquisition
from ema_core.description import DRIVES, ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import COLUMNS, Telemetry
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_ros.actuator_messages import joint_state_after
from ema_ros.messages import (
    IDENTITY,
    PARAMETER_FIELDS,
    description_from_message,
    description_to_message,
    faults_from_message,
    faults_to_message,
    telemetry_from_message,
    telemetry_to_message,
)
from ema_ros.stamps import stamp_from_message, stamp_to_message


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


def some_telemetry(n: int = 100, first_index: int = 7) -> Telemetry:
    columns = np.random.default_rng(1).normal(size=(len(COLUMNS), n))
    return Telemetry(1_700_000_000_123_456_789, 1e-4, first_index, *columns)


@pytest.mark.parametrize(
    ("stamp_ns", "sec", "nanosec"),
    [(0, 0, 0), (999_999_999, 0, 999_999_999), (10**9, 1, 0), (-1, -1, 999_999_999)],
)
def test_stamp_is_converted_both_ways(stamp_ns: int, sec: int, nanosec: int):
    message = stamp_to_message(stamp_ns)
    assert message == Time(sec=sec, nanosec=nanosec)
    assert stamp_from_message(message) == stamp_ns


@pytest.mark.parametrize("stamp_ns", [2**31 * 10**9, -(2**31) * 10**9 - 1])
def test_stamp_out_of_range_is_refused(stamp_ns: int):
    with pytest.raises(ValueError, match=r"stamp_ns = -?\d+ ns is outside"):
        stamp_to_message(stamp_ns)


def test_telemetry_survives_the_wire():
    sent = some_telemetry(first_index=2**63 + 1)
    message = over_the_wire(telemetry_to_message(sent, "flap"))
    received = telemetry_from_message(message)
    assert message.actuator_id == "flap"
    assert (received.stamp_ns, received.sample_period) == (sent.stamp_ns, sent.sample_period)
    assert received.first_index == 2**63 + 1
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(received, name), getattr(sent, name))


def test_payload_survives_the_wire():
    payload = np.repeat([0.0, 2.5], 50)
    sent = replace(some_telemetry(), payload=payload)
    received = telemetry_from_message(over_the_wire(telemetry_to_message(sent, "flap")))
    np.testing.assert_array_equal(received.payload, payload)
    plain = over_the_wire(telemetry_to_message(some_telemetry(), "flap"))
    assert not telemetry_from_message(plain).has_payload


def test_received_telemetry_owns_its_columns():
    message = telemetry_to_message(some_telemetry(), "flap")
    block = telemetry_from_message(message)
    before = block.current.copy()
    message.current[0] = 1e9
    np.testing.assert_array_equal(block.current, before)
    assert block.current.flags.owndata
    assert block.current.flags.writeable


def test_columns_of_other_types_become_float64():
    columns = [np.arange(6, dtype=kind)[::2] for kind in (np.int32, np.float32, np.int64, float)]
    message = telemetry_to_message(Telemetry(0, 1e-4, 0, *columns), "flap")
    for name in COLUMNS:
        assert getattr(message, name) == array.array("d", [0.0, 2.0, 4.0])


def test_every_parameter_and_every_field_is_mapped():
    assert list(PARAMETER_FIELDS) == [item.name for item in fields(ActuatorParameters)]
    acquisition = {"current_sampling", "current_filter_time", "speed_measured", "has_command"}
    acquisition |= {"effort_kind"}
    mapped = {"header", "drive", *IDENTITY, *acquisition, *PARAMETER_FIELDS.values()}
    assert mapped == set(DescriptionMessage.get_fields_and_field_types())
    assert len(set(PARAMETER_FIELDS.values())) == len(PARAMETER_FIELDS)
    described = {*IDENTITY, "drive", "acquisition", "parameters"}
    assert described == {item.name for item in fields(ActuatorDescription)}
    assert constants_named("CURRENT_") == list(CURRENT_SAMPLINGS)
    assert constants_named("EFFORT_") == ["current", "torque", "force"]
    assert len(EFFORT_UNITS) == 3
    assert constants_named("DRIVE_") == list(DRIVES)


def constants_named(prefix: str) -> list[str]:
    """Return the names of the constants of a description with a prefix, in order of values."""
    metaclass = type(DescriptionMessage)
    defined = vars(metaclass)["_Metaclass_ActuatorDescription__constants"]
    names = [name for name in defined if name.startswith(prefix)]
    by_value = sorted(names, key=lambda name: getattr(DescriptionMessage, name))
    return [name.removeprefix(prefix).lower() for name in by_value]


def test_description_survives_the_wire():
    parameters = ActuatorParameters()
    # Every parameter has a different value, so that swapped parameters are noticed.
    changed = {
        item.name: getattr(parameters, item.name) * (1.0 + 1e-3 * number)
        for number, item in enumerate(fields(ActuatorParameters))
        if item.name != "P"
    }
    acquisition = Acquisition("filtered", 1e-3, speed=False)
    sent = ActuatorDescription(
        *("left_flap", "SN-7", "type 5", 2e-4, replace(parameters, **changed)),
        *("field_oriented", acquisition),
    )
    message = over_the_wire(description_to_message(sent, stamp_ns=5))
    assert description_from_message(message) == sent
    assert stamp_from_message(message.header.stamp) == 5
    assert message.gear_ratio == sent.parameters.tau
    assert message.pole_pairs == 2


def test_drive_without_a_position_command_survives_the_wire():
    acquisition = Acquisition(command=False)
    sent = ActuatorDescription(drive="unknown", acquisition=acquisition)
    assert description_from_message(over_the_wire(description_to_message(sent))) == sent
    row = np.arange(3.0)
    block = Telemetry(10**9, 1e-3, 1, np.empty(0), row, row + 1.0, row + 2.0)
    received = telemetry_from_message(over_the_wire(telemetry_to_message(block, "wheel")))
    assert (received.has_command, received.missing, len(received)) == (False, ("command",), 3)
    assert received.position.tolist() == [1.0, 2.0, 3.0]


def test_unknown_constant_of_a_description_is_refused_by_name():
    message = description_to_message(ActuatorDescription())
    message.current_sampling = 9
    with pytest.raises(ValueError, match="current_sampling = 9: expected a constant from 0 to 3"):
        description_from_message(message)


def test_faults_survive_the_wire_in_order():
    k = np.linspace(0.1, 0.8, 8)
    message = over_the_wire(faults_to_message(k))
    assert message.friction == k[0]
    assert message.gain == k[7]
    np.testing.assert_array_equal(faults_from_message(message), k)


def test_joint_state_has_one_joint():
    columns = np.zeros((4, 2))
    columns[2:, 1] = 0.1, -100.0
    block = Telemetry(1_499_900_000, 1e-4, 1, *columns)
    message = over_the_wire(joint_state_after(block, 0.5, ActuatorDescription("flap")))
    assert message.name == ["flap"]
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    assert [list(message.position), list(message.velocity), list(message.effort)] == [
        [0.1],
        [-0.2],
        [250.0],
    ]
