# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a record: inverse-dynamics coefficients and model-free figures."""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.dates import has_date
from ema_core.description import ActuatorDescription
from ema_core.record_needs import FEWEST_REVERSING, FEWEST_STROKES
from ema_core.telemetry import Telemetry
from ema_monitor.joint.figures import figures_of, lost_motion, tracking_lag
from ema_monitor.joint.lag import UNKNOWN_LAG, EffortLag
from ema_monitor.joint.parts import parts_of
from ema_monitor.joint.shape import Shape, fit_record, friction_error_square
from ema_monitor.joint.signals import Fine, Preparation, Signals, filtered
from ema_monitor.reasons import (
    Direction,
    EffortConstant,
    Reason,
    SpeedOutside,
    TooFewRows,
    TooFewStrokes,
)

NS_A_DAY: Final = 86_400_000_000_000
"""Nanoseconds per day."""

NO_DAY: Final = -1
"""Day number that no healthy record has."""

FEWEST_ROWS: Final = 30
"""Minimum number of rows of steady motion in a record."""

_SAME_RATE: Final = 0.02
SLOWEST, FASTEST = 0.5, 1.6
"""Permitted range of a record's speed, relative to the healthy records [-]."""

_CONSTANT: Final = 1e-9
"""Relative range below which the filtered effort counts as constant [-]."""


@dataclass(frozen=True)
class JointRecord:
    """Coefficients and figures of one record."""

    stamp_ns: int
    """Timestamp of the first sample [ns]."""
    values: Array
    """Coefficients, ``(5,)``, in the order of ``COEFFICIENTS``."""
    covariance: Array
    """Covariance of the errors of ``values``, ``(5, 5)``."""
    usual_speed: float
    """95 % quantile of the speed [rad/s]."""
    travel: float = math.nan
    """Travel of the position [rad]."""
    figures: dict[str, float] = field(default_factory=dict)
    """Model-free figures by name; scatters are logarithms."""
    lag_s: float = math.nan
    """Tracking lag behind the command [s]; NaN without a command, or if it moves too little."""
    lag_sigma: float = math.nan
    """Standard deviation of ``lag_s`` [s]; NaN without a command, infinite if it moves too
    little."""
    lost_motion: float = math.nan
    """Lost motion between motor and joint [rad]; NaN if the record does not show it."""
    lost_motion_sigma: float = math.nan
    """Standard deviation of ``lost_motion`` [rad]."""
    temperature: float = math.nan
    """Measured rise of the winding temperature [K]; NaN if it was not measured."""
    rows: int = 0
    """Number of rows of steady motion."""
    parts: tuple[dict[str, float], ...] = ()
    """Figures of each part by name, used to classify labelled states."""
    effort_lag: EffortLag = UNKNOWN_LAG
    """Lag of the effort behind the motion."""
    friction_error: float = math.nan
    """Standard deviation of the error of the dry friction due to effort outside the model, relative
    to the healthy friction [-]; NaN if it was not determined."""

    @property
    def day(self) -> int:
        """Day of the record, counted from 1970-01-01; 0 if its timestamps have no date."""
        return self.stamp_ns // NS_A_DAY if has_date(self.stamp_ns) else 0

    @property
    def day_to_predict(self) -> int:
        """Day for predictions; ``NO_DAY`` for a record without a date."""
        return self.day or NO_DAY

    def is_same(self, record: "JointRecord") -> bool:
        """Return whether both records come from the same telemetry, regardless of the model."""
        both_unknown = math.isnan(self.travel) and math.isnan(record.travel)
        return self.stamp_ns == record.stamp_ns and (both_unknown or self.travel == record.travel)

    def at_rate(self, sample_period: float, usual: float) -> "JointRecord":
        """Return the record, without figures if its rate differs from the healthy records.

        Scatter and roughness of the effort depend on the sample rate.

        Parameters
        ----------
        sample_period, usual
            Sample periods of the record and of the healthy records [s].
        """
        is_alike = abs(sample_period / usual - 1.0) < _SAME_RATE
        return self if is_alike else replace(self, figures={}, parts=())


@dataclass(frozen=True)
class LabelledRecord:
    """A record labelled with a state."""

    state: str
    """Label of the state."""
    record: JointRecord
    """The record."""


def record_defect(signals: Signals, preparation: Preparation) -> Reason | None:
    """Return the reason why a record cannot be compared, or None."""
    if len(signals) < FEWEST_ROWS:
        return TooFewRows(len(signals), FEWEST_ROWS)
    if np.ptp(signals.effort) <= _CONSTANT * np.max(np.abs(signals.effort)):
        return EffortConstant(float(np.mean(signals.effort)))
    for direction, way in ((1, Direction.FORWARD), (-1, Direction.BACKWARD)):
        if (strokes := signals.strokes(direction)) < FEWEST_REVERSING:
            return TooFewStrokes(strokes, way, FEWEST_REVERSING, preparation.is_empty)
        if (strokes := signals.pieces(direction)) < FEWEST_STROKES:
            return TooFewStrokes(strokes, way, FEWEST_STROKES, preparation.is_empty)
    ratio = signals.usual_speed / preparation.usual_speed
    return None if SLOWEST <= ratio <= FASTEST else SpeedOutside(ratio, SLOWEST, FASTEST)


def read_record(
    telemetry: Telemetry,
    description: ActuatorDescription,
    preparation: Preparation,
    shape: Shape,
    *,
    healthy: Array | None = None,
    temperature: float = math.nan,
    prepared: tuple[Fine, Signals] | None = None,
    effort_lag: EffortLag = UNKNOWN_LAG,
) -> JointRecord:
    """Return the coefficients and figures of a record, fitted with the model of its unit.

    Parameters
    ----------
    telemetry, description
        The record and its actuator.
    preparation, shape
        Preparation of the unit's records, and effort model of the unit.
    healthy
        Prior means of the coefficients, ``(5,)``, for coefficients that the record does not
        determine. None has the meaning described in `fit_record`.
    temperature
        Measured rise of the winding temperature [K].
    prepared
        Block means and rows, if already computed.
    effort_lag
        Lag of the effort behind the motion; its shift is already removed from ``prepared``.
    """
    if prepared is None:
        fine = preparation.block_means(telemetry, description)
        prepared = fine, filtered(fine, preparation)
    fine, signals = prepared
    fit = fit_record(shape, signals, healthy)
    figures = figures_of(telemetry, signals, fit.residuals, preparation)
    lag = tracking_lag(fine)
    lost = lost_motion(telemetry, description, preparation)
    return JointRecord(
        telemetry.stamp_ns,
        fit.values,
        fit.covariance,
        signals.usual_speed,
        float(np.ptp(telemetry.position)),
        figures,
        *lag,
        *lost,
        temperature,
        len(signals),
        parts_of(telemetry, preparation),
        effort_lag,
        math.sqrt(max(friction_error_square(shape, signals, fit), 0.0)),
    )
