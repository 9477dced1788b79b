# SPDX-License-Identifier: Apache-2.0
"""Comparison of a record with a baseline: changed quantities, sizes of changes, detection limits.

Each quantity is a direction in the space of the coefficients. Along each direction, the record is
compared with the prediction from the healthy records (``scatter``). If the record departs, the
direction with the smallest residual is the explanation; directions that explain the record equally
well are reported as rivals.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint import shape as at
from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.comparison import Comparison, Improvement, Judgement, QuantityChange
from ema_monitor.joint.figures import FIGURES
from ema_monitor.joint.hypotheses import Hypothesis, hypotheses
from ema_monitor.joint.record import NO_DAY, NS_A_DAY, JointRecord
from ema_monitor.joint.scatter import Prediction, Scatter
from ema_monitor.joint.shape import COEFFICIENTS
from ema_monitor.joint.single import BETWEEN_RECORDS, Z90, SingleTest
from ema_monitor.joint.states import state_probabilities
from ema_monitor.joint.symptoms import SymptomComparer
from ema_monitor.quantities import (
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
)
from ema_monitor.reasons import QuantityInseparable, QuantityUnjudged, Reason, Unjudged

_MODEL_TOLERANCE: Final = 0.1
_RATIO_TOLERANCE: Final = 0.02
_RELATIVE_TO_FRICTION: Final = (FRICTION, VISCOUS)
_VISCOUS_TOLERANCE: Final = 3.0
_PARAMETER_COST: Final = 6.0
_EFFECT_OF_PLAY: Final = 0.1
_DISTINCT_COST: Final = 9.0
_NOISE_FREEDOM: Final = 4.0
_CORRELATION_FREEDOM: Final = 12.0
_PAYLOAD_WEIGHT: Final = 2.0
_PAYLOAD: Final = [at.INERTIA, at.GRAVITY]
_SINGULAR: Final = 1e-12
_LEAST_RATIO: Final = 0.2
_FEWEST_FOR_TEMPERATURE: Final = 6
_TEMPERATURE_RANGE: Final = 3.0
_TEMPERATURE_UNIT: Final = 10.0
_TEMPERATURE_HELPS: Final = 0.95
_MORE_DAYS: Final = 2
_MORE_RECORDS: Final = 6
_WORTH_IT: Final = 0.9
_TINY: Final = 1e-12
_UNSEEN: Final = {
    GRAVITY: Unjudged.NO_GRAVITY,
    INERTIA: Unjudged.LITTLE_ACCELERATION,
    FRICTION_OVER_INERTIA: Unjudged.LITTLE_ACCELERATION,
    VISCOUS: Unjudged.ONE_SPEED,
    TORQUE: Unjudged.ONLY_FRICTION,
}
"""Cause why the healthy records cannot determine a quantity."""


@dataclass(frozen=True)
class Comparer:
    """Compares records with a baseline."""

    baseline: Baseline
    """Healthy records of the unit."""
    effort_unit: str = "A"
    """Unit in which a load is reported."""
    effort_scale: float = 1.0
    """Value of 1 A in ``effort_unit``."""
    assumed_correlations: Array | None = field(default=None, repr=False, compare=False)
    """Correlations of the coefficients between records, ``(5, 5)``. If None, they are estimated
    from the healthy records, which is not possible with hypothetical records."""

    def compare(self, record: JointRecord, *, with_improvements: bool = True) -> Comparison:
        """Return the comparison of a record with the baseline.

        Unless ``with_improvements`` is False, it proposes improvements of the baseline.
        """
        comparison = _Test(self, record).result()
        if with_improvements:
            comparison = replace(comparison, improvements=self.improvements)
        return comparison

    def unexplained(self, record: JointRecord) -> float:
        """Return the squared distance that the best explanation of a record leaves unexplained.

        "No change" is an explanation as well. Each parameter of an explanation adds a penalty.
        """
        test = _Test(self, record)
        return min(test.distance, *test.costs)

    @cached_property
    def hypotheses(self) -> list[Hypothesis]:
        """Changes that may explain a record."""
        return hypotheses(self.baseline)

    @cached_property
    def symptoms(self) -> SymptomComparer:
        """Comparer of play, tracking lag and model-free figures."""
        return SymptomComparer(self.baseline)

    @cached_property
    def noise(self) -> Array:
        """Correction factor of each coefficient's standard error, ``(5,)``, at most 1.

        A model error that all records share increases the standard error, but not the scatter of
        the healthy records. The factor reduces the standard error towards this scatter.
        """
        baseline = self.baseline
        days = np.array(baseline.days)
        values = baseline.values
        variances = np.diagonal(baseline.covariances, axis1=1, axis2=2)
        centred = np.array(values)
        for day in set(baseline.days):
            centred[days == day] -= values[days == day].mean(axis=0)
        freedom = len(days) - len(set(baseline.days))
        observed = np.sum(centred**2, axis=0)
        expected = np.mean(variances, axis=0) + _TINY**2
        share = (_NOISE_FREEDOM * expected + observed) / ((_NOISE_FREEDOM + freedom) * expected)
        return np.sqrt(np.minimum(share, 1.0))

    def error(self, covariance: Array) -> Array:
        """Return the error covariance of a record after the correction by ``noise``, ``(5, 5)``."""
        return covariance * np.outer(self.noise, self.noise)

    @cached_property
    def errors(self) -> Array:
        """Covariances of the errors of the healthy records, ``(n, 5, 5)``."""
        return np.array([self.error(covariance) for covariance in self.baseline.covariances])

    @cached_property
    def spread(self) -> Array:
        """Covariance of the difference between a record and the healthy mean, ``(5, 5)``.

        The error of the record itself is excluded.
        """
        days, count = len(set(self.baseline.days)), len(self.baseline.records)
        assumed = self.assumed_correlations
        correlations = self.correlations if assumed is None else assumed
        between = correlations * np.outer(self._sigmas, self._sigmas)
        return between * (1.0 + 1.0 / days) + np.mean(self.errors, axis=0) / count

    @cached_property
    def _sigmas(self) -> Array:
        """Standard deviations between records, ``(5,)``."""
        return np.sqrt([self.scatter(unit).variance for unit in np.eye(len(COEFFICIENTS))])

    @cached_property
    def correlations(self) -> Array:
        """Correlations of the coefficients between records, ``(5, 5)``.

        A varying payload changes gravity and inertia together, so that they are not independent
        evidence. A few records determine correlations poorly, and weights that rely on them would
        overfit: the correlations are shrunk towards 0. The correlation between gravity and inertia
        is likely, and shrunk half as much. Effects of the temperature are removed first.
        """
        errors = np.mean(np.diagonal(self.errors, axis1=1, axis2=2), axis=0)
        spread = np.sqrt(self._sigmas**2 + errors)
        centred = self.baseline.values - self.baseline.values.mean(axis=0)
        if self._temperatures is not None:
            centred = centred - np.outer(self._temperatures, self._slopes)
        units = centred / np.where(spread > 0.0, spread, 1.0)
        moments = units.T @ units
        moments[np.ix_(_PAYLOAD, _PAYLOAD)] *= _PAYLOAD_WEIGHT
        moments += _CORRELATION_FREEDOM * np.eye(len(COEFFICIENTS))
        scales = np.sqrt(np.diag(moments))
        return np.asarray(moments / np.outer(scales, scales), dtype=np.float64)

    def scatter(self, weights: Array) -> Scatter:
        """Return the scatter of the coefficients combined with ``weights``, ``(5,)``.

        If the combination depends on a measured temperature, the scatter is conditional on the
        temperature. Otherwise it includes the effect of varying temperatures.
        """
        baseline = self.baseline
        values = baseline.values @ weights
        days = math.sqrt(float(weights**2 @ baseline.prior_sigmas**2))
        covariates, measured = None, self._temperatures
        if measured is not None and _helps(values, measured):
            covariates = measured[:, None]
        variances = np.einsum("i,nij,j->n", weights, self.errors, weights)
        records = BETWEEN_RECORDS * days
        return Scatter(values, variances, baseline.days, records, days, covariates)

    def temperature(self, record: JointRecord) -> Array | None:
        """Return the temperature of a record as a covariate; None if it is unknown or unused."""
        if self._temperatures is None or not math.isfinite(record.temperature):
            return None
        return np.array([(record.temperature - self._mean_temperature) / _TEMPERATURE_UNIT])

    def at_temperature_of(self, record: JointRecord) -> "Comparer":
        """Return the comparer for a record, without temperatures if the record has none."""
        return self if math.isfinite(record.temperature) else self._over_temperatures

    @cached_property
    def _over_temperatures(self) -> "Comparer":
        if self._temperatures is None:
            return self
        records = tuple(replace(record, temperature=math.nan) for record in self.baseline.records)
        return replace(self, baseline=replace(self.baseline, records=records))

    def expected(self, record: JointRecord) -> Array:
        """Return the healthy coefficients at the temperature of a record, ``(5,)``."""
        temperature = self.temperature(record)
        healthy = self.baseline.healthy
        return healthy if temperature is None else healthy + temperature * self._slopes

    @cached_property
    def _slopes(self) -> Array:
        """Change of each coefficient per unit of the temperature covariate, ``(5,)``."""
        slopes, measured = np.zeros(len(COEFFICIENTS)), self._temperatures
        if measured is not None:
            for number, values in enumerate(self.baseline.values.T):
                if _helps(values, measured):
                    slopes[number] = measured @ values / (measured @ measured)
        return slopes

    @cached_property
    def _mean_temperature(self) -> float:
        return float(np.mean([record.temperature for record in self.baseline.records]))

    @cached_property
    def _temperatures(self) -> Array | None:
        """Temperatures of the records as a covariate, ``(n,)``; None if too few or too similar."""
        measured = np.array([record.temperature for record in self.baseline.records])
        if len(measured) < _FEWEST_FOR_TEMPERATURE or not np.all(np.isfinite(measured)):
            return None
        if np.ptp(measured) < _TEMPERATURE_RANGE:
            return None
        return (measured - self._mean_temperature) / _TEMPERATURE_UNIT

    @cached_property
    def smallest_changes(self) -> Mapping[str, float]:
        """Smallest detectable change on a day without healthy records, by quantity.

        Quantities without a coefficient of the effort model are omitted.
        """
        return _Test(self, self._typical).smallest_changes()

    @cached_property
    def smallest_changes_of_a_day(self) -> Mapping[str, float]:
        """Smallest detectable change on a day with healthy records, by quantity."""
        stamp_ns = self.baseline.records[-1].stamp_ns
        record = replace(self._typical, stamp_ns=stamp_ns)
        return _Test(self, record).smallest_changes()

    @property
    def _typical(self) -> JointRecord:
        """Hypothetical healthy record on a day without other healthy records."""
        mean = np.mean(self.baseline.covariances, axis=0)
        first = self.baseline.records[0]
        return JointRecord(
            NO_DAY * NS_A_DAY,
            self.baseline.healthy,
            mean,
            first.usual_speed,
            first.travel,
            temperature=self._mean_temperature,
        )

    @cached_property
    def improvements(self) -> tuple[Improvement, ...]:
        """The further healthy records that would best lower the detection limit of friction.

        The result is empty if no proposal lowers the smallest detectable change by 10 %.
        """
        present, improvements = self.smallest_changes[FRICTION], []
        for days in (0, _MORE_DAYS):
            extended = Comparer(
                self.baseline.extended(_MORE_RECORDS, days), assumed_correlations=self.correlations
            )
            lower = extended.smallest_changes[FRICTION]
            if lower < _WORTH_IT * present:
                improvements.append(Improvement(FRICTION, days, _MORE_RECORDS, present, lower))
        return tuple(sorted(improvements, key=lambda item: item.smallest_change)[:1])


class _Test:
    """Comparison of one record with its baseline."""

    def __init__(self, comparer: Comparer, record: JointRecord) -> None:
        comparer = comparer.at_temperature_of(record)
        self._comparer, self._record = comparer, record
        self._baseline, self._healthy = comparer.baseline, comparer.expected(record)
        moved = comparer.baseline.motion_errors(record)
        self._error = comparer.error(record.covariance) + np.diag(moved**2)
        self._error[at.DRY, at.DRY] += self._other_error**2
        self._departure = record.values - self._healthy
        self._total = comparer.spread + self._error

    @property
    def _other_error(self) -> float:
        """Error of the friction due to effort outside the model that differs from healthy [-].

        Effort outside the model causes similar errors in all healthy records. If the record has
        more or less of such effort, for example because of a different part in the gripper, the
        difference between the errors remains. It is 0 if the record's error is within the range of
        the healthy records, if an error is unknown, or if the healthy friction is certain.
        """
        if not self._baseline.is_friction_uncertain:
            return 0.0
        healthy = np.array([record.friction_error for record in self._baseline.records])
        error = self._record.friction_error
        if not (math.isfinite(error) and np.all(np.isfinite(healthy))):
            return 0.0
        return max(float(np.min(healthy)) - error, error - float(np.max(healthy)), 0.0)

    def result(self) -> Comparison:
        """Return the comparison of the record with the baseline."""
        tests = self._single_tests()
        symptoms = self._comparer.symptoms
        play = symptoms.play(self._record)
        named: tuple[str, ...] = ()
        rivals: tuple[str, ...] = ()
        least = min(test.probability for test in tests.values())
        departs = any(test.is_significant for test in tests.values())
        if departs and not self._is_effect_of(play.change):
            named, rivals = self._explanation()
        quantities = {name: self._judged(name, test, named, rivals) for name, test in tests.items()}
        quantities[PLAY] = play.change
        tracking = symptoms.tracking(self._record)
        quantities[TRACKING] = tracking.change
        if self._baseline.shape.has_inertia:
            quantities[FRICTION_OVER_INERTIA] = self._friction_over_inertia(named)
        for name, cause in _UNSEEN.items():
            if name not in quantities:
                if self._baseline.is_unexplained:
                    cause = Unjudged.EFFORT_UNEXPLAINED
                quantities[name] = QuantityChange(
                    name,
                    Judgement.NOT_JUDGED,
                    reasons=(QuantityUnjudged(cause),),
                    rivals=named if name in rivals else (),
                )
        figures = symptoms.figures(self._record, _growth(quantities))
        count = len(tests) + len(FIGURES) + 2
        least = min(least, figures.probability, play.probability, tracking.probability)
        states = state_probabilities(self._baseline, self._record)
        ordered = tuple(quantities[name] for name in QUANTITIES)
        return Comparison(ordered, figures.figures, min(1.0, count * least), states or None)

    def _is_effect_of(self, play: QuantityChange) -> bool:
        """Return whether a change of the play explains the departure of the coefficients.

        It does if the play has changed and the dry friction differs by less than 10 %.
        """
        friction = abs(self._departure[at.DRY] / self._healthy[at.DRY])
        return play.judgement is Judgement.CHANGED and friction < _EFFECT_OF_PLAY

    def smallest_changes(self) -> dict[str, float]:
        """Return the smallest detectable change of each quantity that has a coefficient."""
        tests = self._single_tests().items()
        return {name: self._judged(name, test, (), ()).smallest_change for name, test in tests}

    def _single_tests(self) -> dict[str, SingleTest]:
        """Return a test for each hypothesis with a single changed quantity, keyed by quantity."""
        return {
            hypothesis.quantities[0]: self._along(self._weights(hypothesis))
            for hypothesis in self._comparer.hypotheses
            if len(hypothesis.quantities) == 1
        }

    def _weights(self, hypothesis: Hypothesis) -> Array:
        """Return the optimal weights to estimate the change of one quantity, ``(5,)``."""
        return _best_weights(hypothesis.columns, self._total)[0]

    def _along(self, weights: Array) -> SingleTest:
        """Return the test of a linear combination of the coefficients."""
        error = float(weights @ self._error @ weights)
        covariates = self._comparer.temperature(self._record)
        scatter = self._comparer.scatter(weights)
        prediction: Prediction = scatter.predict(error, self._record.day_to_predict, covariates)
        return SingleTest(float(weights @ self._record.values), prediction)

    @cached_property
    def _tolerant(self) -> Array:
        """Covariance including the model errors caused by changed friction, ``(5, 5)``."""
        baseline = self._baseline
        change = abs(self._departure[at.DRY] / self._healthy[at.DRY])
        scales = baseline.scales
        scales[at.VISCOUS] *= _VISCOUS_TOLERANCE
        scales[at.DRY] = 0.0
        return self._total + np.diag((_MODEL_TOLERANCE * change * scales) ** 2)

    @property
    def distance(self) -> float:
        """Squared Mahalanobis distance from the healthy records."""
        return float(self._departure @ _precision(self._tolerant) @ self._departure)

    @cached_property
    def costs(self) -> list[float]:
        """Squared distance that each hypothesis leaves unexplained, plus a parameter penalty."""
        inverse = _precision(self._tolerant)
        costs = []
        for hypothesis in self._comparer.hypotheses:
            columns = hypothesis.columns
            weights = _best_weights(columns, self._tolerant)
            remainder = self._departure - columns @ weights @ self._departure
            penalty = _PARAMETER_COST * columns.shape[1]
            costs.append(float(remainder @ inverse @ remainder) + penalty)
        return costs

    def _explanation(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the quantities that explain the departure best, and their rivals.

        Rivals are quantities that explain the departure nearly as well.
        """
        costs = self.costs
        order = np.argsort(costs)
        close = [n for n in order.tolist() if costs[n] - costs[order[0]] < _DISTINCT_COST]
        # Two changes need more evidence than a single change.
        chosen = min(close, key=lambda n: self._comparer.hypotheses[n].causes)
        best = self._comparer.hypotheses[chosen]
        if self._baseline.shape.load_share and set(best.quantities) == {FRICTION, TORQUE}:
            # Friction that rises with the load raises inertia and gravity at the motor as well.
            chosen = self._number_of(FRICTION)
            best = self._comparer.hypotheses[chosen]
        rivals: list[str] = []
        for number in close:
            names = self._comparer.hypotheses[number].quantities
            is_wider = set(best.quantities) < set(names)
            if not is_wider or costs[number] < costs[chosen]:
                rivals += [name for name in names if name not in best.quantities]
        if FRICTION in best.quantities:
            rivals += self._baseline.hidden_in_friction
        return best.quantities, tuple(dict.fromkeys(rivals))

    def _number_of(self, name: str) -> int:
        """Return the index of the hypothesis in which only one quantity has changed."""
        quantities = [hypothesis.quantities for hypothesis in self._comparer.hypotheses]
        return quantities.index((name,))

    def _judged(
        self, name: str, test: SingleTest, named: tuple[str, ...], rivals: tuple[str, ...]
    ) -> QuantityChange:
        """Return the change and judgement of a quantity.

        The change is estimated together with the changes of the quantities in ``named``, which
        explain the record. ``rivals`` are quantities that explain it equally well.
        """
        smallest, is_doubtful = test.smallest_change, test.is_doubtful
        if named:
            columns = [
                self._comparer.hypotheses[self._number_of(key)].columns[:, 0]
                for key in dict.fromkeys((name, *named))
            ]
            test = self._along(_best_weights(np.column_stack(columns), self._tolerant)[0])
            # An estimate together with further changes is less certain.
            smallest = max(smallest, test.smallest_change)
        change, (low, high) = test.change, test.interval
        smaller, larger = sorted(
            change * math.expm1(sign * Z90 * self._tolerance(name)) for sign in (-1.0, 1.0)
        )
        low = change - math.hypot(change - low, smaller)
        high = change + math.hypot(high - change, larger)
        unit = "-"
        if name == LOAD:
            unit, scale = self._comparer.effort_unit, self._comparer.effort_scale
            change, low, high, smallest = (scale * value for value in (change, low, high, smallest))
        if name == TORQUE:  # the columns are linear in the effort, the quantity is its inverse
            change, low, high = _inverse(change, low, high)
        judgement, rival_names = Judgement.UNCHANGED, ()
        reason: Reason | None = None
        if name in named:
            judgement, rival_names = Judgement.CHANGED, rivals
        elif name in rivals:
            judgement, rival_names = Judgement.NOT_JUDGED, named
            reason = QuantityInseparable(named)
        elif test.is_significant:
            judgement, reason = Judgement.NOT_JUDGED, QuantityUnjudged(Unjudged.NO_SINGLE_CHANGE)
        elif is_doubtful and not named:
            judgement, reason = Judgement.NOT_JUDGED, QuantityUnjudged(Unjudged.DOUBTFUL)
        figures = change, low, high, smallest
        reasons = () if reason is None else (reason,)
        return QuantityChange(name, judgement, *figures, unit, reasons, rival_names)

    def _tolerance(self, name: str) -> float:
        """Return the standard deviation of the logarithm of a relative change.

        A change relative to the friction inherits the error of the healthy friction. The scatter of
        the healthy records does not show this error, because all records share it.
        """
        if name not in _RELATIVE_TO_FRICTION:
            return _RATIO_TOLERANCE
        return math.hypot(_RATIO_TOLERANCE, self._baseline.shape.friction_error)

    def _friction_over_inertia(self, named: tuple[str, ...]) -> QuantityChange:
        """Return the change of the ratio of friction to inertia.

        In a self-locking gear, friction also increases the inertia and gravity at the motor. The
        ratio then shows the change of friction alone.
        """
        healthy = self._healthy
        weights = np.zeros(len(healthy))
        weights[at.DRY], weights[at.INERTIA] = 1.0 / healthy[at.DRY], -1.0 / healthy[at.INERTIA]
        test = self._along(weights)
        both = [at.DRY, at.INERTIA]
        friction, inertia = (self._record.values[both] / healthy[both]).tolist()
        if min(friction, inertia) < _LEAST_RATIO:
            hidden = QuantityUnjudged(Unjudged.HARDLY_VISIBLE)
            return QuantityChange(FRICTION_OVER_INERTIA, Judgement.NOT_JUDGED, reasons=(hidden,))
        ratio = friction / inertia
        sigma = math.hypot(test.prediction.sigma, self._tolerance(FRICTION) * (ratio - 1.0))
        low, high = (ratio * math.exp(sign * Z90 * sigma) - 1.0 for sign in (-1.0, 1.0))
        judgement, reasons = Judgement.UNCHANGED, ()
        if test.is_significant and named:
            judgement = Judgement.CHANGED
        elif test.is_significant or test.is_doubtful:
            judgement, reasons = Judgement.NOT_JUDGED, (QuantityUnjudged(Unjudged.DOUBTFUL),)
        figures = ratio - 1.0, low, high, test.smallest_change
        return QuantityChange(FRICTION_OVER_INERTIA, judgement, *figures, reasons=reasons)


def _growth(quantities: Mapping[str, QuantityChange]) -> float:
    """Return the logarithm of the effort growth that the reported changes explain."""
    logs = [0.0]
    for name, sign in ((FRICTION, 1.0), (TORQUE, -1.0)):
        quantity = quantities.get(name)
        if quantity is not None and quantity.judgement is Judgement.CHANGED:
            logs.append(sign * math.log(max(1.0 + quantity.change, _LEAST_RATIO)))
    return max(logs)


def _best_weights(columns: Array, covariance: Array) -> Array:
    """Return the generalised least-squares weights of each column, ``(k, 5)``."""
    inverse = _precision(covariance)
    weights = np.linalg.solve(columns.T @ inverse @ columns, columns.T @ inverse)
    return np.asarray(weights, dtype=np.float64)


def _precision(covariance: Array) -> Array:
    """Return the inverse of a covariance, with zeros for coefficients that are not fitted."""
    sigmas = np.sqrt(np.diag(covariance))
    scales = np.where(sigmas > 0.0, sigmas, 1.0)
    units = np.outer(scales, scales)
    return np.linalg.pinv(covariance / units, hermitian=True, rcond=_SINGULAR) / units


def _inverse(change: float, low: float, high: float) -> tuple[float, float, float]:
    """Return change and interval of a quantity whose inverse has the relative change ``-change``.

    If the inverse reaches 0 within the interval, the quantity is unbounded: this end of the
    interval is NaN.
    """
    ratio = max(1.0 - change, _TINY) if change < 1.0 else min(1.0 - change, -_TINY)
    ends = [1.0 - end if (1.0 - end) * ratio > 0.0 else math.nan for end in (low, high)]
    return 1.0 / ratio - 1.0, 1.0 / ends[0] - 1.0, 1.0 / ends[1] - 1.0


def _helps(values: Array, temperatures: Array) -> bool:
    """Return whether the temperature improves the prediction in leave-one-out validation."""

    def held_out_square(design: Array) -> float:
        hat = design @ np.linalg.pinv(design)
        residuals = values - hat @ values
        return float(np.sum((residuals / np.maximum(1.0 - np.diag(hat), _TINY)) ** 2))

    constant = np.ones((len(values), 1))
    both = np.column_stack([constant, temperatures])
    return held_out_square(both) < _TEMPERATURE_HELPS * held_out_square(constant)
