"""What is said of a unit after each of its tests, as a live monitor says it."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from ema_cli.progress import progress_bar
from ema_cli.unit_record import UnitRecord
from ema_core.parameters import ActuatorParameters
from ema_monitor.estimate import Estimate
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.observation import Observation
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.prognostics import PrognosisSettings, Prognostics
from ema_monitor.prognosis.tracker import Tracker


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
    history
        The valid ones of them, each once.
    """

    record: UnitRecord
    settings: PrognosisSettings
    parameters: ActuatorParameters
    steps: list[Step]
    history: History

    @property
    def outlooks(self) -> list[Outlook]:
        """What was said after each valid test."""
        return [step.outlook for step in self.steps if step.outlook is not None]

    def tracker(self) -> Tracker:
        """Return the tracker after the last test, for what a prognosis does not tell of it."""
        tracker = Tracker(self.settings.limits, self.settings.tracker)
        for entry in self.history.entries:
            # As in the prognosis: nothing without service hours, and none that went back.
            if not math.isnan(entry.hours) and not entry.hours < tracker.hours:
                tracker.update(Observation.of(entry.estimate, entry.hours))
        return tracker


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
    history = History(unit.actuator_id, unit.serial_number)
    prognostics = Prognostics(history, settings)
    # Only what was counted before a test is told before it, however much there is in all.
    counts = deque(record.counts)
    steps = []
    with progress_bar() as progress:
        for estimate in progress.track(estimates, description="following growth"):
            while counts and counts[0].stamp_ns <= estimate.end_ns:
                prognostics.tell(counts.popleft())
            steps.append(Step(estimate, prognostics.take(estimate, parameters, settings)))
    return Course(record, settings, parameters, steps, history)
