# SPDX-License-Identifier: Apache-2.0
"""Complete prognosis of a unit, as in a monitor: fault limits, requirements and health."""

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ema_core.faults import N_FAULTS, FaultVector, fault_vector
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.requirements.requirements import (
    REQUIREMENTS,
    RequirementLimits,
    Requirements,
    Unmonitored,
    requirements_of,
)
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_sim.lives import SimulatedLife
from prognosis.estimates import drawn
from prognosis.lives import ScoredLife
from prognosis.predictors import SETTINGS, Predictions
from prognosis.scores import LifeScore

_NS_PER_HOUR = 3_600_000_000_000
_SIGMA = 0.004


class Reports(NamedTuple):
    """Truth and reports of a life without growth."""

    meets: bool  # whether all requirements are met: constant faults may be too large
    has_life: bool  # whether a remaining life is reported, by fault limits or requirements
    failing: bool  # whether a requirement is reported as failed


def score_whole(scored: ScoredLife) -> dict[str, LifeScore]:
    """Return the scores of the remaining life in health messages, by settings of the tracker."""
    life = scored.life()
    measurements = drawn(scored, life)
    end = min(life.end_hours, _failure_hours(life))
    before = [measurement for measurement in measurements if measurement.hours < end]
    scores = {}
    for name, settings in SETTINGS.items():
        outlooks, spent = followed(before, settings)
        ruls = [
            (outlook.rul.hours_05, outlook.rul.hours_50, outlook.rul.hours_95)
            for outlook in outlooks
        ]
        samples = np.full((len(outlooks), 1), np.nan)
        hours = np.array([outlook.flight_hours for outlook in outlooks])
        low, median, high = np.array(ruls).T
        made = Predictions(hours, low, median, high, samples, np.array(spent))
        scores[name] = LifeScore.of(scored.kind, end, made)
    return scores


def reports(scored: ScoredLife) -> dict[str, Reports]:
    """Return the reports of a constant life, by settings of the tracker."""
    life = scored.life()
    measurements = drawn(scored, life)
    reserves = _requirements().exact_reserves(REQUIREMENTS, life.faults[:1])
    by_case = {}
    for name, settings in SETTINGS.items():
        outlooks, _ = followed(measurements, settings)
        required = [
            outlook.rul_requirements for outlook in outlooks if outlook.rul_requirements.known
        ]
        by_case[name] = Reports(
            bool(np.all(reserves >= 0.0)),
            any(outlook.rul_faults.known for outlook in outlooks)
            or any(requirement.hours_50 > 0.0 for requirement in required),
            any(requirement.hours_50 == 0.0 for requirement in required),
        )
    return by_case


def followed(
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
    """Return the service hour at which the true faults first violate a requirement [h].

    It is infinite if they violate none.
    """
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
    requirements = requirements_of(Calibration.builtin().unit_parameters, RequirementLimits())
    if isinstance(requirements, Unmonitored):
        raise RuntimeError(requirements.reason)
    return requirements


def worn(hours: float, share: float, rng: np.random.Generator) -> Estimate:
    """Return a random estimate of a unit at a share of its life [-].

    Friction grows to 0.4 and backlash to 0.3 over the life.
    """
    shown = fault_vector({"friction": 1.0, "backlash": 1.0}) > 0.0
    truth = fault_vector({"friction": 0.4 * share**2, "backlash": 0.3 * share})
    faults = np.clip(truth + shown * _SIGMA * rng.standard_normal(N_FAULTS), 0.0, 0.99)
    covariance, hidden = _SIGMA**2 * np.eye(N_FAULTS), np.zeros(N_FAULTS, dtype=bool)
    measurement = Measurement(hours, faults, covariance, hidden)
    return estimate_of_measurement(measurement, Calibration.builtin())


def estimate_of_measurement(measurement: Measurement, calibration: Calibration) -> Estimate:
    """Return a valid estimate with the faults of a measurement.

    Its window ends one hour after the service hour, counted from the epoch.
    """
    # A stamp of 0 would mean "no time".
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
        play_offset=-1.0,
        fitness=0.01,
        goodness_of_fit=1.0,
        goodness_limit=3.5,
        excitation=0.01,
        evaluations=100,
        computing_time=0.05,
        valid=True,
        calibration_windows=calibration.windows,
    )
