"""From bags to estimates, health and life of a unit: what ``prognose`` and ``report`` tell."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import click

from ema_cli.bags.estimates import estimate_windows
from ema_cli.bags.source_options import SourceOptions
from ema_cli.bags.unit_course import Course, follow
from ema_cli.bags.unit_record import UnitRecord, read_unit, with_calibration_beside
from ema_cli.identification_options import IdentificationOptions
from ema_cli.prognosis_options import PrognosisOptions
from ema_cli.show.advice import advice_in_words
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.advice import Advice, advise
from ema_monitor.prognosis.advisory import Costs


@dataclass(frozen=True)
class UnitDiagnosis:
    """What the bags of a unit show.

    Attributes
    ----------
    options
        How they were identified, with the calibration that was used.
    estimates
        One of each window, refused ones included, in order of time; of ordinary motion, one of
        each combination.
    course
        What followed from them, test by test.
    costs
        What an advice rests on; None when none are given.
    """

    record: UnitRecord
    options: IdentificationOptions
    calibration: AnyCalibration
    estimates: list[Estimate]
    course: Course
    costs: Costs | None

    @property
    def calibration_in_words(self) -> str:
        """Which calibration was used, and where it comes from."""
        source = self.options.calibration_source
        return f"calibration {self.calibration.calibration_id} ({source})"

    @cached_property
    def advice(self) -> Advice | None:
        """What to do after the last test at the least cost; None without costs or a valid test."""
        if self.costs is None or self.course.forecaster is None:
            return None
        return advise(self.course.forecaster, self.costs)

    @property
    def advice_in_words(self) -> str:
        """The advice as a sentence; empty when there is none."""
        advice = self.advice
        return "" if advice is None or self.costs is None else advice_in_words(advice, self.costs)


def diagnose_unit(
    paths: Sequence[Path],
    source: SourceOptions,
    options: IdentificationOptions,
    prognosis: PrognosisOptions,
    *,
    skips_unreadable: bool = False,
) -> UnitDiagnosis:
    """Identify the tests in bags and follow them; remarks and refusals go to standard error.

    Parameters
    ----------
    skips_unreadable
        Whether a bag that cannot be read is a remark, as long as there is another one.

    Raises
    ------
    ValueError
        When the bags, the calibration or the options cannot be used.
    OSError
        When a file cannot be opened.
    """
    record = read_unit(paths, source, skips_unreadable=skips_unreadable)
    if prognosis.at_hours is not None:
        record = record.as_known_at(prognosis.at_hours)
    # The bags first: those of two units are refused, whatever lies beside them.
    options = with_calibration_beside(options, paths)
    calibration = options.calibration()
    for remark in record.remarks:
        click.echo(remark, err=True)
    estimates = estimate_windows(
        record.windows,
        calibration,
        options,
        force=source.accept_defects,
        any_motion=source.any_motion,
    )
    course = follow(
        record,
        estimates,
        calibration.unit_parameters,
        prognosis.settings,
        prognosis.scenarios,
    )
    for number, estimate in enumerate(estimates):
        if not estimate.valid:
            click.echo(f"window {number}: no valid estimate: {estimate.reason}", err=True)
    return UnitDiagnosis(record, options, calibration, estimates, course, prognosis.costs)
