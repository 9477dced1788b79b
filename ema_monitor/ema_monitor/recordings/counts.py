# SPDX-License-Identifier: Apache-2.0
"""Service-life counts of a unit in a recording."""

from ema_bags.recording import Recording
from ema_bags.telemetry import USAGE_TYPE
from ema_core.description import ActuatorDescription
from ema_monitor.prognosis.history_entry import Count
from ema_ros.stamps import stamp_from_message


def read_counts(bag: Recording, unit: ActuatorDescription) -> tuple[list[Count], list[str]]:
    """Return the service-life counts of a unit in a bag, and remarks on ignored messages.

    Parameters
    ----------
    bag
        The recording.
    unit
        Description of the unit; counts of other units are ignored.

    Raises
    ------
    ValueError
        If the messages cannot be decoded.
    """
    counts: list[Count] = []
    remarks: dict[str, None] = {}
    for item in bag.messages(bag.topics_of(USAGE_TYPE)):
        message = item.message
        if message.actuator_id != unit.actuator_id:
            continue
        # A count without a serial number belongs to the described unit.
        if message.serial_number not in ("", unit.serial_number):
            remarks[f"usage of serial number {message.serial_number!r} is ignored"] = None
            continue
        # A count without a stamp was read when it was recorded.
        stamp_ns = stamp_from_message(message.header.stamp) or item.log_time_ns
        try:
            counts.append(Count(stamp_ns, message.flight_hours, message.cycles))
        except ValueError as error:
            remarks[f"usage is impossible: {error}"] = None
    return counts, list(remarks)
