# SPDX-License-Identifier: Apache-2.0
"""Conversion of temperatures to the measured cause ``winding_temperature``."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.conversion import degrees_celsius
from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.input_defect import InputDefect, OutOfRange
from ema_bags.inputs.mapping import TemperatureSource
from ema_bags.inputs.series import NO_STAMP
from ema_core.causes import CAUSE_BY_NAME, CauseEstimate

CAUSE: Final = "winding_temperature"
"""Name of the measured cause that represents the temperature."""

REFERENCE_DEGC: Final = 20.0
"""Temperature at which the rise is zero [degC]."""

_SIGMA: Final = 2.0  # of a temperature sensor at the motor [K]
_SECOND_NS: Final = 1_000_000_000
_HOLDS_BEFORE_NS: Final = 10 * _SECOND_NS


class MeasuredRise(NamedTuple):
    """Temperature rise above ``REFERENCE_DEGC`` at a time."""

    stamp_ns: int
    """Time of the measurement [ns]."""
    rise: float
    """Temperature rise [K]."""

    @property
    def cause(self) -> CauseEstimate:
        """The rise as an estimate of the cause ``winding_temperature``."""
        return CauseEstimate(CAUSE, self.rise, _SIGMA)


class RiseSampler:
    """Samples the temperature once per second.

    Attributes
    ----------
    impossible
        Most extreme out-of-range temperature in the latest block [degC]; None if all are in range.
        Out-of-range samples are ignored.
    """

    def __init__(self, source: TemperatureSource) -> None:
        self.impossible: float | None = None
        self._source = source
        self._second = NO_STAMP
        self._rises: list[MeasuredRise] = []

    def push(self, stamps_ns: NDArray[np.int64], raw: NDArray[np.float64]) -> None:
        """Add stamps [ns] and source values of the next samples, both ``(n,)``."""
        celsius = degrees_celsius(raw, self._source)
        rises = celsius - REFERENCE_DEGC
        cause = CAUSE_BY_NAME[CAUSE]
        is_possible = (rises >= cause.lowest) & (rises <= cause.highest)
        wrong = celsius[np.isfinite(celsius) & ~is_possible]
        self.impossible = float(wrong[np.argmax(np.abs(wrong))]) if len(wrong) else None
        rows = np.flatnonzero(is_possible)
        seconds = stamps_ns[rows] // _SECOND_NS
        first = rows[np.diff(seconds, prepend=np.int64(self._second)) != 0]
        if len(rows):
            self._second = int(seconds[-1])
        self._rises += map(MeasuredRise, stamps_ns[first].tolist(), rises[first].tolist())

    def take(self) -> list[MeasuredRise]:
        """Return the temperature rises sampled since the previous call."""
        rises, self._rises = self._rises, []
        return rises

    def defects(self) -> Iterator[InputDefect]:
        """Yield a defect if a temperature is out of range, which suggests a wrong unit."""
        if self.impossible is not None:
            cause = CAUSE_BY_NAME[CAUSE]
            lowest, highest = REFERENCE_DEGC + cause.lowest, REFERENCE_DEGC + cause.highest
            unit = "K" if self._source.unit != "K" else "degC"
            evidence = OutOfRange(self.impossible, lowest, highest, unit)
            yield InputDefect(DefectKind.TEMPERATURE_RANGE, evidence, is_certain=False)


def held_from(first_ns: int, rises: list[MeasuredRise]) -> list[MeasuredRise]:
    """Return the rises, preceded by a copy of the first one at the start of the telemetry.

    ``first_ns`` is the stamp of the first sample of the telemetry [ns]. The copy is added only if
    that sample precedes the first rise by at most 10 s.

    A sensor that is read every few seconds may have no value at the start of the telemetry.
    """
    if not rises or not 0 < rises[0].stamp_ns - first_ns <= _HOLDS_BEFORE_NS:
        return rises
    return [rises[0]._replace(stamp_ns=first_ns), *rises]
