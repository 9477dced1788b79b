"""Tests of a unit with counts of its service: recorded to a bag, and heard by a live monitor."""

from collections.abc import Sequence
from pathlib import Path

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_cli.bags.source import Source
from ema_cli.bags.unit_record import UnitRecord, read_unit
from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import Usage
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros import topics
from ema_ros.stamps import stamp_to_message
from ema_sim.actuator import SimulatedActuator

from .monitor_session import CYCLE, FLAP, START_NS, MonitorSession
from .mounted_units import mount

CountedTest = tuple[Telemetry, Usage]


def counted_tests(tests: int, friction_per_test: float) -> list[CountedTest]:
    """Tests at irregular intervals, whose cycles somebody else has counted since before."""
    actuator = SimulatedActuator(stamp_ns=START_NS)
    told = []
    for number in range(tests):
        actuator.faults = fault_vector({"friction": 0.1 + friction_per_test * number})
        block = actuator.advance(CYCLE.samples)
        hours = 12.0 * number + number % 3
        usage = Usage(actuator_id=FLAP.actuator_id, flight_hours=hours, cycles=100 + number)
        usage.header.stamp = stamp_to_message(block.stamp_ns)
        told.append((block, usage))
    return told


def recorded(path: Path, tests: Sequence[CountedTest]) -> UnitRecord:
    """Write tests to a bag, and read it as the commands do."""
    with BagWriter(path) as writer, SimulatedActuatorBag(writer, FLAP) as bag:
        for block, usage in tests:
            writer.write(f"{topics.NAMESPACE}/{topics.USAGE}", usage, block.stamp_ns)
            bag.write_block(block, 0.0)
    trigger = TriggerSettings()
    return read_unit([path], Source(trigger=trigger))


def let_hear(session: MonitorSession, tests: Sequence[CountedTest]) -> None:
    """Send all counts, then test by test, and wait for the health of each."""
    mount(session, FLAP)
    for _, usage in tests:
        session.send(topics.USAGE, usage)
    # Once the last count is complained of, all before it have been heard.
    session.send(topics.USAGE, Usage(actuator_id=FLAP.actuator_id, flight_hours=-5.0))
    session.until_status("flap telemetry", "flight_hours = -5 h")
    for number, (block, _) in enumerate(tests):
        session.feed([block])
        session.until(lambda n=number: len(session.healths()) > n)
