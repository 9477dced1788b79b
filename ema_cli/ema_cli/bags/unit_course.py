# SPDX-License-Identifier: Apache-2.0
"""Course of a unit: its tests from bags, with health, life and true faults."""

import filecmp
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final, NamedTuple, Self

import click
import numpy as np
from numpy.typing import NDArray

from ema_bags.metadata import METADATA_FILE
from ema_bags.suffixes import BAGS
from ema_bags.telemetry import described_actuators
from ema_cli.bags.predicting import Predicting
from ema_cli.bags.reading import ReadingOptions, open_recording, read_windows, why_no_window
from ema_cli.progress import progress_bar
from ema_core.description import ActuatorDescription
from ema_core.faults import FAULTS, N_FAULTS
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.advice import Advice, advise
from ema_monitor.prognosis.duty.damage import FlownDuty
from ema_monitor.prognosis.duty.scenario import Scenario
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count, StampedTest, unordered
from ema_monitor.prognosis.outlook import Outlook, unknown_outlook
from ema_monitor.prognosis.requirements.requirements import (
    REQUIREMENTS,
    Unmonitored,
    requirements_of,
)
from ema_monitor.reason_texts import text_of
from ema_monitor.recordings.counts import read_counts
from ema_monitor.recordings.windows import BagWindows, RecordedWindow, truth_at
from ema_monitor.unit import Unit
from ema_ros.messages import StampedFaults

_NAMED: Final = 3
_ONE_UNIT: Final = "expected bags of a single unit"


@dataclass(frozen=True)
class UnitRecord:
    """Tests of a unit as recorded in its bags."""

    description: ActuatorDescription
    """The last description of the unit."""
    windows: list[RecordedWindow]
    """Windows of all bags, including unusable windows, in chronological order."""
    counts: list[Count]
    """Counts of service hours and cycles, in chronological order."""
    truths: list[StampedFaults]
    """True faults of the test cycles, in chronological order, if the bags record them."""
    remarks: list[str]
    """Defects of bags, and omitted bags."""
    bags: dict[int, Path] = field(default_factory=dict)
    """Bag of each window, keyed by the window's last timestamp [ns]."""
    flown: list[tuple[int, FlownDuty]] = field(default_factory=list)
    """Duty up to the end of each window, with its timestamp [ns], in chronological order."""

    def until(self, hours: float) -> Self:
        """Return the record up to a service hour [h]; raise ValueError if it has no test."""
        later = min(
            (count.stamp_ns for count in self.counts if count.hours > hours), default=math.inf
        )
        windows = [window for window in self.windows if window.end_ns < later]
        if not self.counts or not windows:
            raise ValueError(f"--at {hours:g}: the bags have no test before this service hour")
        counts = [count for count in self.counts if count.stamp_ns < later]
        return replace(self, windows=windows, counts=counts)


def find_bags(paths: Iterable[Path]) -> list[Path]:
    """Return the bags in files and folders without duplicates.

    Raises
    ------
    ValueError
        If a folder contains no bag.
    """
    bags_by_path: dict[Path, Path] = {}
    for path in paths:
        bags = _bags_in(path)
        if not bags:
            inside = [
                str(item) for item in sorted(path.iterdir()) if item.is_dir() and _bags_in(item)
            ]
            named = ", ".join(inside[:_NAMED])
            if more := len(inside[_NAMED:]):
                named += f" and {more} more"
            hint = f"; bags may be in {named}: select one of these" if inside else ""
            raise ValueError(
                f"{path}: folder without bags (neither *.mcap nor a folder with "
                f"{METADATA_FILE}){hint}"
            )
        for bag in bags:
            bags_by_path.setdefault(bag.resolve(), bag)
    return list(bags_by_path.values())


def read_unit(
    paths: Iterable[Path], source: ReadingOptions, *, skips_unreadable: bool = False
) -> UnitRecord:
    """Read the tests of a unit from bags.

    Parameters
    ----------
    paths
        Bags, or folders of bags.
    source
        Options that select the part of each bag to read.
    skips_unreadable
        Whether an unreadable bag becomes a remark instead of an error.

    Raises
    ------
    ValueError, OSError
        If there is no test, the bags belong to several units, or the order of tests is unknown.
    """
    read: list[tuple[Path, BagWindows]] = []
    counts: list[Count] = []
    remarks: list[str] = []
    for path in find_bags(paths):
        if original := next((item for item, _ in read if _is_copy(path, item)), None):
            remarks.append(f"{path}: skipped, a copy of {original}")
            continue
        try:
            bag, options = open_recording(path, source)
            present = described_actuators(bag)
        except (ValueError, OSError) as error:
            if not skips_unreadable or not path.exists():
                raise
            words = " ".join(str(error).split())
            remarks.append(words if str(path) in words else f"{path}: {words}")
            continue
        if source.actuator_id is not None and present and source.actuator_id not in present:
            names = ", ".join(sorted(present))
            remarks.append(f"{path}: skipped, it belongs to actuator {names}")
            continue
        bag_windows = read_windows(path, options, bag=bag, with_duty=True)
        read.append((path, bag_windows))
        damage = bag.damage
        for description in (
            *(item.description for item in bag_windows.windows),
            bag_windows.description,
        ):
            _require_same_unit((read[0][0], read[0][1].description), (path, description))
        remarks += [f"{path}: {remark}" for remark in bag_windows.remarks]
        if not bag_windows.windows:
            remarks.append(why_no_window(path, bag_windows, source))
        counted, wrong = read_counts(bag, bag_windows.description)
        counts += counted
        remarks += [f"{path}: {remark}" for remark in wrong]
        if bag.damage != damage:  # detected while the service life was counted
            remarks.append(f"{path}: {bag.damage}")
    if not read:
        what = "no readable bag"
        if source.actuator_id is not None:
            what = f"no bag of actuator {source.actuator_id!r}"
        raise ValueError(f"{what}: {'; '.join(remarks)}")
    tests = [(path, item) for path, bag_windows in read for item in bag_windows.windows]
    if not tests:
        raise ValueError(f"no windows to diagnose: {'; '.join(remarks)}")
    # The history also needs repeated windows, such as a second window at the same time in a bag.
    stamped = (StampedTest(test.start_ns, test.end_ns, str(path), path) for path, test in tests)
    if reasons := unordered(stamped):
        raise ValueError(text_of(next(iter(reasons.values()))))
    tests.sort(key=lambda test: test[1].end_ns)
    return UnitRecord(
        tests[-1][1].description,
        [item for _, item in tests],
        sorted(counts, key=lambda count: count.stamp_ns),
        sorted(
            (truth for _, bag_windows in read for truth in bag_windows.truths),
            key=lambda item: item.stamp_ns,
        ),
        remarks,
        {item.end_ns: path for path, item in tests},
        sorted(
            (
                piece
                for _, bag_windows in read
                for piece in bag_windows.flown.get(bag_windows.description.unit_key, ())
            ),
            key=lambda piece: piece[0],
        ),
    )


def _is_copy(path: Path, second: Path) -> bool:
    files = path.is_file() and second.is_file()
    return files and filecmp.cmp(path, second, shallow=False)


def _bags_in(path: Path) -> list[Path]:
    if not path.is_dir() or (path / METADATA_FILE).exists():
        return [path]
    folders = (item.parent for item in path.glob(f"*/{METADATA_FILE}"))
    return sorted([*(file for suffix in BAGS for file in path.glob(f"*{suffix}")), *folders])


def _require_same_unit(
    unit: tuple[Path, ActuatorDescription], second_unit: tuple[Path, ActuatorDescription]
) -> None:
    (path, first), (second_path, second) = unit, second_unit
    for what, value, second_value, remedy in (
        ("actuator", first.actuator_id, second.actuator_id, "select one with --actuator-id"),
        ("serial number", first.serial_number, second.serial_number, _ONE_UNIT),
    ):
        if value != second_value:
            raise ValueError(
                f"{path} belongs to {what} {value!r}, but {second_path} to {second_value!r}: "
                f"{remedy}"
            )


class Step(NamedTuple):
    """A test with the resulting health and life; None if the test changes neither."""

    estimate: Estimate
    outlook: Outlook | None


@dataclass(frozen=True)
class Course:
    """Tests of a unit, with health and life after each test."""

    record: UnitRecord
    options: Predicting
    """Options of the identification and the prognosis."""
    calibration: AnyCalibration
    steps: list[Step]
    """Tests in chronological order, including refused tests; combined stretches are one test."""
    growth: GrowthRecord
    """Record of the growth after the last test."""
    scenarios: tuple[tuple[Scenario, Outlook], ...] = ()
    """Scenarios of future duty, each with health and life after the last test."""

    @property
    def estimates(self) -> list[Estimate]:
        """Estimates of all tests."""
        return [step.estimate for step in self.steps]

    @property
    def valid(self) -> list[Step]:
        """Valid tests."""
        return [step for step in self.steps if step.estimate.valid]

    @property
    def outlooks(self) -> list[Outlook]:
        """Health and life after each valid test."""
        return [step.outlook for step in self.valid if step.outlook is not None]

    @property
    def now(self) -> Outlook:
        """Health and life after the newest test, whether valid or refused."""
        outlooks = (step.outlook for step in reversed(self.steps) if step.outlook is not None)
        return next(outlooks, unknown_outlook("no tests yet"))

    @property
    def hours(self) -> NDArray[np.float64]:
        """Service hours at each valid test [h], ``(n,)``; NaN if unknown."""
        hours = self.growth.service.by_stamp()
        return np.array([hours.get(outlook.stamp_ns, np.nan) for outlook in self.outlooks])

    @cached_property
    def advice(self) -> Advice | None:
        """Cheapest action after the last test; None without costs or a valid test."""
        if self.options.costs is None or not self.outlooks:
            return None
        return advise(self.outlooks[-1], self.options.costs)


def diagnose_unit(
    paths: Sequence[Path], options: Predicting, *, skips_unreadable: bool = False
) -> Course:
    """Identify the tests of a unit in bags and track health and life; print remarks on stderr.

    ``paths`` and ``skips_unreadable`` are as in `read_unit`.
    """
    record = read_unit(paths, options, skips_unreadable=skips_unreadable)
    if options.at_hours is not None:
        record = record.until(options.at_hours)
    # After reading, so that bags of two units are refused before a calibration is searched for.
    options = options.with_calibration_beside(find_bags(paths))
    calibration = options.calibration()
    for remark in record.remarks:
        click.echo(remark, err=True)
    course = follow(record, options.estimate(record.windows, calibration), calibration, options)
    for number, estimate in enumerate(course.estimates):
        if not estimate.valid:
            click.echo(f"window {number}: no valid estimate: {estimate.reason}", err=True)
    return course


def follow(
    record: UnitRecord,
    estimates: Sequence[Estimate],
    calibration: AnyCalibration,
    options: Predicting,
) -> Course:
    """Track health and life of a unit from test to test, with a progress bar."""
    settings, parameters = options.prognosis, calibration.unit_parameters
    unit = Unit(History(*record.description.unit_key), settings)
    with progress_bar() as progress:
        tracked = progress.track(estimates, description="tracking growth")
        followed = unit.follow(tracked, parameters, settings, record.counts, record.flown)
        steps = [Step(*item) for item in followed]
    last = next((step.outlook for step in reversed(steps) if step.estimate.valid), None)
    scenarios = options.scenarios if last is not None else ()
    lives = tuple((scenario, unit.under(scenario, parameters, settings)) for scenario in scenarios)
    return Course(record, options, calibration, steps, unit.growth, lives)


def true_faults(course: Course) -> NDArray[np.float64]:
    """Return the true faults at each valid test, ``(n, 8)``; NaN if they are not recorded."""
    truths = (truth_at(course.record.truths, step.estimate.start_ns) for step in course.valid)
    unknown = np.full(N_FAULTS, np.nan)
    rows = [unknown if truth is None else truth.faults for truth in truths]
    return np.reshape(rows, (-1, N_FAULTS))


def true_remaining_life(course: Course) -> NDArray[np.float64]:
    """Return the true remaining life at each valid test [h], ``(n,)``.

    Life ends when a true fault reaches its limit, or when a required performance, computed by the
    monitor's model from the true faults, is not met. Between tests, the relative distance to the
    limit is interpolated linearly. The life is NaN where the hour or the end is unknown.
    """
    hours = course.hours
    share = _share_of_the_way(course, true_faults(course))
    left = np.full(len(hours), np.nan)
    end, later = math.nan, None
    # Backwards, because the remaining life at a test ends at the next end after it.
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
    """Return the largest relative distance from healthy at each valid test, ``(n,)`` [-].

    It is 1 if a fault has reached its limit, or a required performance has no reserve.
    """
    settings, parameters = course.options.prognosis, course.calibration.unit_parameters
    shares = [
        abs(faults[:, number] - fault.healthy) / settings.limits.of(fault.name)
        for number, fault in enumerate(FAULTS)
        if fault.limit is not None
    ]
    if parameters is not None:
        requirements = requirements_of(parameters, settings.requirements)
        if not isinstance(requirements, Unmonitored):
            shares += list(1.0 - requirements.exact_reserves(REQUIREMENTS, faults).T)
    return np.max(shares, axis=0)
