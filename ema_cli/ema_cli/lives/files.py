"""What the monitor estimates in the tests of a simulated life, a line of JSON each."""

import json
from typing import Final

from ema_cli.lives.tests_of_life import LifeTest
from ema_cli.lives.unit import calibration_of_life
from ema_core.description import ActuatorDescription
from ema_monitor.identification.estimate import Estimate, by_fault, estimate_record
from ema_monitor.identification.search import LastFaults, identify
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings

_MEASURED: Final = ("faults", "covariance", "unobservable", "goodness_of_fit")


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
        watch = WindowFinder(TriggerSettings(), self._description)
        events = [event for block in test.blocks for event in watch.feed(block)]
        found = next(item for item in [*events, *watch.finish()] if isinstance(item, Segment))
        previous = self._last_faults.of(self._description, self._calibration)
        estimate = identify(found.window, self._description, self._calibration, previous=previous)
        self._last_faults.record(self._description, estimate)
        return estimate


def as_line(test: LifeTest, estimate: Estimate) -> str:
    """Return a test and its estimate as a line of JSON; what is not a number is null.

    Parameters
    ----------
    test
        The test, with the truth.
    estimate
        What was found in it.
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
