# SPDX-License-Identifier: Apache-2.0
"""Grey wolf optimization: the standard form, and the thesis's form with leaders for each wolf."""

from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.optimizers.population import Population

_LEADERS: Final = 3


class GreyWolf(Population):
    """Grey wolf optimizer, led by the three best points so far: alpha, beta and delta.

    A wolf at ``x`` moves to the mean of three points, one per leader:
    ``leader - A |C leader - x|`` with ``A`` uniform in [-a, a] and ``C`` uniform in [0, 2], drawn
    for each component. Points are clipped to the box. ``a`` decreases linearly from 2 after the
    first generation towards 0 at the end of the budget.

    Parameters and errors are as in `Population`.

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
    """Grey wolf optimizer as in the thesis, appendix B: each wolf follows its own leaders.

    Each wolf has its own alpha, beta and delta, which are initially the zero vector with an
    infinite cost. A point with a lower cost than alpha replaces alpha, and the previous alpha is
    discarded. A point with a cost between alpha and beta replaces beta. A point with a higher cost
    than both, and a lower cost than delta, replaces delta. Therefore beta and delta may remain at
    zero, which attracts the wolves. A component that is zero in a wolf and its leaders remains
    zero.

    ``a`` is one generation ahead of ``GreyWolf``. The transcription of appendix B has the digit 1
    in place of the generation l, which would keep ``a`` at 1.99; here it is the generation.

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
    """Return the coefficient ``a``, from 2 in generation 0 to 0 after the last generation."""
    return max(0.0, 2.0 * (1.0 - generation / generations))


def encircled(points: Array, leaders: Array, a: float, rng: "np.random.Generator") -> Array:
    """Return the next positions of wolves at ``points``, ``(m, d)``, within [0, 1].

    ``leaders`` are shared by all wolves, ``(3, 1, d)``, or individual, ``(3, m, d)``. A wolf moves
    to the mean of its targets ``leader - A |C leader - wolf|``, clipped to the box, with ``A``
    random in [-a, a] and ``C`` random in [0, 2] for each component.
    """
    r_1, r_2 = rng.random((2, _LEADERS, *points.shape))
    A, C = 2.0 * a * r_1 - a, 2.0 * r_2
    targets = leaders - A * np.abs(C * leaders - points)
    return np.clip(np.mean(targets, axis=0), 0.0, 1.0)
