# SPDX-License-Identifier: Apache-2.0
"""Comparison of play, tracking lag and model-free figures with the healthy records."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from ema_monitor.joint.baseline import SHARE_OF_SHOWN, Baseline
from ema_monitor.joint.comparison import FigureChange, Judgement, QuantityChange
from ema_monitor.joint.figures import FIGURES, OF_EFFORT
from ema_monitor.joint.record import JointRecord
from ema_monitor.joint.scatter import Scatter
from ema_monitor.joint.shape import DRY
from ema_monitor.joint.single import Observation, SingleTest, are_finite, scatter_of
from ema_monitor.quantities import PLAY, TRACKING
from ema_monitor.reasons import QuantityUnjudged, Unjudged

_PLAY_BETWEEN: Final = 0.05
_LAG_BETWEEN: Final = 0.03
_LAG_FLOOR: Final = 0.01
_WIND_UP: Final = 2.0
_VISIBLE: Final = 3.0
_LIKE_MOTION: Final = 0.14
_ERROR_OF_MOTION: Final = 2.0


class _Healthy(NamedTuple):
    """Mean and scatter of a figure in the healthy records."""

    mean: float
    scatter: Scatter


class Symptom(NamedTuple):
    """Change of a quantity, and the probability of such a change in a healthy record.

    The probability is 1 if the quantity is unchanged or not judged.
    """

    change: QuantityChange
    probability: float = 1.0


def _unjudged(name: str, cause: Unjudged) -> Symptom:
    reasons = (QuantityUnjudged(cause),)
    return Symptom(QuantityChange(name, Judgement.NOT_JUDGED, reasons=reasons))


class Symptoms(NamedTuple):
    """Model-free figures that differ, the most significant first.

    ``probability`` is the smallest probability of all compared figures; 1 without any.
    """

    figures: tuple[FigureChange, ...]
    probability: float


@dataclass(frozen=True)
class SymptomComparer:
    """Compares play, tracking lag and model-free figures with the healthy records."""

    baseline: Baseline

    def play(self, record: JointRecord) -> Symptom:
        """Return the change of the play.

        Friction increases the lost motion by winding up the gear. The play has changed only if the
        lost motion grows significantly beyond twice the wind-up that the friction ratio explains.
        The play is not judged if the lost motion is unknown or too small, or falls significantly
        because a load on one side closes the play.
        """
        healthy = self._play
        if isinstance(healthy, Unjudged):
            return _unjudged(PLAY, healthy)
        if not are_finite(record.lost_motion, record.lost_motion_sigma):
            return _unjudged(PLAY, Unjudged.FEW_REVERSALS)
        observed = Observation(record.lost_motion, record.lost_motion_sigma, record.day_to_predict)
        test = SingleTest.of(observed, healthy.scatter)
        if test.change < 0.0 and test.is_significant:
            return _unjudged(PLAY, Unjudged.PLAY_CLOSED)
        friction = record.values[DRY] / self.baseline.healthy[DRY]
        wind_up = healthy.mean * max(friction - 1.0, 0.0)
        rest = test.less(_WIND_UP * wind_up)
        is_changed = rest.change > 0.0 and rest.is_significant
        low, high = test.interval
        change = QuantityChange(
            PLAY,
            Judgement.CHANGED if is_changed else Judgement.UNCHANGED,
            test.change / healthy.mean,
            (low - wind_up) / healthy.mean,
            high / healthy.mean,
            test.smallest_change / healthy.mean,
        )
        return Symptom(change, test.probability if is_changed else 1.0)

    def tracking(self, record: JointRecord) -> Symptom:
        """Return the change of the tracking lag.

        The lag is not judged without a moving command in the record and in the healthy records. A
        change that is negligible at the bandwidth of the motion is not a change.
        """
        healthy = self._tracking
        if healthy is None or not are_finite(record.lag_s, record.lag_sigma):
            return _unjudged(TRACKING, self._no_tracking(record))
        test = SingleTest.of(
            Observation(record.lag_s, record.lag_sigma, record.day_to_predict), healthy.scatter
        )
        is_changed = test.is_significant and abs(test.change) > self._lag_floor
        low, high = test.interval
        change = QuantityChange(
            TRACKING,
            Judgement.CHANGED if is_changed else Judgement.UNCHANGED,
            test.change / healthy.mean,
            low / healthy.mean,
            high / healthy.mean,
            max(test.smallest_change, self._lag_floor) / healthy.mean,
        )
        return Symptom(change, test.probability if is_changed else 1.0)

    def _no_tracking(self, record: JointRecord) -> Unjudged:
        """Return the cause why the tracking lag of a record is not judged."""
        if math.isinf(record.lag_sigma):
            return Unjudged.COMMAND_STILL
        if not are_finite(record.lag_s):
            return Unjudged.NO_COMMAND
        if any(math.isinf(healthy.lag_sigma) for healthy in self.baseline.records):
            return Unjudged.HEALTHY_COMMAND_STILL
        return Unjudged.NO_HEALTHY_COMMAND

    def figures(self, record: JointRecord, grown: float) -> Symptoms:
        """Return the model-free figures that differ from the healthy records.

        The figures depend on the motion: a record with a different motion is not compared, and the
        figures of varied motions scatter more.

        Parameters
        ----------
        record
            The record.
        grown
            Logarithm of the growth of the effort that the detected changes explain. The scatter of
            the effort grows in proportion.
        """
        distance = self.baseline.distance(record)
        if distance > _LIKE_MOTION:
            return Symptoms((), 1.0)
        changes: list[FigureChange] = []
        least = 1.0
        for name, scatter in self._figures.items():
            if name not in record.figures:
                continue
            error = math.hypot(_error(name, record), _motion_sensitivity(name) * distance)
            observed = Observation(record.figures[name], error, record.day_to_predict)
            test = SingleTest.of(observed, scatter)
            if name in OF_EFFORT:
                test = test.less(min(grown, max(test.change, 0.0)))
            least = min(least, test.probability)
            if test.is_significant:
                changes.append(FigureChange(name, math.exp(test.change), test.probability))
        return Symptoms(tuple(sorted(changes, key=lambda change: change.probability)), least)

    @cached_property
    def _play(self) -> _Healthy | Unjudged:
        """Lost motion in the healthy records [rad], or the cause why play is not judged."""
        observed = [
            Observation(record.lost_motion, record.lost_motion_sigma, record.day)
            for record in self.baseline.records
            if are_finite(record.lost_motion, record.lost_motion_sigma)
        ]
        if not observed:
            return Unjudged.NO_MOTOR_SIDE
        values = np.array([observation.value for observation in observed])
        mean = float(np.mean(values))
        error = np.mean([observation.sigma for observation in observed])
        if mean < _VISIBLE * (np.std(values) + error):
            return Unjudged.PLAY_INVISIBLE
        return _Healthy(mean, scatter_of(observed, _PLAY_BETWEEN * mean))

    @cached_property
    def _tracking(self) -> _Healthy | None:
        """Tracking lag of the healthy records [s]; None if no record has a moving command."""
        observed = [
            Observation(record.lag_s, record.lag_sigma, record.day)
            for record in self.baseline.records
            if are_finite(record.lag_s, record.lag_sigma)
        ]
        if not observed:
            return None
        mean = abs(float(np.mean([observation.value for observation in observed])))
        between = _LAG_BETWEEN * math.hypot(mean, self._lag_floor)
        return _Healthy(max(mean, self._lag_floor), scatter_of(observed, between))

    @property
    def _lag_floor(self) -> float:
        """Largest change of the lag that is negligible at the bandwidth of the motion [s]."""
        return _LAG_FLOOR / self.baseline.preparation.cutoff_hz

    @cached_property
    def _figures(self) -> dict[str, Scatter]:
        """Scatter of each figure over the healthy records, by name."""
        scatters = {}
        for name, figure in FIGURES.items():
            between = figure.repeated if self.baseline.repeats else figure.varied
            healthy = [
                Observation(record.figures[name], _error(name, record), record.day)
                for record in self.baseline.records
                if name in record.figures
            ]
            if healthy and between is not None:
                # The grid of scatters ends at a few times the prior median.
                shown = float(np.std([observation.value for observation in healthy]))
                scatters[name] = scatter_of(healthy, max(between, SHARE_OF_SHOWN * shown))
        return scatters


def _motion_sensitivity(name: str) -> float:
    """Return the sensitivity of a figure to ``Baseline.distance`` [-]."""
    return 1.0 if name in OF_EFFORT else _ERROR_OF_MOTION


def _error(name: str, record: JointRecord) -> float:
    """Return the standard deviation of a figure's error [-]; 0 except for the effort scatter.

    About half of the effort rows are independent.
    """
    return 1.0 / math.sqrt(max(record.rows, 1)) if name == "effort_scatter" else 0.0
