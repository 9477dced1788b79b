# SPDX-License-Identifier: Apache-2.0
"""Friction of a record as a function of speed, with the band of the healthy records."""

from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint import shape as at
from ema_monitor.joint.comparing import Comparer
from ema_monitor.joint.record import JointRecord
from ema_monitor.joint.shape import COEFFICIENTS, Shape, fit_record
from ema_monitor.joint.signals import STRIBECK_SPEEDS, Signals
from ema_monitor.joint.single import INTERVAL

SLOWEST: Final = 0.06
"""Slowest speed of a curve, relative to the usual speed [-].

If viscous friction is not fitted, a curve begins at a higher speed.
"""

_NEARLY_ONE_SPEED: Final = 0.7
_POINTS: Final = 12
_LEAST_ROWS: Final = 3


class FrictionCurve(NamedTuple):
    """Friction as a function of speed, ``(n,)`` each."""

    speed: Array
    """Speeds in ascending order, from minus to plus the usual speed without slow speeds [rad/s]."""
    healthy_low: Array
    """Lower end of the 90 % band of healthy friction [A]."""
    healthy_high: Array
    """Upper end of the 90 % band of healthy friction [A]."""
    latest: Array
    """Friction of the record [A]; NaN at speeds with fewer than three rows."""


def friction_curve(comparer: Comparer, record: JointRecord, signals: Signals) -> FrictionCurve:
    """Return the friction of a record as a function of speed, with the band of healthy records.

    The band is the 90 % interval of the prediction for a healthy record on the same day and at the
    same temperature. The friction of the record is its effort minus the fitted inertia, gravity,
    load, load-dependent friction and free terms, averaged over the rows near each speed.

    Parameters
    ----------
    comparer
        Comparer of the unit.
    record, signals
        The record, and its rows of steady motion.
    """
    baseline = comparer.baseline
    usual = baseline.preparation.usual_speed
    # Records of nearly one speed show no friction at other speeds.
    slowest = SLOWEST if baseline.shape.has_viscous else _NEARLY_ONE_SPEED
    half = np.linspace(slowest, 1.0, _POINTS) * usual
    speed = np.concatenate([-half[::-1], half])
    low, high = np.array([_band(comparer, record, value) for value in speed]).T
    latest = _means(speed, signals.speed, friction_of(baseline.shape, signals, baseline.healthy))
    return FrictionCurve(speed, low, high, latest)


def friction_of(shape: Shape, signals: Signals, healthy: Array) -> Array:
    """Return the friction of each row of a record without load-dependent friction, ``(n,)`` [A].

    ``healthy`` contains the healthy coefficients, ``(5,)``.
    """
    fit = fit_record(shape, signals, healthy)
    is_friction = np.zeros(len(COEFFICIENTS), dtype=bool)
    is_friction[[at.DRY, at.VISCOUS]] = True
    remainder = np.where(is_friction, 0.0, fit.values)
    effort = signals.effort - shape.design(signals) @ remainder - signals.free @ fit.free
    load = fit.values[at.DRY] * shape.load_share * shape.load_friction(signals)
    return np.asarray(effort - load, dtype=np.float64)


def _band(comparer: Comparer, record: JointRecord, speed: float) -> tuple[float, float]:
    """Return the 90 % interval of healthy friction at a ``speed`` [rad/s], for a record [A]."""
    shape, usual = comparer.baseline.shape, comparer.baseline.preparation.usual_speed
    ratio = (speed / (STRIBECK_SPEEDS[shape.stribeck] * usual)) ** 2
    weights = np.zeros(len(COEFFICIENTS))
    weights[at.DRY] = np.sign(speed) * (shape.coulomb + shape.dip * np.exp(-ratio))
    weights[at.VISCOUS] = speed if shape.has_viscous else 0.0
    variance = float(weights @ comparer.error(record.covariance) @ weights)
    scatter = comparer.scatter(weights)
    prediction = scatter.predict(variance, record.day_to_predict, comparer.temperature(record))
    return prediction.interval(INTERVAL)


def _means(places: Array, speed: Array, friction: Array) -> Array:
    """Return the mean friction of the rows nearest to each speed in ``places`` [A].

    Rows that are slower or faster than all ``places`` by more than half of the last step are
    ignored. The mean of fewer than three rows is NaN.
    """
    edges = 0.5 * (places[1:] + places[:-1])
    half_width = 0.5 * (places[-1] - places[-2])
    inner = np.min(np.abs(places)) - half_width
    is_inside = (np.abs(speed) < places[-1] + half_width) & (np.abs(speed) > inner)
    number = np.searchsorted(edges, speed[is_inside])
    count = np.bincount(number, minlength=len(places))
    total = np.bincount(number, friction[is_inside], minlength=len(places))
    means = total / np.maximum(count, 1)
    return np.where(count >= _LEAST_ROWS, means, np.nan)
