"""Grey wolf optimization, with one pack and with the packs of one of the thesis."""

from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.optimizers.population import Population

_LEADERS: Final = 3


class GreyWolf(Population):
    """Grey wolf optimizer with alpha, beta and delta, the three best points of the pack so far.

    A wolf goes to the mean of three points, one about each leader: ``leader - A |C leader - x|``
    with ``A`` uniform in [-a, a] and ``C`` uniform in [0, 2], drawn for each component; whatever
    leaves the box is put on the wall. ``a`` falls linearly from 2 after the first generation to 0
    when the budget is spent, and stays there.

    Parameters and errors are as in `Population`; the fall of ``a`` is spread over the budget.

    References
    ----------
    Mirjalili, Mirjalili and Lewis (2014), "Grey wolf optimizer", Advances in Engineering Software
    69, eq. 3.3 to 3.7.
    """

    FEWEST = _LEADERS

    def _begin(self, population: int, d: int) -> None:
        self._generation = 0
        self._leaders = np.empty((0, d))
        self._leader_costs = np.empty(0)

    def _next(self, points: Array, costs: Array) -> Array:
        points = np.concatenate([self._leaders, points])
        costs = np.concatenate([self._leader_costs, costs])
        best = np.argsort(costs, kind="stable")[:_LEADERS]
        self._leaders, self._leader_costs = points[best], costs[best]
        a = shrinking(self._generation, self._generations)
        self._generation += 1
        return encircled(self._asked, self._leaders[:, None], a, self._rng)


class ThesisGreyWolf(Population):
    """Grey wolf optimizer as the thesis has it, appendix B: each wolf follows itself.

    A wolf has an alpha, a beta and a delta of its own, which begin at the zero vector with an
    infinite cost. A point that costs less than its alpha replaces it, and the old alpha is
    forgotten; one that costs more than alpha and less than beta replaces beta; one that costs more
    than both and less than delta replaces delta. Beta and delta may so stay at zero, which draws
    the wolves there; a component that is zero in a wolf and its leaders is zero ever after.

    ``a`` is lower than in ``GreyWolf`` by its fall in a generation. Appendix B as transcribed
    has the digit 1 where the generation l must stand, which would keep ``a`` at 1.99; it is read
    as the letter.

    Parameters are as in ``GreyWolf``.
    """

    def _begin(self, population: int, d: int) -> None:
        self._generation = 0
        self._leaders = np.zeros((_LEADERS, population, d))
        self._leader_costs = np.full((_LEADERS, population), np.inf)

    def _next(self, points: Array, costs: Array) -> Array:
        alpha, beta, delta = self._leader_costs
        replaces = np.stack(
            [
                costs < alpha,
                (costs > alpha) & (costs < beta),
                (costs > alpha) & (costs > beta) & (costs < delta),
            ]
        )
        self._leaders = np.where(replaces[..., None], points, self._leaders)
        self._leader_costs = np.where(replaces, costs, self._leader_costs)
        self._generation += 1
        a = shrinking(self._generation, self._generations)
        return encircled(points, self._leaders, a, self._rng)


def shrinking(generation: int, generations: int) -> float:
    """Return ``a`` of a generation, from 2 at number 0 to 0 after the last one."""
    return max(0.0, 2.0 * (1.0 - generation / generations))


def encircled(points: Array, leaders: Array, a: float, rng: "np.random.Generator") -> Array:
    """Return where wolves at ``points``, ``(m, d)``, go, within [0, 1].

    ``leaders`` are common, ``(3, 1, d)``, or individual, ``(3, m, d)``; ``a`` is how far beyond
    them a wolf may go, in distances from them [-].
    """
    r_1, r_2 = rng.random((2, _LEADERS, *points.shape))
    A, C = 2.0 * a * r_1 - a, 2.0 * r_2
    targets = leaders - A * np.abs(C * leaders - points)
    return np.clip(np.mean(targets, axis=0), 0.0, 1.0)
