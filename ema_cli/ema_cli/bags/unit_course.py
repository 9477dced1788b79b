"""Health and life of a unit after each of its tests, as a monitor gives them, and the truth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema_bags.windows import truth_at
from ema_cli.bags.unit_record import UnitRecord
from ema_cli.show.progress import progress_bar
from ema_core.faults import FAULTS, N_FAULTS
from ema_core.parameters import ActuatorParameters
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.duty.scenario import Scenario
from ema_monitor.prognosis.forecaster import Forecaster
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook, unknown_outlook
from ema_monitor.prognosis.requirements.requirements import FITTED, REQUIREMENTS
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit


@dataclass(frozen=True)
class Step:
    """One test.

    Attributes
    ----------
    outlook
        Health and life after it; None when nothing follows from it.
    """

    estimate: Estimate
    outlook: Outlook | None


@dataclass(frozen=True)
class Course:
    """Tests of one unit and what followed from them.

    Attributes
    ----------
    steps
        Tests in order of time.
    growth
        What is known of growth after the last of them.
    forecaster
        What forecasts the faults from there on; None without a valid test.
    scenarios
        Scenarios of future duty, with the health and life under each after the last test.
    """

    record: UnitRecord
    settings: PrognosisSettings
    parameters: ActuatorParameters | None
    steps: list[Step]
    growth: GrowthRecord
    forecaster: Forecaster | None
    scenarios: tuple[tuple[Scenario, Outlook], ...] = ()

    @property
    def outlooks(self) -> list[Outlook]:
        """Health and life after each valid test; tables and pictures need at least one."""
        return [step.outlook for step in self.valid if step.outlook is not None]

    @property
    def valid(self) -> list[Step]:
        """The valid tests."""
        return [step for step in self.steps if step.estimate.valid]

    @property
    def now(self) -> Outlook:
        """Health and life after the newest test, valid or refused."""
        known = (step.outlook for step in reversed(self.steps) if step.outlook is not None)
        return next(known, unknown_outlook("no test so far"))

    @property
    def hours(self) -> NDArray[np.float64]:
        """Service hours of each valid test [h], ``(n,)``; NaN where unknown or refused."""
        known = self.growth.service.by_stamp()
        return np.array([known.get(outlook.stamp_ns, np.nan) for outlook in self.outlooks])


def follow(
    record: UnitRecord,
    estimates: Sequence[Estimate],
    parameters: ActuatorParameters | None,
    settings: PrognosisSettings,
    scenarios: Sequence[Scenario] = (),
) -> Course:
    """Return health and life of a unit test by test, with a progress bar.

    Parameters
    ----------
    parameters
        Those of the unit, as calibrated; None where its drive is unknown.
    scenarios
        Future duties under which to predict its life after the last test.
    """
    followed = Unit(History(*record.description.unit_key), settings)
    with progress_bar() as progress:
        tracked = progress.track(estimates, description="following growth")
        steps = [
            Step(estimate, outlook)
            for estimate, outlook in followed.follow(
                tracked, parameters, settings, record.counts, record.flown
            )
        ]
    valid = (step.outlook for step in reversed(steps) if step.estimate.valid)
    last = next(valid, None)
    forecaster = followed.forecaster(last) if last is not None else None
    lives = tuple(
        (one, followed.under(one, parameters, settings))
        for one in (scenarios if last is not None else ())
    )
    return Course(record, settings, parameters, steps, followed.growth, forecaster, lives)


def true_faults(course: Course) -> NDArray[np.float64]:
    """Return the true faults of each valid test, ``(n, 8)``; NaN where they are not recorded."""
    rows = []
    for step in course.valid:
        truth = truth_at(course.record.truths, step.estimate.start_ns)
        rows.append(np.full(N_FAULTS, np.nan) if truth is None else truth.faults)
    return np.reshape(rows, (-1, N_FAULTS))


def true_remaining_life(course: Course, end_hours: float | None = None) -> NDArray[np.float64]:
    """Return the hours left at each valid test until life truly ended [h], ``(n,)``.

    Life ends when a true fault reaches its limit, or a required performance, computed by the
    monitor's model from the true faults, fails: between two tests, where the share of the way to
    the limit passes 1 on a straight line. NaN where the hour or the end is not known.

    Parameters
    ----------
    end_hours
        Service hour at which a fault reaches its limit, if that is after the last test [h].
    """
    hours = course.hours
    share = _share_of_the_way(course, true_faults(course))
    known = np.isfinite(hours) & np.isfinite(share)
    left = np.full(len(hours), np.nan)
    end = math.nan if end_hours is None else end_hours
    later = None
    # Backwards: what is left at a test is what is left until the next end after it.
    for i in np.flatnonzero(known)[::-1]:
        if share[i] >= 1.0:
            end = hours[i]
        elif later is not None and share[later] >= 1.0:
            part = (1.0 - share[i]) / (share[later] - share[i])
            end = hours[i] + part * (hours[later] - hours[i])
        left[i] = max(end - hours[i], 0.0)
        later = i
    return left


def _share_of_the_way(course: Course, faults: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest share of the way to a limit at each valid test, ``(n,)`` [-]."""
    limits = course.settings.limits
    shares = [
        abs(faults[:, number] - fault.healthy) / limits.of(fault.name)
        for number, fault in enumerate(FAULTS)
        if fault.limit is not None
    ]
    requirements = ""
    if course.parameters is not None:
        requirements = FITTED.of(course.parameters, course.settings.requirements)
    if not isinstance(requirements, str):
        shares += list(1.0 - requirements.exact_reserves(REQUIREMENTS, faults).T)
    return np.max(shares, axis=0)
