"""The whole prognosis of a unit as a monitor makes it: fault limits, requirements and health."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import FaultVector
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.requirements.requirements import (
    REQUIREMENTS,
    RequirementLimits,
    Requirements,
    requirements_of,
)
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_sim.lives import SimulatedLife
from prognosis import metrics
from prognosis.estimates import drawn
from prognosis.lives import ScoredLife
from prognosis.predictors import SETTINGS

_NS_PER_HOUR = 3_600_000_000_000


@dataclass(frozen=True)
class Reports:
    """What is reported of a life in which nothing grows: after how many of its tests."""

    tests: int
    by_faults: int  # a remaining life by fault limits
    by_requirements: int
    failing: int  # that a requirement fails already: constant faults may be so large


@dataclass(frozen=True)
class WholeScore:
    """Score of the reported end of life, by a fault limit or by a requirement."""

    by_requirement: bool  # whether it ends by one
    cra: float  # cumulative relative accuracy over the second half of life [-]
    inside: int  # 90 % intervals that hold the truth, and that lie wholly beyond it, of how many
    below: int
    intervals: int


def score_whole(scored: ScoredLife) -> dict[str, WholeScore]:
    """Score the remaining life in the health messages of a life with drawn estimates."""
    life = scored.life()
    measurements = drawn(scored, life)
    failure = _failure_hours(life)
    end = min(life.end_hours, failure)
    scores = {}
    for name, settings in SETTINGS.items():
        outlooks, _ = _followed(measurements, settings)
        before = [outlook for outlook in outlooks if outlook.hours < end]
        hours = np.array([outlook.hours for outlook in before])
        low, median, high = np.array(
            [(item.rul.hours_05, item.rul.hours_50, item.rul.hours_95) for item in before]
        ).T
        left = end - hours
        scores[name] = WholeScore(
            failure < life.end_hours,
            metrics.cumulative_relative_accuracy(hours, median, end),
            int(np.sum((low <= left) & (left <= high))),
            int(np.sum(left < low)),
            int(np.sum(np.isfinite(low))),
        )
    return scores


def whole_figures(scores: Sequence[WholeScore]) -> dict[str, Any]:
    """Return the figures of many lives: mean accuracy, intervals pooled."""
    intervals = sum(score.intervals for score in scores)
    return {
        "lives": len(scores),
        "by_requirement": sum(score.by_requirement for score in scores),
        "cra": float(np.mean([score.cra for score in scores])),
        "coverage": sum(score.inside for score in scores) / intervals,
        "too_long": sum(score.below for score in scores) / intervals,
    }


def reports(scored: ScoredLife) -> tuple[bool, dict[str, Reports]]:
    """Return whether a constant life meets all requirements, and what is reported of it by case."""
    life = scored.life()
    measurements = drawn(scored, life)
    reserves = _requirements().exact_reserves(REQUIREMENTS, life.faults[:1])
    by_case = {}
    for name, settings in SETTINGS.items():
        outlooks, _ = _followed(measurements, settings)
        required = [outlook.rul_requirements for outlook in outlooks]
        by_case[name] = Reports(
            len(outlooks),
            sum(outlook.rul_faults.known for outlook in outlooks),
            sum(life.known and life.hours_50 > 0.0 for life in required),
            sum(life.known and life.hours_50 == 0.0 for life in required),
        )
    return bool(np.all(reserves >= 0.0)), by_case


def seconds(scored: ScoredLife) -> NDArray[np.float64]:
    """Return the processor time from estimate to outlook of each test of a life, ``(n,)`` [s].

    That of the first test contains what is computed once a unit.
    """
    measurements = drawn(scored, scored.life())
    # Compiled code is loaded once a process, by any unit.
    _followed(measurements[:1], TrackerSettings())
    requirements_of.cache_clear()
    _, spent = _followed(measurements, TrackerSettings())
    return np.array(spent)


def _followed(
    measurements: Sequence[Measurement], tracker: TrackerSettings
) -> tuple[list[Outlook], list[float]]:
    """Return the outlook after each test, and its processor time [s]."""
    calibration = Calibration.builtin()
    settings = PrognosisSettings(tracker=tracker)
    prognostics = Unit(History("flap", "drawn"), settings)
    parameters = calibration.unit_parameters
    outlooks, spent = [], []
    for cycle, measurement in enumerate(measurements, 1):
        estimate = estimate_of_measurement(measurement, calibration)
        start = time.process_time()
        count = Count(estimate.end_ns, measurement.hours, cycle)
        outlook = prognostics.update(estimate, parameters, settings, count)
        spent.append(time.process_time() - start)
        if outlook is None:
            raise RuntimeError(f"no outlook for a valid estimate at {measurement.hours:g} h")
        outlooks.append(outlook)
    return outlooks, spent


def _failure_hours(life: SimulatedLife) -> float:
    """Return when the first requirement fails, by the true faults at the tests [h]."""
    reserve = _requirements().exact_reserves(REQUIREMENTS, life.faults).min(axis=1)
    failed = np.flatnonzero(reserve < 0.0)
    if not failed.size:
        return np.inf
    after = int(failed[0])
    if after == 0:
        return 0.0
    share = reserve[after - 1] / (reserve[after - 1] - reserve[after])
    return float(life.hours[after - 1] + share * (life.hours[after] - life.hours[after - 1]))


def _requirements() -> Requirements:
    found = requirements_of(Calibration.builtin().unit_parameters, RequirementLimits())
    if isinstance(found, str):
        raise RuntimeError(found)
    return found


def estimate_of_measurement(measurement: Measurement, calibration: Calibration) -> Estimate:
    """Return a valid estimate that makes a measurement; its stamp is the service hour."""
    # Stamps begin after 0, which would be no time.
    end_ns = round((measurement.hours + 1.0) * _NS_PER_HOUR)
    return Estimate(
        start_ns=end_ns - 500_000_000,
        end_ns=end_ns,
        algorithm="drawn",
        seed=0,
        calibration_id=calibration.calibration_id,
        faults=FaultVector.of(measurement.faults),
        covariance=measurement.covariance,
        unobservable=measurement.unobservable,
        play=-1.0,
        fitness=0.01,
        goodness_of_fit=1.0,
        goodness_limit=3.5,
        excitation=0.01,
        evaluations=100,
        computing_time_s=0.05,
        valid=True,
        reason="",
        calibration_windows=calibration.windows,
    )
