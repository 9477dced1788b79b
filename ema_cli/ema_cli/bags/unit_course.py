"""What is said of a unit after each of its tests, as a live monitor says it."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema_cli.bags.unit_record import UnitRecord
from ema_cli.show.progress import progress_bar
from ema_core.parameters import ActuatorParameters
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.prognostics import Prognostics
from ema_monitor.prognosis.service import CountLog
from ema_monitor.prognosis.settings import PrognosisSettings


@dataclass(frozen=True)
class Step:
    """One test.

    Attributes
    ----------
    estimate
        What was found in its window.
    outlook
        What there is to say after it; None when the estimate is not valid.
    """

    estimate: Estimate
    outlook: Outlook | None


@dataclass(frozen=True)
class Course:
    """Tests of one unit and what followed from them.

    Attributes
    ----------
    record
        What the bags say.
    settings, parameters
        What the prognosis rests on.
    steps
        Tests in order of time.
    growth
        What is known of growth after the last of them.
    """

    record: UnitRecord
    settings: PrognosisSettings
    parameters: ActuatorParameters
    steps: list[Step]
    growth: GrowthRecord

    @property
    def outlooks(self) -> list[Outlook]:
        """What was said after each valid test."""
        return [step.outlook for step in self.steps if step.outlook is not None]

    @property
    def hours(self) -> NDArray[np.float64]:
        """Service hours of each valid test [h], ``(n,)``; NaN where unknown or not believed."""
        known = {test.entry.stamp_ns: test.hours for test in self.growth.service.used}
        return np.array([known.get(outlook.stamp_ns, np.nan) for outlook in self.outlooks])


def follow(
    record: UnitRecord,
    estimates: Sequence[Estimate],
    parameters: ActuatorParameters,
    settings: PrognosisSettings,
) -> Course:
    """Return what a monitor says of a unit test by test, with a progress bar.

    Parameters
    ----------
    record
        What the bags say.
    estimates
        Estimate of each of its windows.
    parameters
        Those of the unit, as calibrated.
    settings
        What the prognosis rests on.
    """
    unit = record.description
    key = (unit.actuator_id, unit.serial_number)
    prognostics = Prognostics(History(*key), settings)
    # Only counts before a test are logged before it, however many there are in all.
    counts, log = deque(record.counts), CountLog()
    steps = []
    with progress_bar() as progress:
        for estimate in progress.track(estimates, description="following growth"):
            while counts and counts[0].stamp_ns <= estimate.end_ns:
                log.add(key, counts.popleft())
            count = log.latest(key, estimate.end_ns)
            outlook = prognostics.take(estimate, parameters, settings, count)
            steps.append(Step(estimate, outlook))
    return Course(record, settings, parameters, steps, prognostics.growth)
