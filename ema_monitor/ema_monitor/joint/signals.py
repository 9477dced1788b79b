# SPDX-License-Identifier: Apache-2.0
"""Filtered signals of a record: one zero-phase filter for all columns, then decimation."""

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_core.description import ActuatorDescription
from ema_core.record_needs import LONGEST_STROKE_S
from ema_core.telemetry import Telemetry
from ema_monitor.joint.smoothing import smoothed

SLOWEST_CUTOFF_HZ: Final = 1.5
"""Smallest cut-off frequency of the filter, if the sample rate permits [Hz]."""
HIGHEST_SHARE: Final = 0.2
"""Largest cut-off frequency, relative to the sample rate [-]."""

STRIBECK_SPEEDS: Final = (0.06, 0.12, 0.24)
"""Candidate Stribeck speeds, relative to the usual speed [-]."""

# A Gaussian of this standard deviation times 1 / f passes 71 % of the amplitude at f.
_SIGMA_CUTOFF: Final = 0.1325
_LEEWAY: Final = 1.2
_OF_MOTION: Final = 2.5
_POWER: Final = 0.95
_ABOVE_NOISE: Final = 12.0
_HANN_LINE: Final = 0.25
_FINE: Final = 20.0
_SOFT_SIGN: Final = 0.02
_SLOW: Final = 0.05
_ONE_WAY: Final = 0.95
_ENDS: Final = 3.0
_ROW: Final = 1.5
_GRIP_S: Final = 0.2  # time in which a gripper takes or releases a part
_USUAL_SPEED: Final = 95.0
_COLUMNS: Final = (
    *("effort", "position", "speed", "acceleration", "direction", "stribeck", "free", "stroke"),
)


class Preparation(NamedTuple):
    """Filter and corrections of a unit's records, selected on its healthy records."""

    cutoff_hz: float
    """Cut-off frequency of the filter [Hz]."""
    lag_s: float
    """Lag of the effort behind the motion [s]."""
    usual_speed: float
    """95 % quantile of the speed [rad/s]."""
    ripples: tuple[float, ...] = ()
    """Wave numbers of the ripples of the effort along the position [1/rad]."""
    is_elastic: bool = False
    """Whether the effort depends on jerk and snap, because the gear is elastic."""
    unexpected_lag_s: float = 0.0
    """Part of the lag that the acquisition of the effort does not explain [s]."""
    samples_per_update: float = 1.0
    """Median number of samples per update of the position in the healthy records."""
    is_empty: bool = False
    """Whether only motion without a payload is used."""

    @property
    def highest_period(self) -> float:
        """Longest sample period for which the filter works [s]."""
        return HIGHEST_SHARE * _LEEWAY / self.cutoff_hz

    def block_means(self, telemetry: Telemetry, description: ActuatorDescription) -> "Fine":
        """Return the columns of a record as block means (`block_means`)."""
        return block_means(telemetry, description, self.cutoff_hz, is_empty=self.is_empty)


@dataclass(frozen=True)
class Signals:
    """Rows of a record in steady motion, away from reversals.

    Columns are ``(n,)`` unless their shape is given.
    """

    effort: Array
    """Effort [A]."""
    position: Array
    """Position of the user shaft [rad]."""
    speed: Array
    """Speed of the user shaft [rad/s]."""
    acceleration: Array
    """Acceleration of the user shaft [rad/s^2]."""
    direction: Array
    """Filtered sign of the speed [-]."""
    stribeck: Array
    """Filtered ``sign(v) exp(-(v / v_s)^2)``, ``(n, 3)``: a column for each speed v_s of
    ``STRIBECK_SPEEDS``."""
    free: Array
    """Terms of the preparation, with coefficients fitted to each record, ``(n, k)``: filtered sine
    and cosine of the position for each ripple; jerk [rad/s^3] and snap [rad/s^4] of an elastic
    joint."""
    stroke: NDArray[np.intp]
    """Stroke index of each row."""
    usual_speed: float
    """95 % quantile of the speed in this record [rad/s]."""
    rate: float
    """Rows per second of steady motion [1/s]."""

    def __len__(self) -> int:
        return len(self.effort)

    def pieces(self, direction: int) -> int:
        """Return the number of stroke pieces of at most 2 s in ``direction``, which is 1 or -1."""
        return len(self._numbers(direction))

    def strokes(self, direction: int) -> int:
        """Return the number of strokes in ``direction``, which is 1 or -1."""
        # Numbers of consecutive strokes differ by 2 or more, numbers of pieces of a stroke by 1.
        numbers = self._numbers(direction)
        return int(np.count_nonzero(np.diff(numbers) > 1)) + (len(numbers) > 0)

    def _numbers(self, direction: int) -> NDArray[np.intp]:
        return np.unique(self.stroke[np.sign(self.direction) == direction])

    def every_other_stroke(self) -> Flags:
        """Return flags of the rows in every other stroke of each direction, ``(n,)``.

        The chosen rows and the remaining rows contain strokes in both directions.
        """
        chosen = np.zeros(len(self), dtype=bool)
        for direction in (1.0, -1.0):
            rows = np.sign(self.direction) == direction
            _, number = np.unique(self.stroke[rows], return_inverse=True)
            chosen[rows] = number % 2 == 0
        return chosen

    def at(self, chosen: Flags) -> "Signals":
        """Return the rows whose flag in ``chosen``, ``(n,)``, is set."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in _COLUMNS})


def user_speed(telemetry: Telemetry, description: ActuatorDescription) -> Array | None:
    """Return the measured speed at the user shaft [rad/s]; None if it is not measured."""
    if not len(telemetry.speed) or not description.acquisition.speed:
        return None
    return telemetry.speed * description.parameters.tau


def acquisition_lag(description: ActuatorDescription) -> float:
    """Return the lag of the effort due to its acquisition [s]."""
    acquisition = description.acquisition
    if acquisition.current == "mean":
        return -0.5 * description.sample_period
    return acquisition.current_filter


def filter_sigma(cutoff_hz: float) -> float:
    """Return the standard deviation of the Gaussian filter for a cut-off frequency [s]."""
    return _SIGMA_CUTOFF / cutoff_hz


def motion_band(telemetry: Telemetry) -> float:
    """Return the frequency below which 95 % of the power of the speed lies [Hz].

    The noise of the position, estimated from the upper quarter of its spectrum, is subtracted.
    Spectral lines below twelve times the noise power are ignored; white noise exceeds this limit in
    one of 160,000 lines. Lines with an amplitude below the resolution of the position are ignored
    as well, because quantisation at a constant speed causes strong lines. If no line remains, the
    frequency is 0.
    """
    position = telemetry.position - np.mean(telemetry.position)
    n = len(position)
    window = np.hanning(n)
    trend = np.linspace(position[0], position[-1], n)
    power = np.abs(np.fft.rfft((position - trend) * window)) ** 2
    frequency = np.fft.rfftfreq(n, telemetry.sample_period)
    floor = float(np.median(power[3 * len(power) // 4 :])) / math.log(2.0)
    lost = telemetry.interpolated
    steps = np.abs(np.diff(telemetry.position))
    if len(lost):
        steps = steps[~(lost[1:] | lost[:-1])]
    resolution = float(np.min(steps[steps > 0.0], initial=math.inf))
    least = max(_ABOVE_NOISE * floor, (resolution * n * _HANN_LINE) ** 2)
    speed = np.where(power > least, power - floor, 0.0) * frequency**2
    total = np.cumsum(speed)
    if not total[-1] > 0.0:
        return 0.0
    return float(frequency[np.searchsorted(total, _POWER * total[-1])])


def cutoff_of(band_hz: float, sample_period: float) -> float:
    """Return the cut-off frequency of the filter for a motion of bandwidth ``band_hz`` [Hz]."""
    highest = HIGHEST_SHARE / sample_period
    return min(max(_OF_MOTION * band_hz, min(SLOWEST_CUTOFF_HZ, highest)), highest)


class Fine(NamedTuple):
    """Columns of a record as block means at a rate far above the cut-off, ``(n,)`` each.

    ``speed`` and ``command`` are None if they are not measured. ``is_usable`` is False in gaps
    longer than the standard deviation of the filter; shorter gaps are interpolated. If only motion
    without a payload is used, ``is_usable`` is also False while a payload is carried, and 0.2 s
    before and after. ``step_s`` is the length of a block [s]; the units are as in ``Signals``.
    """

    step_s: float
    effort: Array
    position: Array
    speed: Array | None
    command: Array | None
    is_usable: Flags


def block_means(
    telemetry: Telemetry,
    description: ActuatorDescription,
    cutoff_hz: float,
    *,
    is_empty: bool = False,
) -> Fine:
    """Return the columns of a record as block means, at about 20 blocks per cut-off period.

    Parameters
    ----------
    telemetry, description
        The record and its actuator.
    cutoff_hz
        Cut-off frequency of the filter [Hz].
    is_empty
        Whether only motion without a payload is used.
    """
    m = max(1, int(1.0 / (telemetry.sample_period * _FINE * cutoff_hz)))
    n = len(telemetry) // m

    def mean(column: Array) -> Array:
        return column[: n * m].reshape(n, m).mean(axis=1) if m > 1 else column

    speed = user_speed(telemetry, description)
    is_left_out = _long_gaps(telemetry, cutoff_hz)
    if is_empty:
        is_left_out |= _near_payload(telemetry)
    return Fine(
        m * telemetry.sample_period,
        mean(telemetry.current),
        mean(telemetry.position),
        None if speed is None else mean(speed),
        mean(telemetry.command) if telemetry.has_command else None,
        ~np.any(is_left_out[: n * m].reshape(n, m), axis=1),
    )


def _near_payload(telemetry: Telemetry) -> Flags:
    """Return flags of the samples while a payload is carried, and 0.2 s before and after, ``(n,)``.

    NaN is an unknown payload, and counts as a payload.
    """
    reach = math.ceil(_GRIP_S / telemetry.sample_period)
    is_held = np.pad(~(telemetry.payload <= 0.0), reach)
    count = np.concatenate([[0], np.cumsum(is_held)])
    return np.asarray(count[2 * reach + 1 :] > count[: -2 * reach - 1])


def _long_gaps(telemetry: Telemetry, cutoff_hz: float) -> Flags:
    """Return flags of the samples in gaps that are too long for the filter, ``(n,)``."""
    lost = telemetry.interpolated
    if not np.any(lost):
        return np.zeros(len(telemetry), dtype=bool)
    edges = np.diff(lost.astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    is_long = (ends - begins) * telemetry.sample_period > _SIGMA_CUTOFF / cutoff_hz
    in_long_gap = np.zeros(len(telemetry), dtype=bool)
    for begin, end in zip(begins[is_long], ends[is_long], strict=True):
        in_long_gap[begin:end] = True
    return in_long_gap


def filtered(fine: Fine, preparation: Preparation) -> Signals:
    """Return the filtered rows of steady motion in a record.

    Rows are excluded near reversals, where the filter mixes both directions, and within three
    standard deviations of the filter from the ends and from unusable blocks. One row is kept per
    1.5 standard deviations.
    """
    step = fine.step_s
    sigma = _SIGMA_CUTOFF / preparation.cutoff_hz / step
    time = step * np.arange(len(fine.position))
    rough = smoothed(fine.position, sigma / 3.0)
    if fine.speed is None:
        fine_speed = np.gradient(rough, step)
    else:
        fine_speed = smoothed(fine.speed, sigma / 3.0)
    usual = preparation.usual_speed
    sign = np.clip(fine_speed / (_SOFT_SIGN * usual), -1.0, 1.0)
    effort = fine.effort
    if preparation.lag_s:
        effort = np.interp(time + preparation.lag_s, time, effort)
    dips = np.exp(-((fine_speed[:, None] / (np.array(STRIBECK_SPEEDS) * usual)) ** 2))
    phases = [2.0 * math.pi * wave_number * fine.position for wave_number in preparation.ripples]
    waves = [of(phase) for phase in phases for of in (np.sin, np.cos)]
    columns = [effort, fine.position, sign, *(sign[:, None] * dips).T, *waves]
    if fine.speed is not None:
        columns.append(fine.speed)
    smooth = smoothed(np.array(columns), sigma)
    speed = smooth[-1] if fine.speed is not None else np.gradient(smooth[1], step)
    acceleration = np.gradient(speed, step)
    direction = smooth[2]
    moving = np.abs(speed) > _SLOW * usual
    keep = moving & (np.abs(direction) > _ONE_WAY)
    ends = math.ceil(_ENDS * sigma)
    keep[:ends] = keep[-ends:] = False
    # A gap does not divide a stroke.
    stroke = _strokes(np.sign(direction) * keep, step)
    if not np.all(fine.is_usable):
        keep &= np.convolve(~fine.is_usable, np.ones(2 * ends + 1), mode="same") < 0.5
    every = max(1, round(_ROW * sigma))
    rows = np.flatnonzero(keep)[::every] if every > 1 else np.flatnonzero(keep)
    speeds = np.abs(speed[keep])
    first_wave = 3 + len(STRIBECK_SPEEDS)
    free = [*smooth[first_wave : first_wave + len(waves)]]
    if preparation.is_elastic:
        jerk = np.gradient(acceleration, step)
        free += [jerk, np.gradient(jerk, step)]
    return Signals(
        smooth[0, rows],
        smooth[1, rows],
        speed[rows],
        acceleration[rows],
        direction[rows],
        smooth[3:first_wave, rows].T,
        np.array(free).reshape(len(free), len(time))[:, rows].T,
        stroke[rows],
        float(np.percentile(speeds, _USUAL_SPEED)) if len(speeds) else 0.0,
        1.0 / (every * step),
    )


def usual_speed(fine: Fine, cutoff_hz: float) -> float:
    """Return the 95 % quantile of the speed in a record's usable motion [rad/s]; 0 without any."""
    sigma = _SIGMA_CUTOFF / cutoff_hz / fine.step_s
    if fine.speed is None:
        speed = np.gradient(smoothed(fine.position, sigma), fine.step_s)
    else:
        speed = smoothed(fine.speed, sigma)
    speed = np.abs(speed[fine.is_usable])
    fastest = float(np.max(speed, initial=0.0))
    moving = speed[speed > _SLOW * fastest]
    return float(np.percentile(moving, _USUAL_SPEED)) if len(moving) else 0.0


def _strokes(direction: Array, step_s: float) -> NDArray[np.intp]:
    """Return the stroke index of each sample; long strokes are divided every 2 s."""
    begins = np.concatenate([[True], direction[1:] != direction[:-1]])
    first = np.flatnonzero(begins)
    within = np.arange(len(direction)) - first[np.cumsum(begins) - 1]
    piece = (within * (step_s / LONGEST_STROKE_S)).astype(np.intp)
    begins[1:] |= piece[1:] != piece[:-1]
    return np.cumsum(begins)
