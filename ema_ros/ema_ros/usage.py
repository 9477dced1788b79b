"""Service hours and cycles as ema_interfaces/Usage."""

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import Usage
from ema_ros.stamps import stamp_to_message


def usage_at_cycle(
    description: ActuatorDescription, stamp_ns: int, hours: float, cycle: int
) -> Usage:
    """Return the service life of an actuator at the start of a test cycle as a message.

    Parameters
    ----------
    description
        The actuator.
    stamp_ns
        Start of the cycle [ns].
    hours
        Service hours since new [h].
    cycle
        Running number of the cycle, from 0; the count includes it.

    Raises
    ------
    ValueError
        When the stamp is out of range.
    """
    message = Usage(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        flight_hours=float(hours),
        cycles=cycle + 1,
    )
    message.header.stamp = stamp_to_message(stamp_ns)
    return message
