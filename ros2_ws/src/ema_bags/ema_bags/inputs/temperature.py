"""Conversion of measured temperatures to the measured cause ``winding_temperature``."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.conversion import degrees_celsius
from ema_bags.inputs.input_defect import InputDefect
from ema_bags.inputs.mapping import TemperatureSource
from ema_bags.inputs.series import NO_STAMP
from ema_core.causes import CAUSE_BY_NAME, CauseEstimate

CAUSE: Final = "winding_temperature"
"""Measured cause that carries the temperature."""

REFERENCE_DEGC: Final = 20.0
"""Reference temperature of rises [degC]."""

_SIGMA: Final = 2.0  # of a sensor at the motor [K]
_SECOND_NS: Final = 1_000_000_000
_HOLDS_BEFORE_NS: Final = 10 * _SECOND_NS


class MeasuredRise(NamedTuple):
    """Rise of the temperature over ``REFERENCE_DEGC`` [K] at a stamp [ns]."""

    stamp_ns: int
    rise: float

    @property
    def cause(self) -> CauseEstimate:
        """The measured cause."""
        return CauseEstimate(CAUSE, self.rise, _SIGMA)


class RiseSampler:
    """Samples the first measured temperature of each second.

    Attributes
    ----------
    impossible
        Largest temperature outside the range of the cause in the latest samples [degC]; None
        without one. Such samples are ignored.
    """

    def __init__(self, source: TemperatureSource) -> None:
        self.impossible: float | None = None
        self._source = source
        self._second = NO_STAMP
        self._rises: list[MeasuredRise] = []

    def push(self, stamps_ns: NDArray[np.int64], raw: NDArray[np.float64]) -> None:
        """Add stamps [ns] and source values of the next samples, ``(n,)`` each."""
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
        """Return the rises measured since the previous call."""
        rises, self._rises = self._rises, []
        return rises

    def defects(self) -> Iterator[InputDefect]:
        """Yield a defect if a temperature is impossible, which indicates a wrong unit."""
        if self.impossible is not None:
            cause = CAUSE_BY_NAME[CAUSE]
            lowest, highest = REFERENCE_DEGC + cause.lowest, REFERENCE_DEGC + cause.highest
            text = (
                f"a temperature of {self.impossible:.4g} degC, expected {lowest:g} to {highest:g}"
            )
            unit = "K" if self._source.unit != "K" else "degC"
            remedy = f"temperature: {{unit: {unit}}}, if that is its unit; else it is left out"
            yield InputDefect("temperature_range", text, remedy, is_certain=False)


def held_from(first_ns: int, rises: list[MeasuredRise]) -> list[MeasuredRise]:
    """Return rises with the first rise moved to the first sample [ns], by at most 10 s.

    A sensor that is read every few seconds has no value yet at the start of the telemetry.
    """
    if not rises or not 0 < rises[0].stamp_ns - first_ns <= _HOLDS_BEFORE_NS:
        return rises
    return [rises[0]._replace(stamp_ns=first_ns), *rises]
