"""Units that are mounted in the place of an actuator, and what is counted of them."""

from ema_core.description import ActuatorDescription

from ..waiting import wait_for
from .monitor_session import MonitorSession
from .worn_actuator import use


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
