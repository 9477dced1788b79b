"""From bags to estimates, health and life of a unit after each of its tests, and the truth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
from numpy.typing import NDArray

from ema_bags.windows import truth_at
from ema_cli.bags.predicting import Predicting
from ema_cli.bags.unit_record import UnitRecord, read_unit, with_calibration_beside
from ema_cli.show.progress import progress_bar
from ema_core.faults import FAULTS, N_FAULTS
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.advice import Advice, advise
from ema_monitor.prognosis.duty.scenario import Scenario
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook, unknown_outlook
from ema_monitor.prognosis.requirements.requirements import REQUIREMENTS, requirements_of
from ema_monitor.unit import Unit


class Step(NamedTuple):
    """A test, with health and life after it; None when nothing follows from it."""

    estimate: Estimate
    outlook: Outlook | None


@dataclass(frozen=True)
class Course:
    """Tests of one unit and what followed from them.

    Attributes
    ----------
    given
        How they were identified and followed, with the calibration that was used.
    steps
        Tests in order of time, refused ones included; of ordinary motion, each combination.
    growth
        What is known of growth after the last of them.
    scenarios
        Scenarios of future duty, with the health and life under each after the last test.
    """

    record: UnitRecord
    given: Predicting
    calibration: AnyCalibration
    steps: list[Step]
    growth: GrowthRecord
    scenarios: tuple[tuple[Scenario, Outlook], ...] = ()

    @property
    def estimates(self) -> list[Estimate]:
        """The estimates of all tests."""
        return [step.estimate for step in self.steps]

    @property
    def valid(self) -> list[Step]:
        """The valid tests."""
        return [step for step in self.steps if step.estimate.valid]

    @property
    def outlooks(self) -> list[Outlook]:
        """Health and life after each valid test; tables and pictures need at least one."""
        return [step.outlook for step in self.valid if step.outlook is not None]

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

    @cached_property
    def advice(self) -> Advice | None:
        """What to do after the last test at the least cost; None without costs or a valid test."""
        if self.given.costs is None or not self.outlooks:
            return None
        return advise(self.outlooks[-1], self.given.costs)


def diagnose_unit(
    paths: Sequence[Path], given: Predicting, *, skips_unreadable: bool = False
) -> Course:
    """Identify the tests in bags and follow them; remarks and refusals go to standard error."""
    record = read_unit(paths, given, skips_unreadable=skips_unreadable)
    if given.at_hours is not None:
        record = record.as_known_at(given.at_hours)
    # The bags first: those of two units are refused, whatever lies beside them.
    given = with_calibration_beside(given, paths)
    calibration = given.calibration()
    for remark in record.remarks:
        click.echo(remark, err=True)
    course = follow(record, given.estimate(record.windows, calibration), calibration, given)
    for number, estimate in enumerate(course.estimates):
        if not estimate.valid:
            click.echo(f"window {number}: no valid estimate: {estimate.reason}", err=True)
    return course


def follow(
    record: UnitRecord,
    estimates: Sequence[Estimate],
    calibration: AnyCalibration,
    given: Predicting,
) -> Course:
    """Return health and life of a unit test by test, with a progress bar."""
    settings, parameters = given.prognosis, calibration.unit_parameters
    unit = Unit(History(*record.description.unit_key), settings)
    with progress_bar() as progress:
        tracked = progress.track(estimates, description="following growth")
        followed = unit.follow(tracked, parameters, settings, record.counts, record.flown)
        steps = [Step(*item) for item in followed]
    last = next((step.outlook for step in reversed(steps) if step.estimate.valid), None)
    scenarios = given.scenarios if last is not None else ()
    lives = tuple((one, unit.under(one, parameters, settings)) for one in scenarios)
    return Course(record, given, calibration, steps, unit.growth, lives)


def true_faults(course: Course) -> NDArray[np.float64]:
    """Return the true faults of each valid test, ``(n, 8)``; NaN where they are not recorded."""
    rows = []
    for step in course.valid:
        truth = truth_at(course.record.truths, step.estimate.start_ns)
        rows.append(np.full(N_FAULTS, np.nan) if truth is None else truth.faults)
    return np.reshape(rows, (-1, N_FAULTS))


def true_remaining_life(course: Course) -> NDArray[np.float64]:
    """Return the hours left at each valid test until life truly ended [h], ``(n,)``.

    Life ends when a true fault reaches its limit, or a required performance, computed by the
    monitor's model from the true faults, fails: between two tests, where the share of the way to
    the limit passes 1 on a straight line. NaN where the hour or the end is not known.
    """
    hours = course.hours
    share = _share_of_the_way(course, true_faults(course))
    left = np.full(len(hours), np.nan)
    end, later = math.nan, None
    # Backwards: what is left at a test is what is left until the next end after it.
    for i in np.flatnonzero(np.isfinite(hours) & np.isfinite(share))[::-1]:
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
    settings, parameters = course.given.prognosis, course.calibration.unit_parameters
    shares = [
        abs(faults[:, number] - fault.healthy) / settings.limits.of(fault.name)
        for number, fault in enumerate(FAULTS)
        if fault.limit is not None
    ]
    requirements = ""
    if parameters is not None:
        requirements = requirements_of(parameters, settings.requirements)
    if not isinstance(requirements, str):
        shares += list(1.0 - requirements.exact_reserves(REQUIREMENTS, faults).T)
    return np.max(shares, axis=0)
