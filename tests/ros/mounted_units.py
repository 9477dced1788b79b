"""Units that are mounted in the place of an actuator, and what is counted of them."""

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import Usage
from ema_ros import topics
from ema_ros.stamps import stamp_to_message

from ..waiting import wait_for
from .monitor_session import MonitorSession
from .worn_actuator import use


def count_of(session: MonitorSession, serial_number: str, hours: float, stamp_ns: int) -> None:
    message = Usage(actuator_id="flap", serial_number=serial_number, flight_hours=hours)
    message.header.stamp = stamp_to_message(stamp_ns)
    session.send(topics.USAGE, message)


def mount(session: MonitorSession, description: ActuatorDescription) -> None:
    """Describe a unit, and wait until the monitor knows of it."""
    units = session.node.units
    session.describe(description)
    wait_for(
        lambda: "flap" in units and units["flap"].description == description,
        "the description",
    )


def all_received(session: MonitorSession) -> None:
    """Once an impossible count is reported, all before it have been received."""
    tasks = ("flap telemetry", "input")
    said = {task: len(session.statuses(task)) for task in tasks}
    use(session, -1.0, 1)
    session.until(
        lambda: any(
            "flight_hours = -1 h" in status.message
            for task in tasks
            for status in session.statuses(task)[said[task] :]
        )
    )
