"""A global screen followed by bounded least squares from several starts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema_monitor.optimizers.bounded_quadratic import lowest_in_box

_SCREEN = 600
_STARTS = 12
_DAMPINGS = np.array([1e-6, 1e-3, 1e-1, 10.0])
_DIFFERENCE = 5e-3
_STEP_TOLERANCE = 1e-4
_ITERATIONS = 25


@dataclass
class _Descent:
    """One start on its way down."""

    point: NDArray[np.float64]
    cost: float
    residuals: NDArray[np.float64]
    iterations: int = 0
    done: bool = False


class ScreenedLeastSquares:
    """Screen the box, then descend from the best starts at once (Levenberg-Marquardt).

    The screen is a Latin hypercube, half of it spread over the box, half of it drawn towards the
    start. Each iteration asks for the difference columns of all descents in one batch, then for
    their trial steps under several dampings in another. After each iteration the worse half of
    the descents is given up, until one is left. A component at its bound is held there as long
    as the step would leave the box.

    Parameters
    ----------
    start
        Point about which the screen is denser, ``(d,)``; it is one of the screened points.
    rng
        Source of random numbers.
    """

    uses_residuals = True

    def __init__(self, start: NDArray[np.float64], rng: np.random.Generator) -> None:
        self.converged = False
        self._start = np.asarray(start, dtype=np.float64)
        self._rng = rng
        self._descents: list[_Descent] = []
        self._jacobians: list[NDArray[np.float64]] = []
        self._columns: NDArray[np.float64] = np.empty(0)
        self._stage = self._choose_starts

    def ask(self) -> NDArray[np.float64]:
        """Return the screen, the difference columns or the trial steps, ``(m, d)``."""
        if not self._descents:
            return self._screen()
        if self._stage == self._take_columns:
            return self._difference_points()
        return self._trial_points()

    def tell(
        self,
        points: NDArray[np.float64],
        costs: NDArray[np.float64],
        residuals: NDArray[np.float64],
    ) -> None:
        """Take the costs, ``(m,)``, and residuals, ``(m, n)``, of the points asked for."""
        self._stage(points, costs, residuals)

    def _screen(self) -> NDArray[np.float64]:
        d = len(self._start)
        cells = self._rng.permuted(np.tile(np.arange(_SCREEN), (d, 1)), axis=1).T
        points = (cells + self._rng.random((_SCREEN, d))) / _SCREEN
        # Faults are mostly few and small: half of the screen looks mainly there.
        reach = self._rng.random((_SCREEN // 2, d)) ** 3
        points[: _SCREEN // 2] = self._start + reach * (points[: _SCREEN // 2] - self._start)
        points[0] = self._start
        return points

    def _choose_starts(self, points, costs, residuals) -> None:
        for i in np.argsort(costs):
            if len(self._descents) == _STARTS or not np.isfinite(costs[i]):
                break
            self._descents.append(_Descent(points[i], costs[i], residuals[i]))
        self.converged = not self._descents
        self._stage = self._take_columns

    def _difference_points(self) -> NDArray[np.float64]:
        batch = []
        for descent in self._descents:
            forward = np.where(descent.point > 0.5, -_DIFFERENCE, _DIFFERENCE)
            batch.append(descent.point + np.diag(forward))
        return np.concatenate(batch)

    def _take_columns(self, points, costs, residuals) -> None:
        d = len(self._start)
        self._jacobians = []
        for i, descent in enumerate(self._descents):
            rows = slice(i * d, (i + 1) * d)
            steps = np.diag(points[rows] - descent.point)
            columns = (residuals[rows] - descent.residuals).T / steps
            # Where there is no derivative, the component is left where it is.
            columns[:, ~np.all(np.isfinite(columns), axis=0)] = 0.0
            self._jacobians.append(columns)
        self._stage = self._take_trials

    def _trial_points(self) -> NDArray[np.float64]:
        return np.concatenate(
            [
                np.stack([bounded_step(d.point, d.residuals, J, damping) for damping in _DAMPINGS])
                for d, J in zip(self._descents, self._jacobians, strict=True)
            ]
        )

    def _take_trials(self, points, costs, residuals) -> None:
        m = len(_DAMPINGS)
        for i, descent in enumerate(self._descents):
            rows = slice(i * m, (i + 1) * m)
            best = i * m + int(np.argmin(costs[rows]))
            descent.iterations += 1
            step = np.max(np.abs(points[best] - descent.point))
            if costs[best] < descent.cost:
                descent.done = step < _STEP_TOLERANCE
                descent.point, descent.cost = points[best], costs[best]
                descent.residuals = residuals[best]
            else:
                descent.done = True
            descent.done |= descent.iterations >= _ITERATIONS
        self._descents.sort(key=lambda descent: descent.cost)
        self._descents = self._descents[: max(1, (len(self._descents) + 1) // 2)]
        self.converged = self._descents[0].done
        self._stage = self._take_columns


def bounded_step(
    point: NDArray[np.float64],
    residuals: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    damping: float,
) -> NDArray[np.float64]:
    """Return where a damped Gauss-Newton step within the unit box leads.

    Parameters
    ----------
    point
        Where the step starts, ``(d,)``.
    residuals
        Residuals there, ``(n,)``.
    jacobian
        Their derivatives, ``(n, d)``.
    damping
        Damping relative to the diagonal of the normal matrix [-].

    Returns
    -------
    numpy.ndarray
        The new point, ``(d,)``, within [0, 1].
    """
    normal = jacobian.T @ jacobian
    scale = np.maximum(np.diag(normal), 1e-12 * max(np.max(np.diag(normal)), 1e-300))
    return lowest_in_box(normal + damping * np.diag(scale), jacobian.T @ residuals, point)
