"""Telemetry of an actuator in contiguous columns."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

COLUMNS = ("command", "current", "position", "speed")
"""Columns of telemetry, in the order of the messages."""

PERIODS = (1e-9, 1.0)
"""Shortest and longest sample period that counts as telemetry [s]."""


@dataclass(frozen=True, eq=False)
class Telemetry:
    """Consecutive samples at a fixed period.

    Sample i covers ((i-1) h, i h]: current is its mean over that interval, the other columns are
    the values at its end.

    Attributes
    ----------
    stamp_ns
        Time of the END of the first sample [ns].
    sample_period
        Period h [s].
    first_index
        Running index of the first sample.
    command, position
        Angle of the user shaft, ``(n,)`` [rad]; position is taken after the backlash.
    current
        Equivalent current, ``(n,)`` [A].
    speed
        Speed of the motor shaft, ``(n,)`` [rad/s].

    Raises
    ------
    ValueError
        When the columns differ in length or are empty, or the period is outside ``PERIODS``.
    """

    stamp_ns: int
    sample_period: float
    first_index: int
    command: NDArray[np.float64]
    current: NDArray[np.float64]
    position: NDArray[np.float64]
    speed: NDArray[np.float64]

    def __post_init__(self) -> None:
        shortest, longest = PERIODS
        if not shortest <= self.sample_period <= longest:
            raise ValueError(
                f"sample_period = {self.sample_period!r} s is outside [{shortest:g}, {longest:g}] s"
            )
        lengths = {name: len(getattr(self, name)) for name in COLUMNS}
        if len(set(lengths.values())) != 1 or not len(self.command):
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ValueError(f"telemetry columns must have one length of at least 1, not {listed}")

    def __len__(self) -> int:
        return len(self.command)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Time of the end of every sample, ``(n,)`` [ns]."""
        steps = np.arange(len(self)) * (self.sample_period * 1e9)
        return self.stamp_ns + np.rint(steps).astype(np.int64)

    def stamp_at(self, sample: int) -> int:
        """Return the time of the end of one sample, counted from 0 [ns]."""
        return self.stamp_ns + round(sample * self.sample_period * 1e9)

    def part(self, start: int, stop: int) -> "Telemetry":
        """Return samples ``start`` to ``stop`` (exclusive) with their own stamp and index.

        Raises
        ------
        ValueError
            When there is no such part, or nothing in it.
        """
        if not 0 <= start < stop <= len(self):
            raise ValueError(f"samples {start} to {stop} are no part of {len(self)} samples")
        return Telemetry(
            self.stamp_at(start),
            self.sample_period,
            self.first_index + start,
            *(getattr(self, name)[start:stop] for name in COLUMNS),
        )


def join(blocks: list[Telemetry]) -> Telemetry:
    """Return consecutive blocks as one.

    Parameters
    ----------
    blocks
        At least one block, each beginning where the one before ends.
    """
    first = blocks[0]
    return Telemetry(
        first.stamp_ns,
        first.sample_period,
        first.first_index,
        *(np.concatenate([getattr(block, name) for block in blocks]) for name in COLUMNS),
    )
