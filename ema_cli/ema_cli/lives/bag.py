"""A bag of one test of a simulated life."""

from pathlib import Path

from ema_cli.lives.tests_of_life import LifeTest
from ema_cli.new_bag import new_bag
from ema_core.description import ActuatorDescription
from ema_recording.actuator_bag import SimulatedActuatorBag


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
    with new_bag(path) as writer, SimulatedActuatorBag(writer, description, test.start_ns) as bag:
        bag.begin_cycle(test.number, test.faults, test.hours)
        for block in test.blocks:
            bag.write_block(block)
