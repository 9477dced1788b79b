"""Filters for faults that another fault drives: their rate is in proportion to its level.

Play lets the gears hit each other and wears what rubs; friction loads what has play; an eccentric
rotor pulls on its bearings, and worn bearings let it become more eccentric. The state of each
filter is level x, rate a of its own, and the coupling c, and dx/du = a + c y with the level y of
the driver, as all that is known of that follows it. Both faults may drive each other. Given y the
growth is linear in a and c, so that each is a Kalman filter; there is one for each driver of a
component and each coupling of a grid. P6d of docs/prognosis.md.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.linear_filters import LinearFilters
from ema_monitor.prognosis.growth.settings import TrackerSettings

DRIVERS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "friction": ("backlash", "eccentricity"),
        "backlash": ("friction",),
        "eccentricity": ("friction",),
    }
)
"""Faults that may drive each fault."""

_LIVES: Final = np.geomspace(125.0, 4000.0, 6)
"""Hours in which a driver at its limit takes what it drives from healthy to its own [h]."""

_SPREAD: Final = 0.4
"""Standard deviation of a coupling over that of its filter [-]."""

_OWN_LIFE: Final = 3000.0
"""Hours to the limit at one standard deviation of the rate of its own [h]."""

_DRIVERS_MOST: Final = max(map(len, DRIVERS.values()))


class Driven(LinearFilters):
    """Filters of driven faults: states are x, a and c, a test measures x.

    Parameters
    ----------
    limits
        Where life ends.
    settings
        Noise and probabilities; a component of known law is not driven.

    Attributes
    ----------
    driver
        Number of the component that drives each filter, ``(7, k)``; its own where there is none.
    level
        Level of each component as its tests have it, 0 until one shows it, ``(7,)`` [-].
    shown
        Components that a test has shown, ``(7,)``: the others are taken for healthy drivers.
    """

    def __init__(self, limits: HealthLimits, settings: TrackerSettings) -> None:
        k = _DRIVERS_MOST * _LIVES.size
        limit = np.array([limits.of(name) for name in COMPONENTS])
        self.driver = np.repeat(np.arange(len(COMPONENTS))[:, None], k, axis=1)
        prior = np.zeros((len(COMPONENTS), k))
        for name, drivers in DRIVERS.items():
            number = COMPONENTS.index(name)
            if name in settings.laws:
                continue
            for slot, driver in enumerate(drivers):
                at = slice(slot * _LIVES.size, (slot + 1) * _LIVES.size)
                self.driver[number, at] = COMPONENTS.index(driver)
                prior[number, at] = settings.driven_probability / len(drivers) / _LIVES.size
        super().__init__(prior, np.ones(k, dtype=bool), np.array([1.0, 0.0, 0.0]), settings)
        self._coupling = limit[:, None] / limit[self.driver] / np.tile(_LIVES, _DRIVERS_MOST)
        self._rate_variance = (limit / _OWN_LIFE) ** 2
        # No more is thought of a driver that no test shows.
        self._most_variance = (0.5 * limit) ** 2
        self._coupling[prior == 0.0] = 0.0
        self.level, self.shown = np.zeros(len(COMPONENTS)), np.zeros(len(COMPONENTS), dtype=bool)
        for number in range(len(COMPONENTS)):
            self._begin(number, 0.0, 1.0)

    def restart(self, number: int, value: float, variance: float) -> None:
        """Start the level of a component anew, its rate and coupling unknown.

        Parameters
        ----------
        number, value, variance
            Of the component, its new signed distance from healthy, and its variance [-].
        """
        self.level, self.shown = self.level.copy(), self.shown.copy()
        self.level[number], self.shown[number] = value, True
        self._begin(number, value, variance)

    def _begin(self, number: int, value: float, variance: float) -> None:
        coupling = self._coupling[number]
        self.mean[number, :, 0], self.mean[number, :, 1] = value, 0.0
        self.mean[number, :, 2] = coupling
        self.covariance[number] = 0.0
        self.covariance[number, :, 0, 0] = variance
        self.covariance[number, :, 1, 1] = self._rate_variance[number]
        self.covariance[number, :, 2, 2] = (_SPREAD * coupling) ** 2

    def state(self, name: str) -> dict[str, NDArray[Any]]:
        """Return all that is known, as ``LinearFilters.state``."""
        return super().state(name) | {f"{name}_level": self.level, f"{name}_shown": self.shown}

    def restore(self, name: str, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what ``state`` returned, as ``LinearFilters.restore``."""
        super().restore(name, state)
        self.level, self.shown = state[f"{name}_level"], state[f"{name}_shown"].astype(np.bool_)
        if not self.level.shape == self.shown.shape == (len(COMPONENTS),):
            raise ValueError(f"{name}_level has shape {self.level.shape}, not ({len(COMPONENTS)},)")

    def change_rate(self, number: int, rate: float, sigma: float) -> None:
        """Let a component go on at another rate, of a standard deviation [1/h]: its own changed."""
        mean, covariance = self.mean.copy(), self.covariance.copy()
        by = self.level[self.driver[number]]
        mean[number, :, 1] = rate - mean[number, :, 2] * by
        # a = rate - c y, with a rate that depends on neither level nor coupling.
        coupling = covariance[number, :, 2, :]
        covariance[number, :, 1, :] = covariance[number, :, :, 1] = -by[:, None] * coupling
        covariance[number, :, 1, 1] = sigma**2 + by**2 * coupling[:, 2]
        self.mean, self.covariance = mean, covariance

    def rates(self) -> NDArray[np.float64]:
        """Return the growth of each filter [1/h], ``(7, k)``."""
        return self.mean[..., 1] + self.mean[..., 2] * self.level[self.driver]

    def advance(
        self,
        hours: NDArray[np.float64],
        before: NDArray[np.float64],
        after: NDArray[np.float64],
        variance: NDArray[np.float64],
    ) -> None:
        """Let the filters of each component go on.

        Parameters
        ----------
        hours
            Hours of growth of each component, ``(7,)`` [h].
        before, after, variance
            Levels of all components before and after them, and their variances, ``(7,)`` each.
        """
        self.level = np.where(self.shown, after, 0.0)
        level = np.where(self.shown, 0.5 * (before + after), 0.0)
        driving = level[self.driver] * hours[:, None]
        hours = np.broadcast_to(hours[:, None], driving.shape)
        step = np.zeros_like(self.covariance)
        step[..., 0, 0] = step[..., 1, 1] = step[..., 2, 2] = 1.0
        step[..., 0, 1], step[..., 0, 2] = hours, driving
        grown = (self.mean[..., 1] * hours + self.mean[..., 2] * driving) ** 2
        rate = np.divide(grown, hours**2, out=np.zeros_like(grown), where=hours > 0.0)
        # The error of a driver's level lasts; as it is small, it is taken for noise of its own.
        unknown = np.minimum(variance, self._most_variance)[self.driver]
        noise = self._growth_noise(rate, hours)
        noise[..., 0, 0] += (self.mean[..., 2] * hours) ** 2 * unknown
        self._go_on(step, noise)
