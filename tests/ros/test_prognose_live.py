"""`ema prognose` says of a bag of tests what the monitor said when they were made."""

from pathlib import Path

from ema_cli.bags.source_options import Source
from ema_cli.bags.unit_course import follow
from ema_cli.bags.unit_record import read_unit
from ema_cli.commands.estimate import estimate_windows
from ema_cli.identification_options import IdentificationOptions
from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import Health, Usage
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.node.messages import health_to_message
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.windows.trigger import TriggerSettings
from ema_recording.actuator_bag import SimulatedActuatorBag
from ema_recording.writer import BagWriter
from ema_ros import topics
from ema_ros.stamps import stamp_to_message
from ema_sim.actuator import SimulatedActuator

from .monitor_session import CYCLE, FLAP, START_NS, monitor
from .mounted_units import mount

TESTS = 8


def counted_tests() -> list[tuple[Telemetry, Usage]]:
    """Tests at irregular intervals, whose cycles somebody else has counted since before."""
    actuator = SimulatedActuator(stamp_ns=START_NS)
    told = []
    for number in range(TESTS):
        actuator.faults = fault_vector({"friction": 0.1 + 0.03 * number})
        block = actuator.advance(CYCLE.samples)
        hours = 12.0 * number + number % 3
        usage = Usage(actuator_id=FLAP.actuator_id, flight_hours=hours, cycles=100 + number)
        usage.header.stamp = stamp_to_message(block.stamp_ns)
        told.append((block, usage))
    return told


def recorded(path: Path, tests: list[tuple[Telemetry, Usage]]) -> Path:
    with BagWriter(path) as writer, SimulatedActuatorBag(writer, FLAP) as bag:
        name = f"{topics.NAMESPACE}/{topics.USAGE}"
        for block, usage in tests:
            writer.write(name, usage, block.stamp_ns)
            bag.write_block(block, 0.0)
    return path


def offline(path: Path) -> list[Health]:
    trigger = TriggerSettings()
    record = read_unit([path], Source(None, None, trigger.threshold, trigger.rest_s, None))
    options = IdentificationOptions(SearchSettings(), None)
    calibration = Calibration.builtin()
    estimates = estimate_windows(record.windows, calibration, options)
    course = follow(record, estimates, calibration.unit_parameters, PrognosisSettings())
    return [health_to_message(outlook, record.description) for outlook in course.outlooks]


def test_every_health_message_is_that_of_the_live_monitor_to_the_last_digit(tmp_path: Path):
    tests = counted_tests()
    with monitor() as session:
        mount(session, FLAP)
        for _, usage in tests:
            session.send(topics.USAGE, usage)
        # Once the last count is complained of, all before it have been heard.
        session.send(topics.USAGE, Usage(actuator_id=FLAP.actuator_id, flight_hours=-5.0))
        session.until_status("flap telemetry", "flight_hours = -5 h")
        for number, (block, _) in enumerate(tests):
            session.feed([block])
            session.until(lambda n=number: len(session.healths()) > n)
        live = session.healths()
    told = offline(recorded(tmp_path / "life.mcap", tests))
    assert [str(message) for message in told] == [str(message) for message in live]
    assert [message.flight_hours for message in told] == [item.flight_hours for _, item in tests]
    assert told[-1].rul.known
