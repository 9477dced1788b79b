"""Values that growth does not explain: held back, then confirmed or dropped by the next test."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS
from ema_monitor.prognosis.growth.measurement import HEALTHY, Measurement
from ema_monitor.prognosis.growth.settings import TrackerSettings

REPAIR: Final = "repair"
STEP: Final = "step"
OUTLIER: Final = "outlier"


@dataclass(frozen=True)
class Event:
    """Something that growth does not explain.

    Attributes
    ----------
    kind
        ``"outlier"``: a value that no growth explains, held back until the next test. When that
        test agrees with it, a ``"repair"`` (the fault became smaller) or a ``"step"`` (it became
        larger) follows; else it stays an outlier and is never used. ``"regime"``: the fault grows
        at another rate from about that hour on.
    component
        Component of the fault vector.
    hours
        Service hour at which it was first seen [h].
    text
        What was seen, in words.
    """

    kind: str
    component: str
    hours: float
    text: str


_AGREEMENT: Final = 4.0
_JUMP_SHARE: Final = 0.1
_PATIENCE: Final = 4


class OutlierDetector:
    """Decides what a test means whose values growth does not explain.

    A test with such a value is held back as a whole, for what falsifies one component's estimate
    falsifies the others. If the next test is off in the same components and agrees with it in all
    of them, their level has changed; if it is as expected, the test held back is never used. A
    jump that two errors of the occasional size can feign must show in three tests, and before that
    is no event, for such errors are frequent. Whatever is off in four tests in a row has changed
    as well.
    """

    def __init__(self, settings: TrackerSettings) -> None:
        self._settings = settings
        self._held: Measurement | None = None
        self._odd = np.zeros(len(COMPONENTS), dtype=bool)
        self._agreed = 0
        self._patience = 0

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return all that is known, for ``restore``."""
        held = [] if self._held is None else [self._held.as_row()]
        return {
            "held": np.array(held),
            "odd": self._odd,
            "agreed": np.array([self._agreed, self._patience]),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what ``state`` returned."""
        self._held = Measurement.of_row(state["held"][0]) if len(state["held"]) else None
        self._odd = state["odd"]
        self._agreed, self._patience = map(int, state["agreed"])

    def judge(
        self,
        measurement: Measurement,
        mean: NDArray[np.float64],
        variance: NDArray[np.float64],
        tests: NDArray[np.intp],
    ) -> tuple[list[Event], NDArray[np.bool_], NDArray[np.bool_]]:
        """Return events, components whose level has changed, and components held back, ``(7,)``.

        Parameters
        ----------
        measurement
            The test.
        mean, variance
            Its prediction.
        tests
            Number of tests used so far, by component; one alone is too few for an outlier.
        """
        innovation = measurement.normalized_innovation(mean, variance)
        odd = (innovation > self._settings.event_sigmas) & (tests >= 2)
        changed = np.zeros_like(odd)
        events: list[Event] = []
        since = measurement.hours
        reach = np.sqrt(measurement.noise + variance + self._settings.occasional_error**2)
        large = np.abs(measurement.value - mean) > _AGREEMENT * reach
        if self._held is not None:
            since = self._held.hours
            again = odd & self._odd
            agrees = self._agrees(measurement, self._held, mean)[odd].all()
            self._agreed = self._agreed + 1 if np.array_equal(odd, self._odd) and agrees else 0
            is_long = self._patience >= _PATIENCE - 1
            changed = again & (is_long | (self._agreed >= np.where(large, 1, 2)))
        for number in np.flatnonzero(odd & (large | changed)):
            events.append(_event(int(number), measurement, mean, variance, changed[number], since))
        left = odd & ~changed
        if left.any():
            self._held, self._odd = measurement, left
            self._patience += 1
        else:
            self._held, self._patience = None, 0
            self._agreed = 0
        # A test is used but for its odd values if it confirms one before.
        held = left if changed.any() else np.full_like(odd, left.any())
        return events, changed, held

    def _agrees(
        self, one: Measurement, other: Measurement, mean: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        tolerance = _AGREEMENT * np.sqrt(
            one.noise + other.noise + self._settings.occasional_error**2
        )
        jump = np.abs(other.value - mean)
        same_way = np.sign(one.value - mean) == np.sign(other.value - mean)
        apart = np.abs(one.value - other.value)
        return same_way & (apart < np.maximum(tolerance, _JUMP_SHARE * jump))


class Opening:
    """Finds the first two tests that agree, for either of two that do not may be wrong."""

    def __init__(self, settings: TrackerSettings) -> None:
        self._settings = settings
        self._waiting: list[Measurement] = []

    def state(self) -> NDArray[np.float64]:
        """Return the tests that wait, for ``restore``."""
        return np.array([one.as_row() for one in self._waiting])

    def restore(self, rows: NDArray[np.float64]) -> None:
        """Go on from what ``state`` returned."""
        self._waiting = [Measurement.of_row(row) for row in rows]

    def judge(self, measurement: Measurement) -> tuple[Measurement | None, list[Event]]:
        """Return the earlier test that agrees with this one, if there is one, and events."""
        events: list[Event] = []
        for earlier in self._waiting:
            variance = earlier.noise + 2.0 * self._settings.occasional_error**2
            innovation = np.where(
                earlier.seen, measurement.normalized_innovation(earlier.value, variance), 0.0
            )
            odd = np.flatnonzero(innovation > self._settings.event_sigmas)
            if not odd.size:
                return earlier, []
            events = [
                Event(
                    OUTLIER,
                    COMPONENTS[i],
                    measurement.hours,
                    f"{COMPONENTS[i]} {HEALTHY[i] + earlier.value[i]:.3f} at {earlier.hours:.1f} h "
                    f"and {HEALTHY[i] + measurement.value[i]:.3f} at {measurement.hours:.1f} h "
                    "disagree; waiting for the next test",
                )
                for i in odd
            ]
        self._waiting.append(measurement)
        return None, events


def _event(
    number: int,
    measurement: Measurement,
    mean: NDArray[np.float64],
    variance: NDArray[np.float64],
    changed: bool,
    since: float,
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
