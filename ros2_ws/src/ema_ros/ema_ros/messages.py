# SPDX-License-Identifier: Apache-2.0
"""Conversion of messages to and from telemetry, descriptions, faults and causes.

Reading needs no ROS: a message is any object with the fields of its definition.
"""

import array
from collections.abc import Iterable
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.acquisition import CURRENT_SAMPLINGS, EFFORT_UNITS, Acquisition
from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_core.description import DRIVES, ActuatorDescription
from ema_core.faults import FAULT_NAMES, fault_vector
from ema_core.parameters import ActuatorParameters
from ema_core.settings_parameters import parameters_of
from ema_core.telemetry import SERIES, Telemetry
from ema_ros.stamps import check_stamp, stamp_from_message, stamp_to_message

if TYPE_CHECKING:
    from ema_interfaces import msg

IDENTITY: Final = ("actuator_id", "serial_number", "model", "sample_period")
"""Fields with the same name in the description and its message."""

PARAMETER_FIELDS: Final = MappingProxyType(
    {item.field.name: item.name for item in parameters_of(ActuatorParameters)}
)
"""Message field by parameter name."""


def telemetry_to_message(block: Telemetry, actuator_id: str) -> "msg.TelemetryBlock":
    """Convert a block of telemetry to a message; its stamp is the END of the first sample."""
    from ema_interfaces.msg import TelemetryBlock

    message = TelemetryBlock()
    message.header.stamp = stamp_to_message(block.stamp_ns)
    message.actuator_id = actuator_id
    message.sample_period = float(block.sample_period)
    message.first_index = int(block.first_index)
    for name in SERIES:
        # A message stores an array.array without checks; other sequences are checked per item.
        column = np.asarray(getattr(block, name), dtype=np.float64)
        setattr(message, name, array.array("d", column.tobytes()))
    return message


def telemetry_from_message(message: "msg.TelemetryBlock") -> Telemetry:
    """Convert a message to a block of telemetry with copied columns.

    Samples that are not finite are accepted; the monitor checks them.

    Raises
    ------
    ValueError
        If the columns differ in length or are empty, the period is out of range, or the block
        ends after the latest possible stamp.
    """
    block = Telemetry(
        stamp_from_message(message.header.stamp),
        message.sample_period,
        message.first_index,
        # Messages of an older definition (read without ROS) have no payload.
        **{name: np.array(getattr(message, name, ()), dtype=np.float64) for name in SERIES},
    )
    check_stamp(block.stamp_at(len(block) - 1))
    return block


def description_to_message(
    description: ActuatorDescription, stamp_ns: int = 0
) -> "msg.ActuatorDescription":
    """Return a description as a message.

    Parameters
    ----------
    stamp_ns
        Time at which the description was made [ns]; 0 if it is unknown.
    """
    from ema_interfaces.msg import ActuatorDescription as DescriptionMessage

    message = DescriptionMessage()
    message.header.stamp = stamp_to_message(stamp_ns)
    for name in IDENTITY:
        setattr(message, name, getattr(description, name))
    message.sample_period = float(description.sample_period)
    message.drive = DRIVES.index(description.drive)
    acquisition = description.acquisition
    message.current_sampling = CURRENT_SAMPLINGS.index(acquisition.current)
    message.current_filter_time = acquisition.current_filter
    message.speed_measured = acquisition.speed
    message.has_command = acquisition.command
    message.effort_kind = EFFORT_UNITS.index(acquisition.effort_unit)
    for name, field in PARAMETER_FIELDS.items():
        setattr(message, field, getattr(description.parameters, name))
    return message


def description_from_message(message: "msg.ActuatorDescription") -> ActuatorDescription:
    """Convert a message, also of an older definition (read without ROS), to a description.

    Raises
    ------
    ValueError
        If a parameter is out of range, the id or serial number is empty, the period is not
        positive or a constant is unknown.
    """
    older = {name: field for name, field in PARAMETER_FIELDS.items() if name != "lead"}
    parameters = {name: getattr(message, field) for name, field in older.items()}
    return ActuatorDescription(
        **{name: getattr(message, name) for name in IDENTITY},
        drive=_named("drive", getattr(message, "drive", 0), DRIVES),
        acquisition=Acquisition(
            _named("current_sampling", getattr(message, "current_sampling", 0), CURRENT_SAMPLINGS),
            getattr(message, "current_filter_time", 0.0),
            bool(getattr(message, "speed_measured", True)),
            bool(getattr(message, "has_command", True)),
            _named("effort_kind", getattr(message, "effort_kind", 0), EFFORT_UNITS),
        ),
        parameters=ActuatorParameters(**parameters, lead=getattr(message, "lead", 0.0)),
    )


def faults_to_message(faults: ArrayLike) -> "msg.FaultVector":
    """Convert normalised faults, ``(8,)``, to a message; estimates may be NaN.

    Raises
    ------
    ValueError
        If the array has another shape.
    """
    from ema_interfaces.msg import FaultVector

    k = np.asarray(faults, dtype=np.float64)
    if k.shape != (len(FAULT_NAMES),):
        raise ValueError(f"faults: expected shape ({len(FAULT_NAMES)},), not {k.shape}")
    return FaultVector(**dict(zip(FAULT_NAMES, k.tolist(), strict=True)))


def faults_from_message(message: "msg.FaultVector") -> NDArray[np.float64]:
    """Return the fault vector in a message, ``(8,)``. Raises ValueError if out of range."""
    return fault_vector([getattr(message, name) for name in FAULT_NAMES])


@dataclass(frozen=True, eq=False)
class StampedFaults:
    """True faults of an actuator from the start of a test cycle."""

    stamp_ns: int
    """Start of the test cycle [ns]."""
    actuator_id: str
    cycle: int
    """Number of the test cycle, from 0."""
    faults: NDArray[np.float64]
    """Fault vector, ``(8,)``."""


def stamped_faults_from_message(message: "msg.FaultVectorStamped") -> StampedFaults:
    """Return the stamped faults in a message. Raises ValueError if out of range."""
    return StampedFaults(
        stamp_from_message(message.header.stamp),
        message.actuator_id,
        message.cycle,
        faults_from_message(message.faults),
    )


def measured_to_message(
    stamp_ns: int, causes: Iterable[CauseEstimate], actuator_id: str
) -> "msg.MeasuredCauses":
    """Return causes measured at ``stamp_ns`` as a message."""
    from ema_interfaces.msg import HiddenCause, MeasuredCauses

    message = MeasuredCauses(actuator_id=actuator_id)
    message.header.stamp = stamp_to_message(stamp_ns)
    message.causes = [
        HiddenCause(
            name=cause.name,
            value=cause.value,
            sigma=cause.sigma,
            unit=CAUSE_BY_NAME[cause.name].unit,
        )
        for cause in causes
    ]
    return message


def measured_from_message(message: "msg.MeasuredCauses") -> tuple[int, list[CauseEstimate]]:
    """Return the stamp [ns] and the measured causes of a message, without checking values.

    Raises
    ------
    ValueError
        If the stamp is missing, or a unit differs from the registry.
    """
    stamp_ns = stamp_from_message(message.header.stamp)
    if stamp_ns <= 0:
        raise ValueError(f"stamp = {stamp_ns} ns: expected the measurement time")
    for item in message.causes:
        cause = CAUSE_BY_NAME.get(item.name)
        if cause and item.unit not in ("", cause.unit):
            raise ValueError(
                f"measured cause {item.name}: unit = {item.unit!r}: expected {cause.unit!r}"
            )
    return stamp_ns, [CauseEstimate(item.name, item.value, item.sigma) for item in message.causes]


def _named(field: str, value: int, names: tuple[str, ...]) -> str:
    """Return the name of a constant of the message."""
    if value >= len(names):
        raise ValueError(f"{field} = {value}: expected a constant from 0 to {len(names) - 1}")
    return names[value]
