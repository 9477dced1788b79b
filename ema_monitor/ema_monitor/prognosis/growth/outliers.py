# SPDX-License-Identifier: Apache-2.0
"""Detection of outliers, repairs and steps: abrupt changes that growth does not explain."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS
from ema_monitor.prognosis.events import ValueChanged, ValuesDisagree, ValueUnexpected
from ema_monitor.prognosis.growth.kept import Kept
from ema_monitor.prognosis.growth.measurement import HEALTHY, Measurement
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings

_AGREEMENT: Final = 4.0
_JUMP_SHARE: Final = 0.1
PATIENCE: Final = 4
"""Number of consecutive tests with an unexpected value of a component after which its level is
considered changed."""


GrowthEvent = ValuesDisagree | ValueUnexpected | ValueChanged
"""A measured value that growth does not explain."""


class OutlierDetector(Kept):
    """Detects and classifies values that growth does not explain.

    Tracking starts with the first two tests that agree: of two disagreeing tests, either may be
    wrong. Later, a test with an unexpected value is held back as a whole, because a wrong estimate
    of one component corrupts the others.

    If the next test agrees in all unexpected components, and no other component is unexpected,
    their levels have changed. If the next test is as expected, the held test is discarded. A jump
    small enough to be caused by two occasional errors must appear in three tests and raises no
    event before that. A component that is unexpected in four consecutive tests has changed as well.
    """

    kept = ("_held", "_odd", "_agreed", "_patience")

    def __init__(self, settings: TrackerSettings) -> None:
        self._settings = settings
        # Held tests as rows: all tests before tracking starts, later only the latest.
        self._held = np.empty((0, 0))
        self._odd = np.zeros(len(COMPONENTS), dtype=bool)
        self._agreed = 0
        self._patience = 0

    def begin(self, measurement: Measurement) -> tuple[Measurement | None, list[GrowthEvent]]:
        """Return the first held test that agrees with this test (or None), and the events.

        If no held test agrees, this test is held as well.
        """
        events: list[GrowthEvent] = []
        for earlier in map(Measurement.of_row, self._held):
            variance = earlier.noise + 2.0 * self._settings.occasional_error**2
            innovation = measurement.normalized_innovation(earlier.value, variance)
            odd = np.flatnonzero((innovation > self._settings.event_sigmas) & earlier.seen)
            if not odd.size:
                self._held = self._held[:0]
                return earlier, []
            was, now = HEALTHY + earlier.value, HEALTHY + measurement.value
            events = [
                ValuesDisagree(
                    COMPONENTS[i], float(was[i]), earlier.hours, float(now[i]), measurement.hours
                )
                for i in odd
            ]
        self._held = np.array([*self._held, measurement.as_row()])
        return None, events

    def judge(
        self, measurement: Measurement, mean: Array, variance: Array, tests: NDArray[np.intp]
    ) -> tuple[list[GrowthEvent], Flags, Flags]:
        """Return events and two masks, ``(7,)``: components that changed, and components held back.

        Parameters
        ----------
        measurement
            The test.
        mean, variance
            Predicted mean and variance of the signed distances from healthy, ``(7,)`` each.
        tests
            Number of tests used so far per component, ``(7,)``; detection needs at least two.
        """
        innovation = measurement.normalized_innovation(mean, variance)
        odd = (innovation > self._settings.event_sigmas) & (tests >= 2)
        changed, since = np.zeros_like(odd), measurement.hours
        reach = np.sqrt(measurement.noise + variance + self._settings.occasional_error**2)
        large = np.abs(measurement.value - mean) > _AGREEMENT * reach
        for held in map(Measurement.of_row, self._held):
            since = held.hours
            # Prediction uncertainty grows with time, so an unexpected value may fall within bounds
            # later.
            agrees = self._agrees(measurement, held, mean)[self._odd].all()
            self._agreed = self._agreed + 1 if agrees and not (odd & ~self._odd).any() else 0
            is_long = self._patience >= PATIENCE - 1
            changed = odd & self._odd & (is_long | (self._agreed >= np.where(large, 1, 2)))
        events = [
            _event(int(number), measurement, mean, variance, changed[number], since)
            for number in np.flatnonzero(odd & (large | changed))
        ]
        left = odd & ~changed
        if left.any():
            self._held, self._odd = measurement.as_row()[None], left
            self._patience += 1
        else:
            self._held, self._patience, self._agreed = self._held[:0], 0, 0
        # A test that confirms a change is used, except for its other unexpected values.
        held_back = left if changed.any() else np.full_like(odd, left.any())
        return events, changed, held_back

    def _agrees(self, measurement: Measurement, held: Measurement, mean: Array) -> Flags:
        occasional = self._settings.occasional_error**2
        tolerance = _AGREEMENT * np.sqrt(measurement.noise + held.noise + occasional)
        jump = np.abs(held.value - mean)
        same_way = np.sign(measurement.value - mean) == np.sign(held.value - mean)
        apart = np.abs(measurement.value - held.value)
        return same_way & (apart < np.maximum(tolerance, _JUMP_SHARE * jump))


def _event(
    number: int, measurement: Measurement, mean: Array, variance: Array, changed: bool, since: float
) -> GrowthEvent:
    name = COMPONENTS[number]
    expected = float(HEALTHY[number] + mean[number])
    value = float(HEALTHY[number] + measurement.value[number])
    if not changed:
        sigma = math.sqrt(variance[number])
        return ValueUnexpected(name, value, measurement.hours, expected, sigma)
    is_smaller = bool(abs(measurement.value[number]) < abs(mean[number]))
    return ValueChanged(name, expected, value, since, is_smaller)
