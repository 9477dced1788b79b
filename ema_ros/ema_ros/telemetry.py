"""Telemetry blocks: contiguous columns and ema_interfaces/TelemetryBlock."""

import array
from typing import TYPE_CHECKING

import numpy as np

from ema_core.telemetry import COLUMNS, Telemetry
from ema_ros.stamps import check_stamp, stamp_from_message, stamp_to_message

if TYPE_CHECKING:
    from ema_interfaces.msg import TelemetryBlock


def telemetry_to_message(block: Telemetry, actuator_id: str) -> "TelemetryBlock":
    """Return a block of telemetry as a message; its stamp is the END of the first sample.

    Raises
    ------
    ValueError
        When the block's stamp is out of range.
    """
    from ema_interfaces.msg import TelemetryBlock  # reading needs no ROS

    message = TelemetryBlock()
    message.header.stamp = stamp_to_message(block.stamp_ns)
    message.actuator_id = actuator_id
    message.sample_period = float(block.sample_period)
    message.first_index = int(block.first_index)
    for name in COLUMNS:
        # An array.array is stored as it is; any other sequence is checked item by item.
        column = np.asarray(getattr(block, name), dtype=np.float64)
        setattr(message, name, array.array("d", column.tobytes()))
    return message


def telemetry_from_message(message: "TelemetryBlock") -> Telemetry:
    """Return the block of telemetry in a message, in columns of its own.

    Samples that are not finite are accepted here; the monitor checks them.

    Raises
    ------
    ValueError
        When the columns differ in length or are empty, the period is out of range, or the block
        ends after the latest possible stamp.
    """
    block = Telemetry(
        stamp_from_message(message.header.stamp),
        message.sample_period,
        message.first_index,
        *(np.array(getattr(message, name), dtype=np.float64) for name in COLUMNS),
    )
    check_stamp(block.stamp_at(len(block) - 1))
    return block
