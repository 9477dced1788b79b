"""Tests of a simulated life in files: a bag each, or a line of JSON with the estimate of each."""

import json
from pathlib import Path
from typing import Final

from ema_cli.lives.tests_of_life import LifeTest, calibration_of_life
from ema_cli.new_bag import new_bag
from ema_core.description import ActuatorDescription
from ema_monitor.identification.estimate import Estimate, by_fault, estimate_record
from ema_monitor.identification.search import LastFaults, identify
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_recording.actuator_bag import SimulatedActuatorBag

_MEASURED: Final = ("faults", "covariance", "unobservable", "goodness_of_fit")


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


class LifeEstimator:
    """Estimates the faults in test after test of one actuator, as a monitor does.

    Parameters
    ----------
    description
        The actuator, as of ``unit_of_life``.
    """

    def __init__(self, description: ActuatorDescription) -> None:
        self._description = description
        self._calibration = calibration_of_life(description)
        self._last_faults = LastFaults()

    def estimate(self, test: LifeTest) -> Estimate:
        """Return the estimate of a test, be it valid or not.

        Parameters
        ----------
        test
            The test.
        """
        finder = WindowFinder(TriggerSettings(), self._description)
        events = [event for block in test.blocks for event in finder.feed(block)]
        segment = next(item for item in [*events, *finder.finish()] if isinstance(item, Segment))
        previous = self._last_faults.of(self._description, self._calibration)
        estimate = identify(segment.window, self._description, self._calibration, previous=previous)
        self._last_faults.record(self._description, estimate)
        return estimate


def as_line(test: LifeTest, estimate: Estimate) -> str:
    """Return a test and its estimate as a line of JSON; what is not a number is null.

    Parameters
    ----------
    test
        The test, with the truth.
    estimate
        Its estimate.
    """
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
