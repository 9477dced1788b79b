"""All that is thought of how the components of a unit grow, weighed together: cells and filters.

Probabilities of cells and filters are exact marginal likelihoods, but for what growth was like long
ago where it does not keep to a law for life: each test draws those of rates that wander and of
waves, and whether growth is by a law for life, at a rate that wanders or under a wave, towards
their prior by a small power (Raftery, Karny and Ettler 2010, dynamic model averaging). Which of the
laws for life it is, and whether anything grows, is not forgotten. So a unit whose growth is steady
comes to count as such, and is told the narrower interval, and one whose growth is not does not.
"""

from collections.abc import Mapping
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS
from ema_core.growth_laws import increment
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.bank import Bank
from ema_monitor.prognosis.growth.cells import grid
from ema_monitor.prognosis.growth.errors import EstimateErrors, LastTest
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY, temper
from ema_monitor.prognosis.growth.fleet import with_fleet
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.waves import Waves

Moments = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Mean and variance of each component, ``(7,)`` each."""


class Mixture:
    """Cells and waves, and the errors of the estimates that both are measured by.

    Parameters
    ----------
    limits
        Where life ends.
    settings
        What is assumed.

    Attributes
    ----------
    bank, waves, errors
        The parts.
    """

    def __init__(self, limits: HealthLimits, settings: TrackerSettings) -> None:
        self._settings = settings
        cells = with_fleet(grid(limits, settings), settings.fleet, settings.laws)
        self.bank = Bank(cells, settings)
        self.waves = Waves(limits, settings)
        self.errors = EstimateErrors(self.bank.noise_hours)
        is_known = np.array([name in settings.laws for name in COMPONENTS])
        self._power = np.where(is_known, 1.0, settings.forgetting)
        self._component = self.bank.cells.component
        self._is_constant = np.zeros(self._component.size, dtype=bool)
        self._is_constant[self.bank.cells.slices["constant"]] = True
        # No growth, a law for life, a rate that wanders: of each component.
        kind = np.where(self._is_constant, 0, np.where(self.bank.cells.wanders, 2, 1))
        self._kind = kind * len(COMPONENTS) + self._component
        self._prior = self._prior_beside_filters()
        self.bank.weight = self._prior.copy()
        self._kinds_prior = self._of_kinds(self._prior, self.waves.prior[:, self.waves.grows])
        self._last = LastTest.none()

    def _prior_beside_filters(self) -> NDArray[np.float64]:
        """Return the prior of the cells: with filters, growth is as probable as without."""
        prior = self.bank.cells.prior.copy()
        for grows in (False, True):
            of_it = self._is_constant != grows
            total = self.bank.sums(prior * of_it)
            taken = self.waves.prior[:, self.waves.grows == grows].sum(axis=1)
            prior[of_it] *= (1.0 - taken / total)[self._component[of_it]]
        return prior

    def frozen(self) -> "Mixture":
        """Return a copy that does not change with this one."""
        twin = copy(self)
        twin.bank = self.bank.frozen()
        twin.waves = self.waves.frozen()
        return twin

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all that is known, for ``restore``."""
        bank, last = self.bank, self._last
        return {
            "bank": np.stack([bank.weight, bank.mean, bank.variance]),
            **self.waves.state(),
            "errors": self.errors.log_probability,
            "error_mean": self.errors.mean,
            "error_covariance": self.errors.covariance,
            "error_hours": self.errors.hours,
            "last": np.array([last.value, last.noise, last.used]),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what ``state`` of one of the same limits and settings returned.

        Raises
        ------
        ValueError, KeyError
            When it is none.
        """
        bank = self.bank
        if state["bank"].shape != (3, bank.weight.size):
            raise ValueError(f"the grid has shape {state['bank'].shape}, not {bank.weight.shape}")
        bank.weight, bank.mean, bank.variance = map(np.ascontiguousarray, state["bank"])
        self.waves.restore(state)
        errors = self.errors
        errors.log_probability, errors.hours = state["errors"], state["error_hours"]
        errors.mean, errors.covariance = state["error_mean"], state["error_covariance"]
        value, noise, used = state["last"]
        self._last = LastTest(value, noise, used.astype(np.bool_))

    def moments(self) -> Moments:
        """Return mean and variance of each component's signed distance, ``(7,)`` each."""
        bank, waves = self.bank, self.waves
        first, second = bank.sums(bank.weight * bank.mean), bank.sums(bank.weight * bank.variance)
        mean, variance = waves.moments()
        first += np.sum(waves.weight * mean, axis=1)
        second += np.sum(waves.weight * variance, axis=1)
        second += bank.sums(bank.weight * (bank.mean - first[self._component]) ** 2)
        second += np.sum(waves.weight * (mean - first[:, None]) ** 2, axis=1)
        return first, second

    def constant(self) -> NDArray[np.float64]:
        """Return the probability that each component does not grow, ``(7,)``."""
        still = self.waves.weight[:, ~self.waves.grows].sum(axis=1)
        return self.bank.weight[self.bank.cells.slices["constant"]] + still

    def rates(self) -> NDArray[np.float64]:
        """Return the signed growth of each cell in the next hour [1/h]."""
        bank, cells = self.bank, self.bank.cells
        rates = np.zeros_like(bank.weight)
        for law, part in cells.slices.items():
            x = np.clip(cells.side[part] * bank.mean[part], 0.0, 1.0)
            an_hour = increment(law, x, cells.rate[part], cells.shape[part], 1.0)
            rates[part] = np.minimum(an_hour, 1.0)
        return rates * cells.side

    def change_rate(self, number: int, rate: float, sigma: float) -> None:
        """Forget how a component grew, given that it grows, but for its rate of now.

        Parameters
        ----------
        number, rate, sigma
            The component, the rate, and its standard deviation [1/h].
        """
        bank = self.bank
        at = bank.members[number]
        at = at[~self._is_constant[at]]
        rates = self.rates()[at]
        # A cell stands for the rates about it.
        spread = np.hypot(sigma, 0.3 * bank.cells.spacing[at] * rates)
        log_p = -0.5 * ((rates - rate) / spread) ** 2 - np.log(spread)
        weight = self._prior[at] * np.exp(log_p - log_p.max())
        bank.weight[at] = np.maximum(
            weight * (bank.weight[at].sum() / weight.sum()), LEAST_PROBABILITY
        )
        self.waves.change_rate(number, rate, sigma)

    def advance(self, hours: NDArray[np.float64]) -> None:
        """Let each component grow over hours of its own, at least 0, ``(7,)`` [h]."""
        self.errors.advance(hours)
        self.bank.advance(hours)
        self.waves.advance(hours)

    def _forget(self, used: NDArray[np.bool_]) -> None:
        """Draw the probabilities of growth towards their prior, in each kind of growth by itself.

        Parameters
        ----------
        used
            Components of which the test tells something, ``(7,)``.
        """
        bank, waves = self.bank, self.waves
        power = np.where(used, self._power, 1.0)
        before = self._of_kinds(bank.weight, waves.weight[:, waves.grows])
        # What wanders forgets; a law is one for life, or it is found to be none.
        powers = np.concatenate([np.ones_like(power), np.ones_like(power), power])
        temper(bank.weight, self._prior, self._kind, powers)
        kept = _tempered(waves.weight[:, waves.grows], waves.prior[:, waves.grows], power[:, None])
        after = self._of_kinds(bank.weight, kept)
        wanted = before.copy()
        wanted[1:] = _tempered(before[1:], self._kinds_prior[1:], power)
        wanted[1:] *= before[1:].sum(axis=0) / np.maximum(wanted[1:].sum(axis=0), LEAST_PROBABILITY)
        factor = wanted / np.maximum(after, LEAST_PROBABILITY)
        bank.weight *= factor[:3].ravel()[self._kind]
        waves.weight[:, waves.grows] = kept * factor[3][:, None]

    def _of_kinds(
        self, of_cells: NDArray[np.float64], of_waves: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return sums by kind of growth: none, for life, wandering, wave; ``(4, 7)``."""
        found = np.bincount(self._kind, of_cells, 3 * len(COMPONENTS)).astype(
            np.float64, copy=False
        )
        return np.stack([*found.reshape(3, -1), of_waves.sum(axis=1)])

    def measure(
        self,
        value: NDArray[np.float64],
        noise: NDArray[np.float64],
        used: NDArray[np.bool_],
        near_healthy: NDArray[np.bool_],
    ) -> NDArray[np.float64]:
        """Update by a test.

        Parameters
        ----------
        value, noise
            Signed distances from healthy and variances of their errors, ``(7,)``.
        used, near_healthy
            Components that the test shows, and those of them that were set to healthy, ``(7,)``.

        Returns
        -------
        numpy.ndarray
            Probability of smaller values than those, as it was before the test, ``(7,)``; of no
            meaning where a component is not shown or was set to healthy.
        """
        self._forget(used)
        self.bank.change()
        bank, errors, last = self.bank, self.errors, self._last
        settings, plain = self._settings, used & ~near_healthy
        occasional = (settings.occasional_error, settings.occasional_probability)
        errors.learn(value, noise, plain, last, occasional)
        # Scatter shows no error that stays: an estimate is never better than it says.
        correlation, variance = errors.correlation, max(errors.factor, 1.0) ** 2 * noise
        carried = last.carried(noise, correlation)
        fresh = np.where(last.used, 1.0 - correlation**2, 1.0) * variance
        of_cells, below = bank.measure(value, noise, used, near_healthy, carried, fresh, last.value)
        pit = bank.sums(bank.weight * below)
        measured, near = np.flatnonzero(plain), np.flatnonzero(used & near_healthy)
        of_waves = np.zeros_like(self.waves.weight)
        below = self.waves.measure(measured, value, fresh, carried, last.value, of_waves)
        pit += np.sum(self.waves.weight * below, axis=1)
        self.waves.measure_near(near, noise, bank.two_sided, of_waves)
        self._weigh(of_cells, of_waves)
        self._last = LastTest(value, noise, plain)
        return pit

    def _weigh(self, of_cells: NDArray[np.float64], of_waves: NDArray[np.float64]) -> None:
        """Multiply all probabilities by likelihoods, given by their logarithms."""
        bank, waves = self.bank, self.waves
        highest = np.full(len(COMPONENTS), -np.inf)
        np.maximum.at(highest, self._component, of_cells)
        highest = np.maximum(highest, np.where(waves.prior > 0.0, of_waves, -np.inf).max(axis=1))
        cells = bank.weight * np.exp(of_cells - highest[self._component])
        weight = waves.weight * np.exp(np.minimum(of_waves - highest[:, None], 0.0))
        total = bank.sums(cells) + weight.sum(axis=1)
        bank.weight = np.maximum(cells / total[self._component], LEAST_PROBABILITY)
        waves.weight = weight / total[:, None]

    def skip(self) -> None:
        """Leave a test unused: the errors of the one before no longer last into the next."""
        last = self._last
        self._last = LastTest(last.value, last.noise, np.zeros_like(last.used))

    def restart(self, number: int, value: float, noise: float, *, keep: float) -> None:
        """Start a component's level anew from one test, which may have an occasional error.

        Parameters
        ----------
        number, value, noise
            Number of the component, its new signed distance from healthy, and the variance of its
            error [-].
        keep
            Power to which the probabilities are kept, relative to the prior: 0 reopens the prior,
            1 keeps all that is known of the growth [-].
        """
        bank, last = self.bank, self._last
        variance = noise + self._settings.occasional_error**2
        self.errors.restart(number)
        bank.restart(number, value, variance)
        self.waves.restart(number, value, variance)
        at, waves = bank.members[number], self.waves
        prior, of_waves = self._prior[at], waves.prior[number]
        cells = prior * (bank.weight[at] / prior) ** keep
        own = of_waves * (waves.weight[number] / np.maximum(of_waves, LEAST_PROBABILITY)) ** keep
        total = cells.sum() + own.sum()
        bank.weight[at] = cells / total
        waves.weight[number] = own / total
        values, noises, used = last.value.copy(), last.noise.copy(), last.used.copy()
        values[number], noises[number], used[number] = value, noise, False
        self._last = LastTest(values, noises, used)


def _tempered(
    weight: NDArray[np.float64], prior: NDArray[np.float64], power: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return probabilities, drawn by a power towards their prior; they are not normalised."""
    kept = np.maximum(weight, LEAST_PROBABILITY) ** power * prior ** (1.0 - power)
    return np.where(prior > 0.0, kept, 0.0)
