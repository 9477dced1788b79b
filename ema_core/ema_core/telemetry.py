# SPDX-License-Identifier: Apache-2.0
"""Telemetry of an actuator in contiguous columns."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_core.quantity import is_finite_number

COLUMNS = ("command", "current", "position", "speed")
"""Columns of telemetry, in the order of the messages."""

OPTIONAL = ("command", "current", "speed")
"""Columns that may be empty, if they are not measured."""

SERIES = (*COLUMNS, "payload")
"""Fields of telemetry with numbers per sample: the columns, and the payload."""

PERIODS = (1e-9, 1.0)
"""Shortest and longest permitted sample period [s]."""

PAUSE_S: Final = 1.0
"""Longest gap whose samples count as lost [s]; longer gaps are pauses."""

_NO_SAMPLES: Final = np.zeros(0, dtype=bool)
_NO_NUMBERS: Final = np.zeros(0)


@dataclass(frozen=True, eq=False)
class Telemetry:
    """Consecutive samples at a fixed period.

    Sample i covers ((i-1) h, i h]: current is its mean over that interval, unless the description
    of the actuator defines another acquisition (`ema_core.acquisition`); the remaining columns are
    values at its end. The column of a quantity that is not measured is empty. The position is
    always present.

    Raises
    ------
    ValueError
        If the columns differ in length, the position is empty, or the period is outside
        ``PERIODS``.
    """

    stamp_ns: int
    """Time of the END of the first sample [ns]."""
    sample_period: float
    """Period h [s]."""
    first_index: int
    """Running index of the first sample."""
    command: NDArray[np.float64]
    """Commanded angle of the user shaft, ``(n,)`` [rad], or ``(0,)`` without a position command."""
    current: NDArray[np.float64]
    """Equivalent current, ``(n,)`` [A], or ``(0,)`` if it is not measured."""
    position: NDArray[np.float64]
    """Angle of the user shaft, measured after the backlash, ``(n,)`` [rad]."""
    speed: NDArray[np.float64]
    """Speed of the motor shaft, ``(n,)`` [rad/s], or ``(0,)`` if it is not measured."""
    interpolated: NDArray[Any] = field(default_factory=_NO_SAMPLES.copy)
    """Whether each sample was lost and interpolated (`bridged`), ``(n,)``, or ``(0,)`` if all
    samples were measured."""
    payload: NDArray[np.float64] = field(default_factory=_NO_NUMBERS.copy)
    """Mass of the payload that the machine carries, ``(n,)`` [kg]; 0 while it carries none. If the
    mass is not measured, any positive number stands for a payload. ``(0,)`` if unknown."""

    def __post_init__(self) -> None:
        check_period(self.sample_period)
        n = len(self.position)
        lengths = {name: len(getattr(self, name)) for name in SERIES}
        if not n or not {0, n}.issuperset((*lengths.values(), len(self.interpolated))):
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ValueError(
                f"telemetry columns must have the same length of at least 1, not {listed}; only "
                f"{', '.join((*OPTIONAL, 'payload'))} may be empty, if they are not measured"
            )

    def __len__(self) -> int:
        return len(self.position)

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the columns that are not measured."""
        return tuple(name for name in OPTIONAL if not len(getattr(self, name)))

    @property
    def has_command(self) -> bool:
        """Whether there is a position command; drives commanded by speed or torque have none."""
        return len(self.command) > 0

    @property
    def has_payload(self) -> bool:
        """Whether the column ``payload`` is present."""
        return len(self.payload) > 0

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """End time of each sample, ``(n,)`` [ns]."""
        steps = np.arange(len(self), dtype=np.int64)
        return self.stamp_ns + elapsed_ns(self.sample_period, self.first_index, steps)

    def stamp_at(self, sample: int) -> int:
        """Return the end time [ns] of the sample with index ``sample``, from 0."""
        return self.stamp_ns + elapsed_ns(self.sample_period, self.first_index, sample)

    def part(self, start: int, stop: int) -> "Telemetry":
        """Return samples ``start`` to ``stop`` (exclusive) as telemetry.

        Raises
        ------
        ValueError
            If the range is empty or not within the telemetry.
        """
        if not 0 <= start < stop <= len(self):
            raise ValueError(
                f"samples {start} to {stop} are out of range: there are {len(self)} samples"
            )
        return Telemetry(
            self.stamp_at(start),
            self.sample_period,
            self.first_index + start,
            **{name: getattr(self, name)[start:stop] for name in SERIES},
            interpolated=self.interpolated[start:stop],
        )


def check_period(sample_period: float) -> None:
    """Raise ``ValueError`` for a sample period that is NaN or outside ``PERIODS`` [s]."""
    shortest, longest = PERIODS
    if not is_finite_number(sample_period) or not shortest <= sample_period <= longest:
        raise ValueError(
            f"sample_period = {sample_period!r}: expected {shortest:g} to {longest:g} [s]"
        )


def elapsed_ns(sample_period: float, first_index: int, samples: Any) -> Any:
    """Return the times from the end of a sample to the ends of later samples [ns].

    The sample with running index i ends i periods after a common origin, rounded to the nearest
    nanosecond. Integer arithmetic gives a sample the same timestamp in every part of the telemetry.

    Parameters
    ----------
    sample_period
        Sample period [s].
    first_index
        Running index of the sample from which the time is counted.
    samples
        Sample offsets from ``first_index``: an integer or an integer array.
    """
    whole, over, per = _period_ns(sample_period)
    before = (first_index * over + per // 2) % per
    return samples * whole + (before + samples * over) // per


@lru_cache
def _period_ns(sample_period: float) -> tuple[int, int, int]:
    """Return a sample period as ``(whole, over, per)``, for ``whole + over / per`` nanoseconds.

    The result is exact for rates of whole hertz up to 1 MHz. The float period is not: at 48 kHz its
    error would reach a nanosecond within days.
    """
    period = (Fraction(sample_period) * 1_000_000_000).limit_denominator(1_000_000)
    whole, over = divmod(period.numerator, period.denominator)
    return whole, over, period.denominator


def join(blocks: list[Telemetry]) -> Telemetry:
    """Return one block, concatenated from at least one contiguous block."""
    first = blocks[0]
    interpolated = _NO_SAMPLES
    if any(len(block.interpolated) for block in blocks):
        interpolated = np.concatenate(
            [
                block.interpolated if len(block.interpolated) else np.zeros(len(block), dtype=bool)
                for block in blocks
            ]
        )
    return Telemetry(
        first.stamp_ns,
        first.sample_period,
        first.first_index,
        **{name: np.concatenate([getattr(block, name) for block in blocks]) for name in SERIES},
        interpolated=interpolated,
    )


def lost_between(last: Telemetry, block: Telemetry) -> Telemetry | None:
    """Return the samples lost between two blocks, interpolated linearly, or None.

    The payload is constant, as before the gap. The result is None if no sample is missing, or
    interpolation is impossible: the gap exceeds ``PAUSE_S``, the blocks differ in period or
    measured columns, or the timestamps contradict the number of samples.
    """
    h, begin = last.sample_period, last.first_index + len(last)
    count = block.first_index - begin
    if not 0 < count * h <= PAUSE_S or abs(block.sample_period / h - 1.0) > 1e-6:
        return None
    elapsed_s = 1e-9 * (block.stamp_ns - last.stamp_at(len(last) - 1))
    has_others = (block.missing, block.has_payload) != (last.missing, last.has_payload)
    if has_others or not h / 2.0 < elapsed_s < (2 * count + 1) * h:
        return None
    part = np.arange(1, count + 1) / (count + 1)
    columns = [
        before[-1] + part * (after[0] - before[-1]) if len(before) else before
        for before, after in ((getattr(last, name), getattr(block, name)) for name in COLUMNS)
    ]
    stamp_ns = last.stamp_at(len(last))
    return Telemetry(
        stamp_ns,
        h,
        begin,
        *columns,
        interpolated=np.ones(count, dtype=bool),
        payload=np.repeat(last.payload[-1:], count),
    )


def bridged(blocks: Iterable[Telemetry]) -> Iterator[Telemetry]:
    """Yield the blocks, and between them blocks with the interpolated lost samples.

    `lost_between` interpolates the samples.
    """
    last: Telemetry | None = None
    for block in blocks:
        lost = None if last is None else lost_between(last, block)
        if lost is not None:
            yield lost
        yield block
        last = block


def excerpt(
    blocks: Iterable[Telemetry], start: int, stop: int, omitted: Sequence[range] = ()
) -> Telemetry:
    """Return the samples from ``start`` to ``stop`` (exclusive) as one block.

    Parameters
    ----------
    blocks
        Telemetry in ascending order; blocks outside the range may be missing.
    start, stop
        Running indices of the range.
    omitted
        Ranges of running indices within it to leave out, in ascending order. The result is
        timestamped as if its samples were contiguous.
    """
    begins = [start, *(item.stop for item in omitted)]
    ends = [*(item.start for item in omitted), stop]
    pieces: list[Telemetry] = []
    for block in blocks:
        first, after = block.first_index, block.first_index + len(block)
        pieces += [
            block.part(max(begin, first) - first, min(end, after) - first)
            for begin, end in zip(begins, ends, strict=True)
            if max(begin, first) < min(end, after)
        ]
    return join(pieces)
