"""Bounded least squares, from as many starts and as global a screen as a good fit needs."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.optimizers.interface import NO_HINTS, Hints

DIFFERENCE: Final = 5e-3
"""Step of the difference quotients; smaller ones see the model's friction stick and slip."""

# Points and starts; the first is a descent from the start.
_SCREENS: Final = ((1, 1), (96, 4), (600, 12))
# Of the trial steps, over the one that was the best in the last iteration.
_DAMPINGS: Final = np.array([2.0, 0.3])
_FIRST_DAMPING: Final = 2.0
_LEAST_DAMPING, _MOST_DAMPING = 1e-6, 30.0
_STEP_TOLERANCE: Final = 2e-4
# Shares of the cost: the gain of the last step, and of a further one by the linear model.
_GAIN_TOLERANCE: Final = 1e-4
_SETTLED: Final = 1e-2
_AGREEMENT: Final = 0.02
_ITERATIONS: Final = 25


_UNKNOWN: Final = np.empty((0, 0))


@dataclass
class _Descent:
    """One start on its way down; the derivatives where it stands may not be known."""

    point: Array
    cost: float
    residuals: Array
    jacobian: Array = field(default_factory=lambda: _UNKNOWN)
    damping: float = _FIRST_DAMPING
    promised: float = 0.0
    iterations: int = 0
    done: bool = False

    def differentiate(self, points: Array, residuals: Array) -> None:
        """Take the derivatives from the residuals at the `_differences`."""
        self.jacobian = (residuals - self.residuals).T / np.diag(points - self.point)
        # Where there is no derivative, the component is left where it is.
        self.jacobian[:, ~np.all(np.isfinite(self.jacobian), axis=0)] = 0.0

    def trials(self) -> Array:
        """Return where steps lead, ``(m, d)``, the last one hardly damped.

        Where they would gain hardly anything it is the only one, and the descent is done.
        """
        dampings = np.append(self.damping * _DAMPINGS, _LEAST_DAMPING)
        points = bounded_steps(self.point, self.residuals, self.jacobian, dampings)
        left = self.residuals + self.jacobian @ (points[-1] - self.point)
        self.promised = float(left @ left)
        self.done = self.promised > (1.0 - _SETTLED) * self.cost
        return points[-1:] if self.done else points


class ScreenedLeastSquares:
    """Levenberg-Marquardt from the start, and from screened starts where that gives no good fit.

    A screen is a Latin hypercube, half of it spread over the box, half of it drawn towards the
    start. Each iteration asks for the difference columns of all descents in one batch, then for
    their trial steps in another, under several dampings about the one that was the best before.
    After each iteration the worse half of the descents is given up, until one is left. It ends
    where a step gains hardly anything, or would by the linear model, and where an undamped one has
    led to a good fit as the linear model said. A component at its bound is held there as long as
    the step would leave the box.

    A descent from the start comes first. While the best point costs more than a good fit, a
    small screen with a few starts follows, then a large one with many. The large one is left out
    where the cost is fair and the small one found nothing better.

    Parameters
    ----------
    start
        Point about which the screens are denser, ``(d,)``; it is one of the screened points.
    rng
        Source of random numbers.
    hints
        An optimum is accepted if it costs no more than the good cost; at 0 all screens are made.
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
        """Return the screen, the difference columns or the trial steps, ``(m, d)``."""
        return self._asked

    def tell(self, points: Array, costs: Array, residuals: Array) -> None:
        """Process the costs, ``(m,)``, and residuals, ``(m, n)``, of the points asked for."""
        self._evaluated = (points, costs, residuals)
        self._best_cost = min(self._best_cost, float(np.min(costs)))
        asked = next(self._steps, None)
        if asked is None:
            self.converged = True
        else:
            self._asked = asked

    def _search(self) -> Iterator[Array]:
        """Yield the points to evaluate next; the results are in ``_evaluated`` thereafter."""
        for size, starts in _SCREENS:
            before = self._best_cost
            screen = self._screen(size)
            yield np.concatenate([screen, _differences(screen[0])]) if size == 1 else screen
            points, costs, residuals = self._evaluated
            descents = [
                _Descent(points[i], float(costs[i]), residuals[i])
                for i in np.argsort(costs[:size])[:starts]
                if np.isfinite(costs[i])
            ]
            if size == 1 and descents:
                descents[0].differentiate(points[1:], residuals[1:])
            while descents and not descents[0].done:
                if fresh := [one for one in descents if not one.jacobian.size]:
                    yield np.concatenate([_differences(one.point) for one in fresh])
                    points, _, residuals = self._evaluated
                    for i, one in enumerate(fresh):
                        rows = slice(i * len(one.point), (i + 1) * len(one.point))
                        one.differentiate(points[rows], residuals[rows])
                trials = [one.trials() for one in descents]
                yield np.concatenate(trials)
                self._accept_best_trials(descents, [len(one) for one in trials])
                descents.sort(key=lambda descent: descent.cost)
                del descents[max(1, (len(descents) + 1) // 2) :]
            agrees = self._best_cost > (1.0 - _AGREEMENT) * before
            if self._best_cost <= self._hints.good_cost:
                return
            if agrees and self._best_cost <= self._hints.fair_cost():
                return

    def _screen(self, size: int) -> Array:
        d = len(self._start)
        cells = self._rng.permuted(np.tile(np.arange(size), (d, 1)), axis=1).T
        points = (cells + self._rng.random((size, d))) / size
        # Faults are mostly few and small: half of the screen lies mainly there.
        reach = self._rng.random((size // 2, d)) ** 3
        points[: size // 2] = self._start + reach * (points[: size // 2] - self._start)
        points[0] = self._start
        return points

    def _accept_best_trials(self, descents: list[_Descent], sizes: list[int]) -> None:
        points, costs, residuals = self._evaluated
        for descent, size, first in zip(descents, sizes, np.cumsum(sizes) - sizes, strict=True):
            number = int(np.argmin(costs[first : first + size]))
            best = first + number
            descent.iterations += 1
            # The last of several is hardly damped.
            damping = descent.damping * _DAMPINGS[min(number, len(_DAMPINGS) - 1)]
            descent.damping = float(np.clip(damping, _LEAST_DAMPING, _MOST_DAMPING))
            if number == len(_DAMPINGS):
                kept = abs(costs[best] - descent.promised) < _SETTLED * costs[best]
                descent.done |= bool(kept and costs[best] <= self._hints.good_cost)
            step = np.max(np.abs(points[best] - descent.point))
            gain = descent.cost - costs[best]
            descent.done |= not gain > _GAIN_TOLERANCE * descent.cost or step < _STEP_TOLERANCE
            if gain > 0.0:
                descent.point, descent.cost = points[best], float(costs[best])
                descent.residuals, descent.jacobian = residuals[best], _UNKNOWN
            descent.done |= descent.iterations >= _ITERATIONS


def _differences(point: Array) -> Array:
    return point + np.diag(np.where(point > 0.5, -DIFFERENCE, DIFFERENCE))


def bounded_steps(point: Array, residuals: Array, jacobian: Array, dampings: Array) -> Array:
    """Return where damped Gauss-Newton steps from a point lead, ``(m, d)``, within the unit box.

    The dampings, ``(m,)``, are relative to the diagonal of the normal matrix [-].
    """
    from ema_monitor.optimizers.bounded_quadratic import lowest_in_box  # with the compiler

    normal, slope = jacobian.T @ jacobian, jacobian.T @ residuals
    scale = np.maximum(np.diag(normal), 1e-12 * max(np.max(np.diag(normal)), 1e-300))
    normals = normal + dampings[:, None, None] * np.diag(scale)
    return np.stack([lowest_in_box(one, slope, point) for one in normals])
