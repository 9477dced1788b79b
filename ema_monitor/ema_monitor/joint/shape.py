# SPDX-License-Identifier: Apache-2.0
"""Effort model of a joint, and the selection of its terms on healthy records."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array, Flags
from ema_monitor.joint.regression import CoefficientPrior, regress, robust_fit
from ema_monitor.joint.signals import STRIBECK_SPEEDS, Signals

COEFFICIENTS: Final = ("friction", "inertia", "viscous_friction", "load", "gravity")
"""Coefficients of a record, in this order: dry friction relative to the baseline [-], inertia
[A.s^2/rad], viscous friction [A.s/rad], constant load [A], and gravity relative to the baseline
[-]."""

DRY, INERTIA, VISCOUS, LOAD, GRAVITY = range(len(COEFFICIENTS))

GRAVITY_TRAVEL: Final = 0.3
"""Travel above which the selection of terms begins with a model with gravity [rad]."""

_IMPROVES: Final = 0.95
_MOST_DIP: Final = 2.0
_MOST_LOAD: Final = 0.6
_FEWEST_ROWS: Final = 30
_FREE: Final = 10.0
_OPEN: Final = 1e3
_SEEN: Final = 0.3
_SEPARABLE: Final = 0.04
_INDEPENDENT: Final = 3  # rows; the filter correlates noise by less than 1 % over this distance
_TINY: Final = 1e-12


@dataclass(frozen=True)
class Shape:
    """Effort model shared by all records of a unit.

    ``effort = dry · D + inertia · a + viscous · v + load + gravity · G``, with the dry friction
    ``D = coulomb · s + dip · s exp(-(v / v_s)^2) + share · s |inertia a + G|`` for the filtered
    sign s of the speed, and gravity ``G = sine · sin(q - c) + cosine · (cos(q - c) - 1)`` for the
    angle c at the centre of the motion.
    """

    coulomb: float
    """Coulomb friction of the healthy unit [A]."""
    stribeck: int = 0
    """Index of the Stribeck speed in ``STRIBECK_SPEEDS``."""
    dip: float = 0.0
    """Stribeck friction [A]."""
    load_share: float = 0.0
    """Ratio of load-dependent friction to load torque [-]."""
    load_inertia: float = 0.0
    """Inertia in the load torque [A.s^2/rad]."""
    of_inertia: tuple[float, ...] = ()
    """Change of the coefficients by load-dependent friction when the inertia doubles, ``(5,)``.
    Empty without a load share."""
    of_gravity: tuple[float, ...] = ()
    """Change of the coefficients by load-dependent friction when gravity doubles, ``(5,)``. Empty
    without a load share."""
    sine: float = 0.0
    """Coefficient of ``sin(q - c)`` in the gravity effort [A]."""
    cosine: float = 0.0
    """Coefficient of ``cos(q - c) - 1`` in the gravity effort [A]."""
    centre: float = 0.0
    """Angle ``c`` at the centre of the motion [rad]."""
    has_gravity: bool = False
    has_inertia: bool = True
    has_viscous: bool = True
    """Whether viscous friction is fitted separately. Otherwise the Coulomb friction includes it."""
    unexplained: float = 0.0
    """Ratio of the standard deviations of the residuals and of the effort [-]."""
    friction_error: float = 0.0
    """Standard deviation of the error of the healthy dry friction due to effort outside the model,
    relative to the friction [-]. The error is the same in all records."""

    @property
    def used(self) -> Flags:
        """Flags of the fitted coefficients, in the order of ``COEFFICIENTS``, ``(5,)``."""
        return np.array([True, self.has_inertia, self.has_viscous, True, self.has_gravity])

    def gravity(self, signals: Signals) -> Array:
        """Return the healthy gravity effort of each row, ``(n,)`` [A]."""
        angle = signals.position - self.centre
        return self.sine * np.sin(angle) + self.cosine * (np.cos(angle) - 1.0)

    def dry_friction(self, signals: Signals) -> Array:
        """Return the healthy dry-friction effort of each row, ``(n,)`` [A]."""
        dry = self.coulomb * signals.direction + self.dip * signals.stribeck[:, self.stribeck]
        if self.load_share:
            dry = dry + self.load_share * self.load_friction(signals)
        return dry

    def load_friction(self, signals: Signals) -> Array:
        """Return the load-dependent friction effort for a load share of 1, ``(n,)`` [A]."""
        load = self.load_inertia * signals.acceleration + self.gravity(signals)
        return np.asarray(np.abs(load) * signals.direction, dtype=np.float64)

    def load_friction_of_parts(self, signals: Signals) -> tuple[Array, Array]:
        """Return the load friction added by doubling inertia or gravity, ``(n,)`` each [A]."""
        inertia, gravity = self.load_inertia * signals.acceleration, self.gravity(signals)
        share = self.load_share * np.sign(inertia + gravity) * signals.direction
        return share * inertia, share * gravity

    def design(self, signals: Signals) -> Array:
        """Return the design matrix of ``COEFFICIENTS``, ``(n, 5)``."""
        columns = np.empty((len(signals), len(COEFFICIENTS)))
        columns[:, DRY] = self.dry_friction(signals)
        columns[:, INERTIA] = signals.acceleration
        columns[:, VISCOUS] = signals.speed
        columns[:, LOAD] = 1.0
        columns[:, GRAVITY] = self.gravity(signals)
        return columns

    def terms(self, signals: Signals) -> Array:
        """Return the columns of the fitted coefficients and of ``Signals.free``, ``(n, p)``."""
        return np.column_stack([self.design(signals)[:, self.used], signals.free])

    @property
    def friction_scale(self) -> float:
        """Healthy Coulomb friction, the reference of the dry friction's coefficient [A]."""
        return abs(self.coulomb)


class RecordFit(NamedTuple):
    """Coefficients of one record, ``(5,)``, their covariance, ``(5, 5)``, and effort residuals [A].

    ``residuals`` is ``(n,)``; ``free`` contains the coefficients of ``Signals.free``, ``(k,)``.
    """

    values: Array
    covariance: Array
    residuals: Array
    free: Array

    def predict(self, shape: Shape, signals: Signals) -> Array:
        """Return the predicted effort of rows, ``(n,)`` [A]."""
        return shape.design(signals) @ self.values + signals.free @ self.free


def fit_record(shape: Shape, signals: Signals, healthy: Array | None = None) -> RecordFit:
    """Return the coefficients of a record, fitted with the effort model of its unit.

    Parameters
    ----------
    shape
        Effort model of the unit.
    signals
        Rows of the record.
    healthy
        Prior means of the coefficients, ``(5,)``, from the baseline. If None, 1 for dry friction
        and gravity, and 0 for the rest.
    """
    design = np.column_stack([shape.design(signals), signals.free])
    if healthy is None:
        healthy = np.array([1.0, 0.0, 0.0, 0.0, 1.0])
    terms = signals.free.shape[1]
    used = np.concatenate([shape.used, np.ones(terms, dtype=bool)])
    values = np.concatenate([healthy, np.zeros(terms)])
    # The prior stays wide in a record without effort: it must not look healthy by its prior.
    effort = max(_rms(signals.effort), _rms(design @ values))
    scales = effort / np.maximum(np.sqrt(np.mean(design**2, axis=0)), _TINY)
    prior = CoefficientPrior(values[used], _FREE * scales[used])
    fit = regress(design[:, used], signals.effort, signals.stroke, prior)
    covariance = np.zeros((len(used), len(used)))
    values[used] = fit.values
    covariance[np.ix_(used, used)] = fit.covariance
    n = len(COEFFICIENTS)
    return RecordFit(values[:n], covariance[:n, :n], fit.residuals, values[n:])


def _rms(column: Array) -> float:
    return math.sqrt(float(np.mean(column**2)))


class _Terms(NamedTuple):
    """Terms of a candidate effort model."""

    sine: bool = False
    cosine: bool = False
    stribeck: int | None = None
    has_load: bool = False

    @property
    def columns(self) -> list[int]:
        """Column indices in ``_Record.common``; the load has no column there."""
        stribeck = [] if self.stribeck is None else [1 + self.stribeck]
        angle = 1 + len(STRIBECK_SPEEDS)
        return [0, *stribeck, *([angle] * self.sine), *([angle + 1] * self.cosine)]


class _Record:
    """A healthy record, prepared for the fits of candidate models.

    Attributes
    ----------
    signals
        All rows.
    halves
        The two halves of the strokes in both orders, as (fitted, held out). Empty if a half has too
        few rows.
    common, effort
        Columns of the shared terms, ``(n, k)``, and the effort, ``(n,)``, both orthogonal to the
        columns whose coefficients are free in each record.
    """

    def __init__(self, signals: Signals, centre: float) -> None:
        self.signals = signals
        even = signals.every_other_stroke()
        halves = signals.at(even), signals.at(~even)
        is_long = min(map(len, halves)) >= _FEWEST_ROWS // 2
        self.halves = (halves, halves[::-1]) if is_long else ()
        angle = signals.position - centre
        gravity = [np.sin(angle), np.cos(angle) - 1.0]
        self._common = np.column_stack([signals.direction, signals.stribeck, *gravity])
        ones = np.ones(len(signals))
        columns = [signals.acceleration, signals.speed, ones, signals.free]
        self._free = np.column_stack(columns)
        self._inverse = np.linalg.pinv(self._free, rcond=_TINY)
        self.common, self.effort = self.residuals(self._common), self.residuals(signals.effort)

    def residuals(self, columns: Array) -> Array:
        """Return columns, ``(n,)`` or ``(n, k)``, minus their projection on the free terms."""
        return np.asarray(columns - self._free @ (self._inverse @ columns), dtype=np.float64)

    def inertia(self, columns: list[int], values: Array) -> float:
        """Return the inertia for given coefficients of common terms [A.s^2/rad]."""
        return float(self._inverse[0] @ (self.signals.effort - self._common[:, columns] @ values))


def choose_shape(signals: Sequence[Signals], *, is_linear: bool) -> Shape:
    """Return the effort model whose terms are selected by cross-validation on healthy records.

    A term is accepted if its sign is physical and it reduces the error on the held-out record by
    5 % (geometric mean over the records). The coefficients of the held-out record are fitted to
    every other stroke, and evaluated on the remaining strokes.

    Parameters
    ----------
    signals
        Healthy records.
    is_linear
        Whether the joint is linear, so that gravity does not depend on its position.

    Raises
    ------
    ValueError
        If the records do not determine the friction of the joint.
    """
    centre = float(np.mean([np.mean(rows.position) for rows in signals]))
    travel = float(np.median([np.ptp(rows.position) for rows in signals]))
    records = [_Record(rows, centre) for rows in signals]
    terms = _Terms(sine=not is_linear and travel >= GRAVITY_TRAVEL)
    best = _error(records, terms, centre)
    if terms.sine:
        best, terms = _better(records, centre, best, terms, terms._replace(cosine=True))
        plain = _Terms()
        error = _error(records, plain, centre)
        if error * _IMPROVES < best:
            best, terms = error, plain
    candidates = [terms._replace(stribeck=at) for at in range(len(STRIBECK_SPEEDS))]
    errors = [_error(records, candidate, centre) for candidate in candidates]
    at = int(np.argmin(errors))
    if errors[at] < _IMPROVES * best:
        best, terms = errors[at], candidates[at]
    best, terms = _better(records, centre, best, terms, terms._replace(has_load=True))
    shape = _fit_shape(records, terms, centre)
    if shape is None or not shape.coulomb > 0.0:
        raise ValueError(
            "the healthy records show no dry friction: the effort does not follow the direction of "
            "the motion; does the effort have the sign of the motion?"
        )
    shape = _with_load_columns(_observable(shape, signals), signals)
    return replace(shape, friction_error=_usual_friction_error(shape, signals))


def _with_load_columns(shape: Shape, records: Sequence[Signals]) -> Shape:
    """Return the model with the values of ``of_inertia`` and ``of_gravity``."""
    if not shape.load_share:
        return shape
    columns = []
    for record in records:
        free = np.concatenate([shape.used, np.ones(record.free.shape[1], dtype=bool)])
        design = np.column_stack([shape.design(record), record.free])
        values = np.zeros((len(free), 2))
        target = np.column_stack(shape.load_friction_of_parts(record))
        values[free] = np.linalg.lstsq(design[:, free], target, rcond=None)[0]
        columns.append(values[: len(COEFFICIENTS)])
    of_inertia, of_gravity = np.median(columns, axis=0).T.tolist()
    return replace(shape, of_inertia=tuple(of_inertia), of_gravity=tuple(of_gravity))


def _observable(shape: Shape, records: Sequence[Signals]) -> Shape:
    """Return the model without coefficients that the motion of the records does not determine.

    ``unexplained`` is set as well.
    """
    fits = [fit_record(shape, record) for record in records]
    covariance = np.median([fit.covariance for fit in fits], axis=0)
    sigmas = np.sqrt(np.diag(covariance))
    inertia = float(np.median([fit.values[INERTIA] for fit in fits]))
    unexplained = [
        float(np.std(fit.residuals) / max(np.std(record.effort), _TINY))
        for fit, record in zip(fits, records, strict=True)
    ]
    seen = replace(
        shape,
        has_inertia=bool(sigmas[INERTIA] < _SEEN * inertia),
        unexplained=float(np.median(unexplained)),
    )
    if shape.has_gravity and not sigmas[GRAVITY] < _SEEN:
        seen = replace(seen, sine=0.0, cosine=0.0, has_gravity=False)
    # Coulomb friction then includes viscous friction at the mean speed.
    dry = np.concatenate([shape.dry_friction(record) * record.direction for record in records])
    viscous = float(np.median([fit.values[VISCOUS] for fit in fits]))
    speed = float(np.mean(np.concatenate([np.abs(record.speed) for record in records])))
    both = float(np.mean(dry)) + viscous * speed
    if sigmas[VISCOUS] * speed < _SEPARABLE * both:
        return seen
    return replace(seen, has_viscous=False, coulomb=both, dip=0.0, load_share=0.0)


def friction_error_square(shape: Shape, signals: Signals, fit: RecordFit) -> float:
    """Return the variance of the friction coefficient due to effort outside the model [-].

    The coefficient is relative to the healthy friction. The residuals contain only the part of this
    effort that no term of the model can represent. The part parallel to the friction column is
    assumed to have the same variance. Products of residuals that are ``_INDEPENDENT`` rows apart
    exclude noise, which is independent at this distance. The result may be negative.

    Parameters
    ----------
    shape, signals, fit
        Effort model of the unit, rows of the record, and the coefficients fitted to them.
    """
    design = shape.terms(signals)
    scales = np.maximum(np.sqrt(np.mean(design**2, axis=0)), _TINY)
    friction, rest = design[:, 0] / scales[0], design[:, 1:] / scales[1:]
    alone = friction - rest @ np.linalg.lstsq(rest, friction, rcond=None)[0]
    first, second = fit.residuals[:-_INDEPENDENT], fit.residuals[_INDEPENDENT:]
    same = signals.stroke[:-_INDEPENDENT] == signals.stroke[_INDEPENDENT:]
    square = float(np.mean((first * second)[same])) if np.any(same) else _rms(fit.residuals) ** 2
    return square / max(scales[0] * _rms(alone), _TINY) ** 2


def _usual_friction_error(shape: Shape, records: Sequence[Signals]) -> float:
    """Return the median relative error of the friction due to effort outside the model [-]."""
    squares = []
    for record in records:
        fit = fit_record(shape, record)
        square = friction_error_square(shape, record, fit)
        squares.append(square / max(abs(fit.values[DRY]), _TINY) ** 2)
    return math.sqrt(max(float(np.median(squares)), 0.0))


def _better(
    records: Sequence[_Record], centre: float, best: float, terms: _Terms, candidate: _Terms
) -> tuple[float, _Terms]:
    error = _error(records, candidate, centre)
    return (error, candidate) if error < _IMPROVES * best else (best, terms)


def _error(records: Sequence[_Record], terms: _Terms, centre: float) -> float:
    """Return the prediction error in held-out strokes [A]; infinite if a term is unphysical."""
    logs = []
    for at, record in enumerate(records):
        rest = [record for number, record in enumerate(records) if number != at] or list(records)
        shape = _fit_shape(rest, terms, centre)
        if shape is None:
            return math.inf
        for fitted, held_out in record.halves:
            errors = held_out.effort - fit_record(shape, fitted).predict(shape, held_out)
            floor = _TINY * _rms(held_out.effort) ** 2
            logs.append(math.log(float(np.mean(errors**2)) + floor))
    return math.exp(0.5 * float(np.mean(logs))) if logs else math.inf


def _fit_shape(records: Sequence[_Record], terms: _Terms, centre: float) -> Shape | None:
    """Return the model with the common terms fitted together with the free coefficients.

    The result is None if the fit is unphysical: the friction is not positive, or a Stribeck or load
    term is out of range.
    """
    columns = terms.columns
    designs = [record.common[:, columns] for record in records]
    shape = _pooled(records, terms, centre, designs)
    if terms.has_load and shape is not None:
        values = [shape.coulomb, *([shape.dip] * (terms.stribeck is not None))]
        values += [shape.sine] * terms.sine + [shape.cosine] * terms.cosine
        inertias = [record.inertia(columns, np.array(values)) for record in records]
        loaded = replace(shape, load_inertia=float(np.median(inertias)))
        loads = [record.residuals(loaded.load_friction(record.signals)) for record in records]
        with_load = [np.column_stack(both) for both in zip(designs, loads, strict=True)]
        shape = _pooled(records, terms, centre, with_load)
        return shape and replace(shape, load_inertia=loaded.load_inertia)
    return shape


def _pooled(
    records: Sequence[_Record], terms: _Terms, centre: float, designs: Sequence[Array]
) -> Shape | None:
    """Return the model with the common terms fitted to all records; None if it is unphysical.

    ``designs`` holds the columns of the terms for each record, with the load last.
    """
    design = np.concatenate(designs)
    target = np.concatenate([record.effort for record in records])
    scales = np.sqrt(np.mean(target**2)) / np.maximum(np.sqrt(np.mean(design**2, axis=0)), _TINY)
    fit = robust_fit(design, target, CoefficientPrior(np.zeros(len(scales)), _OPEN * scales))
    values = fit.values.tolist()
    coulomb = values.pop(0)
    dip = values.pop(0) if terms.stribeck is not None else 0.0
    sine = values.pop(0) if terms.sine else 0.0
    cosine = values.pop(0) if terms.cosine else 0.0
    share = values.pop(0) if values else 0.0
    if not coulomb > 0.0 or not 0.0 <= dip <= _MOST_DIP * coulomb or not 0.0 <= share <= _MOST_LOAD:
        return None
    return Shape(
        coulomb,
        terms.stribeck or 0,
        dip,
        load_share=share,
        sine=sine,
        cosine=cosine,
        centre=centre,
        has_gravity=terms.sine or terms.cosine,
    )
