"""Comparing a record with a baseline: which quantity has changed, by how much, and what is unseen.

Each quantity is a direction in the space of the coefficients. Along it the record is compared with
the prediction from the healthy records (``scatter``). If anything departs, the directions compete:
the one that leaves the least of the departure is named, unless others explain it as well.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint.baseline import BETWEEN_RECORDS, Baseline
from ema_monitor.joint.comparison import (
    FRICTION,
    FRICTION_OVER_INERTIA,
    GRAVITY,
    INERTIA,
    LOAD,
    PLAY,
    QUANTITIES,
    TORQUE,
    TRACKING,
    VISCOUS,
    Comparison,
    FigureChange,
    Judgement,
    QuantityChange,
)
from ema_monitor.joint.figures import FIGURES
from ema_monitor.joint.record import JointRecord
from ema_monitor.joint.scatter import Prediction, Scatter
from ema_monitor.joint.shape import COEFFICIENTS

SIGNIFICANCE: Final = 1e-3
"""Probability below which a healthy record differs in one quantity or figure."""

POWER: Final = 0.9
"""Probability with which the smallest detectable change is found."""

INTERVAL: Final = (0.05, 0.95)

_MODEL_TOLERANCE: Final = 0.1
_RATIO_TOLERANCE: Final = 0.02
_VISCOUS_TOLERANCE: Final = 3.0
_FOR_A_PARAMETER: Final = 6.0
_TOLD_APART: Final = 9.0
_NOISE_FREEDOM: Final = 4.0
_PLAY_BETWEEN: Final = 0.05
_LAG_BETWEEN: Final = 0.03
_WIND_UP: Final = 0.5
_NAN: Final = math.nan
_TINY: Final = 1e-12


class Hypothesis(NamedTuple):
    """A change that may explain a record: quantities that change, and columns, ``(5, k)``.

    A column is the change of the coefficients for a change of 1 of its quantity: relative, or in
    the unit of the effort.
    """

    quantities: tuple[str, ...]
    columns: Array


def hypotheses(baseline: Baseline) -> list[Hypothesis]:
    """Return the changes that are considered for a joint."""
    healthy, unit = baseline.healthy, np.eye(len(COEFFICIENTS))
    dry, inertia, viscous, load, gravity = unit * np.where(unit.any(axis=1), 1.0, 0.0)
    has_gravity = baseline.shape.has_gravity
    viscous_scale = baseline.viscous_scale
    found = [
        Hypothesis((FRICTION,), (healthy[0] * dry)[:, None]),
        Hypothesis((INERTIA,), (healthy[1] * inertia)[:, None]),
        Hypothesis((VISCOUS,), (viscous_scale * viscous)[:, None]),
        Hypothesis((LOAD,), load[:, None]),
        # The effort that the same motion takes is inverse to the torque per ampere.
        Hypothesis((TORQUE,), -healthy[:, None]),
        Hypothesis((FRICTION, TORQUE), np.column_stack([healthy[0] * dry, -healthy])),
    ]
    if has_gravity:
        found.append(Hypothesis((GRAVITY,), (healthy[4] * gravity)[:, None]))
        payload = np.column_stack([healthy[4] * gravity, healthy[1] * inertia])
        found.append(Hypothesis((GRAVITY, INERTIA), payload))
    return found


@dataclass(frozen=True)
class Comparer:
    """Compares records with a baseline."""

    baseline: Baseline

    def compare(self, record: JointRecord) -> Comparison:
        """Return what has changed in a record."""
        return _Test(self, record).result()

    @cached_property
    def hypotheses(self) -> list[Hypothesis]:
        """Changes that are considered."""
        return hypotheses(self.baseline)

    @cached_property
    def noise(self) -> Array:
        """Share of the standard error of each coefficient that healthy records confirm, ``(5,)``.

        What the model misses in the same way in every record makes the standard error larger than
        the scatter of the records.
        """
        baseline = self.baseline
        days = np.array(baseline.days)
        values, own = baseline.values, np.diagonal(baseline.covariances, axis1=1, axis2=2)
        centred = np.array(values)
        for day in set(baseline.days):
            centred[days == day] -= values[days == day].mean(axis=0)
        freedom = len(days) - len(set(baseline.days))
        observed = np.sum(centred**2, axis=0)
        expected = np.mean(own, axis=0) + _TINY**2
        share = (_NOISE_FREEDOM * expected + observed) / ((_NOISE_FREEDOM + freedom) * expected)
        return np.sqrt(np.minimum(share, 1.0))

    def covariance(self, covariance: Array) -> Array:
        """Return the covariance of the error of a record, as healthy records confirm it."""
        return covariance * np.outer(self.noise, self.noise)

    @cached_property
    def between(self) -> Array:
        """Variance of each coefficient between records of different days, ``(5,)``."""
        unit = np.eye(len(COEFFICIENTS))
        return np.array([self.scatter(one).variance for one in unit])

    def scatter(self, weights: Array) -> Scatter:
        """Return the scatter of a linear combination of the coefficients, weights ``(5,)``."""
        baseline = self.baseline
        errors = np.array([self.covariance(one) for one in baseline.covariances])
        variances = np.einsum("i,nij,j->n", weights, errors, weights)
        days = math.sqrt(float(weights**2 @ baseline.prior_sigmas**2))
        return Scatter(
            baseline.values @ weights, variances, baseline.days, BETWEEN_RECORDS * days, days
        )


class _Test:
    """One record beside its baseline."""

    def __init__(self, comparer: Comparer, record: JointRecord) -> None:
        self._comparer, self._record = comparer, record
        self._baseline = comparer.baseline
        self._error = comparer.covariance(record.covariance)
        self._departure = record.values - self._baseline.healthy
        count = len(self._baseline.records)
        mean_error = np.mean(self._baseline.covariances, axis=0)
        spread = np.diag(comparer.between) * (1.0 + 1.0 / len(set(self._baseline.days)))
        self._total = spread + self._error + comparer.covariance(mean_error) / count

    def predicted(self, weights: Array) -> Prediction:
        """Return the prediction of a combination of the coefficients of this record."""
        error = float(weights @ self._error @ weights)
        return self._comparer.scatter(weights).predict(error, self._record.day)

    def _weights(self, columns: Array, covariance: Array) -> Array:
        """Return the weights that estimate the parameters of a change best, ``(k, 5)``."""
        inverse = np.linalg.pinv(covariance, hermitian=True, rcond=1e-14)
        return np.linalg.solve(columns.T @ inverse @ columns, columns.T @ inverse)

    def result(self) -> Comparison:
        """Return the comparison."""
        tests = [
            (one, self._alone(one)) for one in self._comparer.hypotheses if len(one.quantities) == 1
        ]
        probability = {one.quantities[0]: p for one, (_, p) in tests}
        figures, figure_probability = self._figures()
        play, play_probability = self._play()
        tracking = self._tracking()
        worst = min([*probability.values(), figure_probability, play_probability])
        tolerant = self._tolerant()
        named: tuple[str, ...] = ()
        rivals: tuple[str, ...] = ()
        if min(probability.values()) < SIGNIFICANCE and play.judgement is not Judgement.CHANGED:
            named, rivals = self._explanation(tolerant)
        quantities = [
            self._quantity(one.quantities[0], alone, named, rivals, tolerant)
            for one, alone in tests
        ]
        by_name = {one.name: one for one in quantities}
        by_name[PLAY], by_name[TRACKING] = play, tracking
        by_name[FRICTION_OVER_INERTIA] = self._friction_over_inertia()
        if GRAVITY not in by_name:
            reason = "the motion of the healthy records shows no gravity"
            by_name[GRAVITY] = QuantityChange(GRAVITY, Judgement.NOT_JUDGED, reason=reason)
        ordered = tuple(by_name[name] for name in QUANTITIES)
        return Comparison(ordered, figures, worst)

    def _alone(self, hypothesis: Hypothesis) -> tuple[Array, float]:
        """Return the weights of a change alone, and how likely a healthy record differs so."""
        weights = self._weights(hypothesis.columns, self._total)[0]
        x = float(weights @ self._record.values)
        return weights, self.predicted(weights).probability(x)

    def _tolerant(self) -> Array:
        """Return the covariance with what the model may miss beside changed friction, ``(5, 5)``."""
        baseline = self._baseline
        change = abs(self._departure[0] / baseline.healthy[0])
        scales = np.abs(baseline.healthy)
        scales[2] = _VISCOUS_TOLERANCE * baseline.friction / baseline.preparation.usual_speed
        scales[3] = baseline.friction
        scales[0] = 0.0
        return self._total + np.diag((_MODEL_TOLERANCE * change * scales) ** 2)

    def _explanation(self, covariance: Array) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the quantities that explain the departure, and those that explain it as well."""
        inverse = np.linalg.pinv(covariance, hermitian=True, rcond=1e-14)
        costs = []
        for one in self._comparer.hypotheses:
            left = self._departure - one.columns @ (
                self._weights(one.columns, covariance) @ self._departure
            )
            costs.append(float(left @ inverse @ left) + _FOR_A_PARAMETER * one.columns.shape[1])
        order = np.argsort(costs)
        best = self._comparer.hypotheses[int(order[0])]
        rivals: list[str] = []
        for at in order[1:]:
            other = self._comparer.hypotheses[int(at)]
            if costs[at] - costs[order[0]] >= _TOLD_APART:
                break
            if set(best.quantities) < set(other.quantities):
                continue
            rivals += [name for name in other.quantities if name not in best.quantities]
        return best.quantities, tuple(dict.fromkeys(rivals))

    def _quantity(
        self,
        name: str,
        alone: tuple[Array, float],
        named: tuple[str, ...],
        rivals: tuple[str, ...],
        tolerant: Array,
    ) -> QuantityChange:
        """Return the change of a quantity, beside those that are named."""
        others = [one for one in named if one != name]
        columns = [
            one.columns[:, 0]
            for key in (name, *others)
            for one in self._comparer.hypotheses
            if one.quantities == (key,)
        ]
        scale, unit = self._scale(name)
        smallest = abs(self.predicted(alone[0]).smallest_change(SIGNIFICANCE, POWER) / scale)
        weights = self._weights(np.column_stack(columns), tolerant)[0] if named else alone[0]
        prediction = self.predicted(weights)
        x = float(weights @ self._record.values)
        low, high = (x - prediction.quantile(share) for share in reversed(INTERVAL))
        change = x - prediction.mean
        extra = _RATIO_TOLERANCE * abs(change) * 1.645
        low, high = (
            change - math.hypot(change - low, extra),
            change + math.hypot(high - change, extra),
        )
        values = sorted((low / scale, high / scale))
        change = change / scale
        if name == TORQUE:  # the columns are linear in the effort, the quantity is its inverse
            change, values = _inverse(change), sorted(_inverse(one) for one in values)
        if name in named:
            judgement, reason, found = Judgement.CHANGED, "", rivals
        elif name in rivals:
            label = " and ".join(QUANTITIES[one].label for one in named)
            judgement, found = Judgement.NOT_JUDGED, named
            reason = f"this motion cannot tell it apart from {label}"
        else:
            judgement, reason, found = Judgement.UNCHANGED, "", ()
        return QuantityChange(name, judgement, change, *values, smallest, unit, reason, found)

    def _scale(self, name: str) -> tuple[float, str]:
        """Return what a parameter of 1 is in the unit of a change, and that unit."""
        return (1.0, "A") if name == LOAD else (1.0, "-")

    def _friction_over_inertia(self) -> QuantityChange:
        """Return the change of friction over inertia, which a self-locking gear leaves alone."""
        baseline = self._baseline
        healthy = baseline.healthy
        weights = np.zeros(len(healthy))
        weights[0], weights[1] = 1.0 / healthy[0], -1.0 / healthy[1]
        prediction = self.predicted(weights)
        ratio = (self._record.values[0] / healthy[0]) / (self._record.values[1] / healthy[1])
        sigma = math.hypot(prediction.sigma, _RATIO_TOLERANCE * (ratio - 1.0))
        low, high = (ratio * math.exp(way * 1.645 * sigma) - 1.0 for way in (-1.0, 1.0))
        smallest = prediction.smallest_change(SIGNIFICANCE, POWER)
        is_changed = prediction.probability(float(weights @ self._record.values)) < SIGNIFICANCE
        judgement = Judgement.CHANGED if is_changed else Judgement.UNCHANGED
        return QuantityChange(FRICTION_OVER_INERTIA, judgement, ratio - 1.0, low, high, smallest)

    def _play(self) -> tuple[QuantityChange, float]:
        """Return the change of the play, and its probability in a healthy record.

        Lost motion grows with friction by the wind-up of the gear: play is changed only beyond the
        healthy lost motion times the friction ratio.
        """
        records = [one for one in self._baseline.records if math.isfinite(one.lost_motion)]
        own = self._record
        reason = ""
        if not records:
            reason = "it needs a speed measured at the motor and a position at the joint"
        elif not math.isfinite(own.lost_motion):
            reason = "too few reversals"
        values = np.array([one.lost_motion for one in records])
        mean = float(np.mean(values)) if records else 0.0
        if not reason and not mean > 0.0:
            reason = "the position follows the motor, as if both were measured on one side"
        if reason:
            return QuantityChange(PLAY, Judgement.NOT_JUDGED, reason=reason), 1.0
        errors = np.array([one.lost_motion_sigma for one in records]) ** 2
        between = _PLAY_BETWEEN * mean
        prediction = Scatter(
            values, errors, [one.day for one in records], BETWEEN_RECORDS * between, between
        ).predict(own.lost_motion_sigma**2, own.day)
        probability = prediction.probability(own.lost_motion)
        ratio = max(1.0, own.values[0] / self._baseline.healthy[0])
        wind_up = mean * (ratio - 1.0)
        beyond = prediction.probability(own.lost_motion - wind_up)
        change = own.lost_motion - prediction.mean
        sigma = math.hypot(prediction.sigma, _WIND_UP * wind_up)
        low, high = change - wind_up - 1.645 * prediction.sigma, change + 1.645 * sigma
        smallest = prediction.smallest_change(SIGNIFICANCE, POWER) / mean
        is_changed = probability < SIGNIFICANCE and (
            (beyond < SIGNIFICANCE and own.lost_motion - wind_up > mean) or change < 0.0
        )
        return (
            QuantityChange(
                PLAY,
                Judgement.CHANGED if is_changed else Judgement.UNCHANGED,
                change / mean,
                low / mean,
                high / mean,
                smallest,
            ),
            probability if is_changed else 1.0,
        )

    def _tracking(self) -> QuantityChange:
        """Return the change of the tracking lag."""
        records = [one for one in self._baseline.records if math.isfinite(one.lag_s)]
        own = self._record
        if not records or not math.isfinite(own.lag_s):
            reason = "there is no position command"
            return QuantityChange(TRACKING, Judgement.NOT_JUDGED, reason=reason)
        values = np.array([one.lag_s for one in records])
        mean = abs(float(np.mean(values)))
        errors = np.array([one.lag_sigma for one in records]) ** 2
        between = _LAG_BETWEEN * mean + _TINY
        prediction = Scatter(
            values, errors, [one.day for one in records], BETWEEN_RECORDS * between, between
        ).predict(own.lag_sigma**2, own.day)
        is_changed = prediction.probability(own.lag_s) < SIGNIFICANCE
        low, high = (own.lag_s - prediction.quantile(share) for share in reversed(INTERVAL))
        return QuantityChange(
            TRACKING,
            Judgement.CHANGED if is_changed else Judgement.UNCHANGED,
            (own.lag_s - prediction.mean) / mean,
            low / mean,
            high / mean,
            prediction.smallest_change(SIGNIFICANCE, POWER) / mean,
        )

    def _figures(self) -> tuple[tuple[FigureChange, ...], float]:
        """Return the figures that depart, and the smallest probability of any."""
        found: list[FigureChange] = []
        least = 1.0
        for name, figure in FIGURES.items():
            value = self._record.figures.get(name)
            records = [one for one in self._baseline.records if name in one.figures]
            if value is None or not records:
                continue
            values = np.array([one.figures[name] for one in records])
            scatter = Scatter(
                values,
                np.zeros(len(values)),
                [one.day for one in records],
                figure.between_records,
                figure.between_days,
            )
            prediction = scatter.predict(0.0, self._record.day)
            probability = prediction.probability(value)
            least = min(least, probability)
            if probability < SIGNIFICANCE:
                ratio = math.exp(value - prediction.mean)
                found.append(FigureChange(name, ratio, probability))
        return tuple(sorted(found, key=lambda one: one.probability)), least


def _inverse(change: float) -> float:
    """Return the relative change of a quantity whose inverse changes by ``-change``."""
    return 1.0 / max(1.0 - change, 0.05) - 1.0


def smallest_changes(baseline: Baseline) -> Iterator[tuple[str, float]]:
    """Yield the smallest change of each quantity that a record like the healthy ones would show."""
    comparer = Comparer(baseline)
    record = baseline.records[0]
    typical = JointRecord(
        0, baseline.healthy, np.mean(baseline.covariances, axis=0), record.usual_speed
    )
    test = _Test(comparer, typical)
    for one in comparer.hypotheses:
        if len(one.quantities) == 1:
            weights, _ = test._alone(one)
            scale, _ = test._scale(one.quantities[0])
            smallest = test.predicted(weights).smallest_change(SIGNIFICANCE, POWER)
            yield one.quantities[0], abs(smallest / scale)


