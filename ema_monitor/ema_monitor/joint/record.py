"""What a record of a joint shows: coefficients of inverse dynamics, and model-free figures."""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.dates import has_date
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_core.wording import counted
from ema_monitor.joint.figures import figures_of, lost_motion, tracking_lag
from ema_monitor.joint.lag import UNKNOWN_LAG, EffortLag
from ema_monitor.joint.parts import parts_of
from ema_monitor.joint.shape import Shape, fit_record
from ema_monitor.joint.signals import Fine, Preparation, Signals, block_means, filtered

NS_A_DAY: Final = 86_400_000_000_000

NO_DAY: Final = -1
"""A day that has no healthy records."""

FEWEST_ROWS: Final = 30
FEWEST_STROKES: Final = 3
"""Strokes that a record has at least in each direction; 2 s of a long stroke count as one."""
FEWEST_REVERSING: Final = 2
"""Strokes that it has at least, however long: place and time are told apart by repetition."""
_SAME_RATE: Final = 0.02
SLOWEST, FASTEST = 0.5, 1.6
"""Range of the speed of a record, over that of the healthy records [-]."""

_CONSTANT: Final = 1e-9
"""Range of a constant effort after the filter, over its size: rounding errors [-]."""


@dataclass(frozen=True)
class JointRecord:
    """What one record shows.

    Attributes
    ----------
    stamp_ns
        Stamp of its first sample [ns].
    values, covariance
        Coefficients, ``(5,)``, in the order of ``COEFFICIENTS``, and the covariance of their
        error, ``(5, 5)``.
    usual_speed, travel
        95 % quantile of the speed [rad/s], and travel of the position [rad].
    figures
        Model-free figures by name; scatters are logarithms.
    lag_s, lag_sigma
        Tracking lag behind the command [s]; NaN where there is no command. If the command does not
        move enough, the lag is NaN and its sigma is infinite.
    lost_motion, lost_motion_sigma
        Lost motion between motor and joint [rad]; NaN where it is not shown.
    temperature
        Measured rise of the winding temperature [K]; NaN where it was not measured.
    rows
        Number of rows of steady motion.
    parts
        Figures of its parts by name, which tell labelled states apart.
    effort_lag
        Lag of the effort behind the motion.
    """

    stamp_ns: int
    values: Array
    covariance: Array
    usual_speed: float
    travel: float = math.nan
    figures: dict[str, float] = field(default_factory=dict)
    lag_s: float = math.nan
    lag_sigma: float = math.nan
    lost_motion: float = math.nan
    lost_motion_sigma: float = math.nan
    temperature: float = math.nan
    rows: int = 0
    parts: tuple[dict[str, float], ...] = ()
    effort_lag: EffortLag = UNKNOWN_LAG

    @property
    def day(self) -> int:
        """Day of the record, counted from 1970; 0 if its stamps have no date."""
        return self.stamp_ns // NS_A_DAY if has_date(self.stamp_ns) else 0

    @property
    def day_to_predict(self) -> int:
        """Day that the record is predicted for: one without a date may be of any other day."""
        return self.day or NO_DAY

    def is_same(self, record: "JointRecord") -> bool:
        """Return whether both are of the same telemetry, however it was fitted."""
        both_unknown = math.isnan(self.travel) and math.isnan(record.travel)
        return self.stamp_ns == record.stamp_ns and (both_unknown or self.travel == record.travel)

    def at_rate(self, sample_period: float, usual: float) -> "JointRecord":
        """Return the record without figures that its rate makes incomparable.

        Scatter and roughness of the same effort depend on the sample rate.

        Parameters
        ----------
        sample_period, usual
            Period of its telemetry, and of the healthy records [s].
        """
        is_alike = abs(sample_period / usual - 1.0) < _SAME_RATE
        return self if is_alike else replace(self, figures={}, parts=())


@dataclass(frozen=True)
class LabelledRecord:
    """A record in a state that the owner has named."""

    state: str
    record: JointRecord


def defect_of(signals: Signals, preparation: Preparation) -> str:
    """Return why a record cannot be compared; empty when it can."""
    if len(signals) < FEWEST_ROWS:
        return (
            f"{len(signals)} rows of steady motion in one direction, at least {FEWEST_ROWS} are "
            "needed: give longer motion"
        )
    if np.ptp(signals.effort) <= _CONSTANT * np.max(np.abs(signals.effort)):
        return (
            f"the effort is {np.mean(signals.effort):.3g} throughout, although the joint moves: "
            "expected an effort that follows the motion; look for a failed sensor, or a wrong "
            "column in the mapping"
        )
    for way, name in ((1, "forward"), (-1, "backward")):
        if (strokes := signals.strokes(way)) < FEWEST_REVERSING:
            return (
                f"{counted(strokes, 'stroke')} {name}, at least {FEWEST_REVERSING} in each "
                "direction are needed: move to and fro"
            )
        if (strokes := signals.pieces(way)) < FEWEST_STROKES:
            return (
                f"{strokes} strokes {name}, at least {FEWEST_STROKES} in each direction are "
                "needed: move to and fro"
            )
    ratio = signals.usual_speed / preparation.usual_speed
    if not SLOWEST <= ratio <= FASTEST:
        return (
            f"the speed is {ratio:.2g} times that of the healthy records, {SLOWEST:g} to "
            f"{FASTEST:g} times can be compared: add healthy records of this motion"
        )
    return ""


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
    """Return what a record shows, fitted with the terms of its unit.

    Parameters
    ----------
    telemetry, description
        The record and its actuator.
    preparation, shape
        How the records of the unit are prepared, and its model.
    healthy
        Coefficients that decide what the record leaves open, ``(5,)``.
    temperature
        Measured rise of the winding temperature [K].
    prepared
        Block means and rows, where they are known already.
    effort_lag
        Lag of the effort, which was removed from the rows where it departs.
    """
    if prepared is None:
        fine = block_means(telemetry, description, preparation.cutoff_hz)
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
    )
