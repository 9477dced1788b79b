"""Telemetry of any length as the outline that a picture shows."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.telemetry import COLUMNS, Telemetry

BINS: Final = 8192
"""Steps of time in an outline: several for each dot of a picture."""


class Outline:
    """Least and greatest value of each column in equal steps of time, at most ``BINS`` of them.

    The steps begin as two samples and double whenever there are too many. What is earlier than the
    first sample is left out.
    """

    def __init__(self) -> None:
        self._start_ns = 0
        self._step_ns = 0.0
        self._low = np.full((BINS, len(COLUMNS)), np.nan)
        self._high = self._low.copy()

    def add(self, block: Telemetry) -> None:
        """Add telemetry."""
        stamps_ns = block.stamps_ns
        if not self._step_ns:
            self._start_ns, self._step_ns = block.stamp_ns, 2e9 * block.sample_period
        rows = np.full((len(block), len(COLUMNS)), np.nan)
        for number, name in enumerate(COLUMNS):
            if name not in block.missing:
                rows[:, number] = getattr(block, name)
        rows[~np.isfinite(rows)] = np.nan
        # A quarter of the first step later, so that rounded stamps do not fall into the one before.
        late_ns = stamps_ns - (self._start_ns - 0.5e9 * block.sample_period)
        while late_ns[-1] >= BINS * self._step_ns:
            self._double()
        steps = late_ns / self._step_ns
        here = steps >= 0.0
        bins = steps[here].astype(np.intp)
        np.fmin.at(self._low, bins, rows[here])
        np.fmax.at(self._high, bins, rows[here])

    def lines(self, name: str, first_ns: int) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Return a column as a line to draw: times ``(n,)`` [s] and values ``(n,)``.

        It is broken, by NaN, where there is no telemetry.
        """
        column = COLUMNS.index(name)
        values = np.stack([self._low[:, column], self._high[:, column]], axis=1)
        steps = np.arange(BINS)[:, None] + np.array([0.0, 0.5])
        times = 1e-9 * (steps * self._step_ns + (self._start_ns - first_ns))
        return np.ravel(times), np.ravel(values)

    def _double(self) -> None:
        self._step_ns *= 2.0
        for values, pick in ((self._low, np.fmin), (self._high, np.fmax)):
            values[: BINS // 2] = pick(values[0::2], values[1::2])
            values[BINS // 2 :] = np.nan
