"""What the monitor estimates in the tests of a simulated life, a line of JSON each."""

import json
import math
from typing import Any

from numpy.typing import NDArray

from ema_cli.life_tests import LifeTest
from ema_cli.life_unit import calibration_of_life
from ema_core.description import ActuatorDescription
from ema_core.faults import FAULT_NAMES
from ema_monitor.diagnosis import Diagnosis, Search
from ema_monitor.estimate import Estimate
from ema_monitor.last_faults import LastFaults
from ema_monitor.trigger import TriggerSettings
from ema_monitor.watch import Found, Watch


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
        watch = Watch(TriggerSettings(), self._description)
        events = [event for block in test.blocks for event in watch.feed(block)]
        found = next(item for item in [*events, *watch.finish()] if isinstance(item, Found))
        run = Diagnosis(found, self._calibration, Search(), last_faults=self._last_faults)
        for _ in run:
            pass
        if run.estimate is None:
            raise RuntimeError("a diagnosis ended without an estimate")
        return run.estimate


def as_line(test: LifeTest, estimate: Estimate) -> str:
    """Return a test and its estimate as a line of JSON; what is not a number is null.

    Parameters
    ----------
    test
        The test, with the truth.
    estimate
        What was found in it.
    """
    content: dict[str, Any] = {
        "test": test.number,
        "hours": test.hours,
        "window": test.window,
        "valid": estimate.valid,
        "reason": estimate.reason,
        "truth": _by_fault(test.faults),
        "faults": _by_fault(estimate.faults),
        "covariance": [[_number(value) for value in row] for row in estimate.covariance],
        "unobservable": [
            name for name, hidden in zip(FAULT_NAMES, estimate.unobservable, strict=True) if hidden
        ],
        "goodness_of_fit": _number(estimate.goodness_of_fit),
    }
    return json.dumps(content) + "\n"


def _by_fault(values: NDArray[Any]) -> dict[str, float | None]:
    return {name: _number(value) for name, value in zip(FAULT_NAMES, values, strict=True)}


def _number(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None
