"""Health and life of a unit test by test, from all its estimates and counts."""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence

from ema_core.description import UnitKey
from ema_core.parameters import ActuatorParameters
from ema_monitor.duty.flown import FlownDuty, together
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.count_log import CountLog
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.prognostics import Prognostics
from ema_monitor.prognosis.settings import PrognosisSettings


def outlooks(
    prognostics: Prognostics,
    key: UnitKey,
    estimates: Iterable[Estimate],
    counts: Sequence[Count],
    parameters: ActuatorParameters | None,
    settings: PrognosisSettings,
    flown: Sequence[tuple[int, FlownDuty]] = (),
) -> Iterator[tuple[Estimate, Outlook | None]]:
    """Yield each estimate with the outlook after it, as a monitor gives it; None if it is invalid.

    Parameters
    ----------
    prognostics
        Of the unit; the tests are added to it.
    estimates, counts
        Tests, and service life that was counted, each in order of time.
    parameters
        Those of the unit, as calibrated; None where its drive is unknown.
    settings
        What the prognosis rests on.
    flown
        Duty up to the ends of windows, by their stamps [ns], in order of time.
    """
    # Only counts before a test are logged before it, however many there are in all.
    waiting, log, pieces = deque(counts), CountLog(), deque(flown)
    for estimate in estimates:
        while waiting and waiting[0].stamp_ns <= estimate.end_ns:
            log.add(key, waiting.popleft())
        count, duty = log.latest(key, estimate.end_ns), None
        while pieces and pieces[0][0] <= estimate.end_ns:
            duty = together(duty, pieces.popleft()[1])
        yield estimate, prognostics.update(estimate, parameters, settings, count, duty)
