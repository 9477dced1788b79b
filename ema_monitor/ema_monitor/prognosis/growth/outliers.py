"""Values that growth does not explain: held back, then confirmed or dropped by the next test."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS
from ema_monitor.prognosis.growth.kept import Kept
from ema_monitor.prognosis.growth.measurement import HEALTHY, Measurement
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings

REPAIR: Final = "repair"
STEP: Final = "step"
OUTLIER: Final = "outlier"

_AGREEMENT: Final = 4.0
_JUMP_SHARE: Final = 0.1
PATIENCE: Final = 4
"""Number of tests in a row after which the level of an odd component counts as changed."""


@dataclass(frozen=True)
class Event:
    """A value that growth does not explain."""

    kind: str
    """``"outlier"``: a value held back until the next test. If that test agrees, a ``"repair"``
    (smaller fault) or a ``"step"`` (larger fault) follows; else the value is never used."""
    component: str
    """Component of the fault vector."""
    hours: float
    """Service hour of the first test with the value [h]."""
    text: str
    """Description of the event."""


class OutlierDetector(Kept):
    """Classifies tests whose values growth does not explain.

    The first two tests that agree begin a life: if two tests disagree, either may be wrong. Later,
    a test with an odd value is held back as a whole, because a wrong estimate of a component
    corrupts the remaining components. If the next test agrees with it in all odd components, and no
    further component is odd, their level has changed. If the next test is as expected, the test
    held back is never used. A jump that two occasional errors could cause must show in three tests;
    until then it is no event, because such errors are frequent. A component that is odd in four
    tests in a row has also changed.
    """

    kept = ("_held", "_odd", "_agreed", "_patience")

    def __init__(self, settings: TrackerSettings) -> None:
        self._settings = settings
        # Rows of the tests held back: all before a life has begun, then the latest only.
        self._held = np.empty((0, 0))
        self._odd = np.zeros(len(COMPONENTS), dtype=bool)
        self._agreed = 0
        self._patience = 0

    def begin(self, measurement: Measurement) -> tuple[Measurement | None, list[Event]]:
        """Return the earlier test that begins a life with this test, or None; and events."""
        name, events = COMPONENTS, list[Event]()
        for earlier in map(Measurement.of_row, self._held):
            variance = earlier.noise + 2.0 * self._settings.occasional_error**2
            innovation = measurement.normalized_innovation(earlier.value, variance)
            odd = np.flatnonzero((innovation > self._settings.event_sigmas) & earlier.seen)
            if not odd.size:
                self._held = self._held[:0]
                return earlier, []
            was, now = HEALTHY + earlier.value, HEALTHY + measurement.value
            events = [
                Event(
                    OUTLIER,
                    name[i],
                    measurement.hours,
                    f"{name[i]} {was[i]:.3f} at {earlier.hours:.1f} h and {now[i]:.3f} at "
                    f"{measurement.hours:.1f} h disagree; waiting for the next test",
                )
                for i in odd
            ]
        self._held = np.array([*self._held, measurement.as_row()])
        return None, events

    def judge(
        self, measurement: Measurement, mean: Array, variance: Array, tests: NDArray[np.intp]
    ) -> tuple[list[Event], Flags, Flags]:
        """Return events, components whose level has changed, and components held back, ``(7,)``.

        Parameters
        ----------
        measurement
            The test.
        mean, variance
            Prediction of the test's signed distances from healthy, ``(7,)``.
        tests
            Number of tests used so far by component, ``(7,)``; an outlier needs two.
        """
        innovation = measurement.normalized_innovation(mean, variance)
        odd = (innovation > self._settings.event_sigmas) & (tests >= 2)
        changed, since = np.zeros_like(odd), measurement.hours
        reach = np.sqrt(measurement.noise + variance + self._settings.occasional_error**2)
        large = np.abs(measurement.value - mean) > _AGREEMENT * reach
        for held in map(Measurement.of_row, self._held):
            since = held.hours
            # Uncertainty of growth increases with time: an odd value may be within bounds later.
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
        # A test that confirms an earlier change is used, except for its remaining odd values.
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
) -> Event:
    name = COMPONENTS[number]
    was, now = HEALTHY[number] + mean[number], HEALTHY[number] + measurement.value[number]
    if not changed:
        return Event(
            OUTLIER,
            name,
            measurement.hours,
            f"{name} {now:.3f} at {measurement.hours:.1f} h where {was:.3f} ± "
            f"{np.sqrt(variance[number]):.3f} was expected; held back until the next test",
        )
    smaller = abs(measurement.value[number]) < abs(mean[number])
    kind, verb = (REPAIR, "fell") if smaller else (STEP, "rose")
    return Event(
        kind, name, since, f"{name} {verb} from {was:.3f} to {now:.3f}, confirmed by the next test"
    )
