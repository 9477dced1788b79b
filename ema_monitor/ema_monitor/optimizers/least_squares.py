# SPDX-License-Identifier: Apache-2.0
"""Bounded least squares with screened starting points."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.optimizers.gauss_newton import Descent, LevenbergMarquardt, Stopping
from ema_monitor.optimizers.interface import NO_HINTS, Hints
from ema_monitor.optimizers.linear_model import Linearisation

DIFFERENCE: Final = 5e-3
"""Step of the difference quotients [-]; smaller steps would resolve stick-slip of the model."""

# Numbers of points and descents of each screen; the first screen is a descent from the start.
_SCREENS: Final = ((1, 1), (96, 4), (600, 12))
# On 40 windows of random units: with gain and step ten times larger or smaller, or 10 iterations,
# the number of evaluations changes by 0.1 % and no estimate by 0.1 sigma. A promise of 0.1 saves
# 5 % of the evaluations, 1e-3 takes 4 % more; the mean error is the same within 0.001 % of the
# range.
_STOPPING: Final = Stopping(iterations=25, gain=1e-4, step=2e-4, promise=1e-2)
# Smallest relative improvement of the cost by a screen. The costs of descents to the same optimum
# differ by less, because of the gain above.
_AGREEMENT: Final = 0.02


class ScreenedLeastSquares:
    """Levenberg-Marquardt from the start, and from screened starts if the fit is not good.

    A screen is a Latin hypercube: half of the points are spread over the box, half are contracted
    towards the start. Each iteration evaluates the points for the difference quotients of all
    descents in one batch, then their trial steps in another, with several dampings near the best
    damping of the previous iteration. After each iteration, the worse half of the descents is
    dropped until a single descent remains. The screen ends with its best descent. A descent ends if
    the evaluated or predicted gain of a step is small, if the step is short, or if an undamped step
    leads to a good fit as the linear model predicts. It ends after 25 iterations at the latest. A
    component at its bound is fixed while the step would leave the box.

    The first descent begins at the start. If its fit is not good, a small screen with a few
    descents follows, then a large screen with many descents. The large screen is skipped if the
    cost is fair and the small screen has not improved it.

    Parameters
    ----------
    start
        Starting point, ``(d,)``, which is also a point of each screen. Screens are denser near it.
    rng
        Source of random numbers.
    hints
        An optimum is accepted if its cost is at most the good cost, or under the above condition at
        most the fair cost. If both costs are 0, all screens are evaluated.
    """

    uses_residuals = True

    def __init__(self, start: Array, rng: "np.random.Generator", hints: Hints = NO_HINTS) -> None:
        self.converged = False
        self._start = np.asarray(start, dtype=np.float64)
        self._rng = rng
        self._hints = hints
        self._best_cost = np.inf
        self._steps = self._search()
        self._asked = next(self._steps)
        self._evaluated: tuple[Array, ...] = ()

    def ask(self) -> Array:
        """Return the points of a screen, difference quotients or trial steps, ``(m, d)``."""
        return self._asked

    def tell(self, points: Array, costs: Array, residuals: Array) -> None:
        """Process the costs, ``(m,)``, and residuals, ``(m, n)``, of the requested points."""
        self._evaluated = (points, costs, residuals)
        self._best_cost = min(self._best_cost, float(np.min(costs)))
        asked = next(self._steps, None)
        if asked is None:
            self.converged = True
        else:
            self._asked = asked

    def _search(self) -> Iterator[Array]:
        """Yield the points to evaluate next; `tell` stores the results, then resumes the search."""
        stopping = _STOPPING._replace(good_cost=self._hints.good_cost)
        for size, starts in _SCREENS:
            before = self._best_cost
            screen = self._screen(size)
            yield np.concatenate([screen, _differences(screen[0])]) if size == 1 else screen
            points, costs, residuals = self._evaluated
            descents = [
                Descent(points[i], float(costs[i]), residuals[i], LevenbergMarquardt(), stopping)
                for i in np.argsort(costs[:size])[:starts]
                if np.isfinite(costs[i])
            ]
            if size == 1 and descents:
                descents[0].at = _linearised(descents[0], points[1:], residuals[1:])
            while descents and not descents[0].done:
                yield from self._linearise(
                    [descent for descent in descents if not descent.is_linearised]
                )
                yield from self._advance(descents)
                descents.sort(key=lambda descent: descent.cost)
                del descents[max(1, (len(descents) + 1) // 2) :]
            agrees = self._best_cost > (1.0 - _AGREEMENT) * before
            if self._best_cost <= self._hints.good_cost:
                return
            if agrees and self._best_cost <= self._hints.fair_cost():
                return

    def _linearise(self, descents: list[Descent]) -> Iterator[Array]:
        """Yield the difference points of all descents in one batch, then linearise the descents."""
        if not descents:
            return
        yield np.concatenate([_differences(descent.point) for descent in descents])
        points, _, residuals = self._evaluated
        for i, descent in enumerate(descents):
            rows = slice(i * len(descent.point), (i + 1) * len(descent.point))
            descent.at = _linearised(descent, points[rows], residuals[rows])

    def _advance(self, descents: list[Descent]) -> Iterator[Array]:
        """Yield the trial steps of all descents in one batch, then take the best step of each.

        If the best step of a descent reduces the cost too little, the descent ends at its present
        point.
        """
        trials = [descent.trials() for descent in descents]
        yield np.concatenate([points for [points] in trials])
        points, costs, residuals = self._evaluated
        last = 0
        for descent, [tried] in zip(descents, trials, strict=True):
            rows = slice(last, last + len(tried))
            if not descent.accept(points[rows], costs[rows], residuals[rows]):
                descent.done = True
            last += len(tried)

    def _screen(self, size: int) -> Array:
        d = len(self._start)
        cells = self._rng.permuted(np.tile(np.arange(size), (d, 1)), axis=1).T
        points = (cells + self._rng.random((size, d))) / size
        # Half of the points are near the start, because faults are usually few and small.
        reach = self._rng.random((size // 2, d)) ** 3
        points[: size // 2] = self._start + reach * (points[: size // 2] - self._start)
        points[0] = self._start
        return points


def _linearised(descent: Descent, points: Array, residuals: Array) -> Linearisation:
    """Return the linearisation of a descent, from the residuals at its `_differences`."""
    jacobian = (residuals - descent.residuals).T / np.diag(points - descent.point)
    # A component without a finite derivative does not move.
    jacobian[:, ~np.all(np.isfinite(jacobian), axis=0)] = 0.0
    return Linearisation(descent.point, descent.residuals, jacobian)


def _differences(point: Array) -> Array:
    return point + np.diag(np.where(point > 0.5, -DIFFERENCE, DIFFERENCE))
