"""A bag of one test of a simulated life."""

from pathlib import Path
from typing import Any

from std_msgs.msg import Header

from ema_cli.life_tests import LifeTest
from ema_core.description import ActuatorDescription
from ema_interfaces.msg import Usage
from ema_messages import topics
from ema_messages.description import description_to_message
from ema_messages.faults import StampedFaults, stamped_faults_to_message
from ema_messages.stamps import stamp_to_message
from ema_messages.telemetry import telemetry_to_message
from ema_recording.writer import BagWriter


def write_test(path: Path, test: LifeTest, description: ActuatorDescription) -> None:
    """Write a test with its true faults and the service life that was counted before it.

    Parameters
    ----------
    path
        File to write; it must not be there.
    test
        The test. Its stamps are service hours, so that those of a life's tests ascend.
    description
        The actuator.
    """
    unit = description.actuator_id
    truth = StampedFaults(test.start_ns, unit, test.number, test.faults)
    usage = Usage(
        header=Header(stamp=stamp_to_message(test.start_ns)),
        actuator_id=unit,
        flight_hours=test.hours,
        cycles=test.number + 1,
    )
    with BagWriter(path) as bag:

        def write(name: str, message: Any, log_time_ns: int) -> None:
            bag.write(f"{topics.NAMESPACE}/{name}", message, log_time_ns)

        for name, (message_class, qos) in (topics.ACTUATOR_TOPICS | topics.USAGE_TOPICS).items():
            if name != topics.JOINT_STATES:
                bag.add_topic(f"{topics.NAMESPACE}/{name}", message_class, qos)
        write(topics.DESCRIPTION, description_to_message(description), test.start_ns)
        write(topics.USAGE, usage, test.start_ns)
        write(topics.SIMULATED_FAULTS, stamped_faults_to_message(truth), test.start_ns)
        for block in test.blocks:
            end_ns = block.stamp_at(len(block) - 1)
            write(topics.TELEMETRY, telemetry_to_message(block, unit), end_ns)
