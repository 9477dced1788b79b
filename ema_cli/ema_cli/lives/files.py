"""Tests of a simulated life in files: a bag each, or a line of JSON with the estimate of each."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_cli.lives.tests_of_life import LifeTest, calibration_of_life
from ema_cli.new_bag import new_bag
from ema_core.description import ActuatorDescription
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.estimate import Estimate, by_fault, estimate_record
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings

_MEASURED: Final = ("faults", "covariance", "unobservable", "goodness_of_fit")


def write_test(path: Path, test: LifeTest, description: ActuatorDescription) -> None:
    """Write a test with its true faults and the service life that was counted before it.

    Parameters
    ----------
    test
        The test. Its stamps are service hours, so that those of a life's tests ascend.
    """
    with new_bag(path) as writer, SimulatedActuatorBag(writer, description, test.start_ns) as bag:
        bag.begin_cycle(test.number, test.faults, test.hours)
        for block in test.blocks:
            bag.write_block(block)


def with_estimates(
    tests: Iterable[LifeTest], description: ActuatorDescription
) -> Iterator[tuple[LifeTest, Estimate]]:
    """Yield the tests of an actuator with their estimates, valid or not, as of a monitor."""
    calibration, diagnosis = calibration_of_life(description), Diagnosis()
    for test in tests:
        finder = WindowFinder(TriggerSettings(), description)
        events = [event for block in test.blocks for event in finder.feed(block)]
        segment = next(item for item in [*events, *finder.finish()] if isinstance(item, Segment))
        for one in diagnosis.add(segment, calibration, SearchSettings()):
            if isinstance(one, Diagnosed):
                yield test, one.estimate


def as_line(test: LifeTest, estimate: Estimate) -> str:
    """Return a test and its estimate as a line of JSON; what is not a number is null."""
    record = estimate_record(estimate)
    content = {
        "test": test.number,
        "hours": test.hours,
        "window": test.window,
        "valid": record["valid"],
        "reason": record["reason"],
        "truth": by_fault(test.faults),
        **{name: record[name] for name in _MEASURED},
    }
    return json.dumps(content) + "\n"
