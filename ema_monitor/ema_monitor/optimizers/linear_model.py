"""Residuals that are linear about a point, half their square, and where that is lowest."""

from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.arrays import Array, Flags

RIDGE: Final = 1e-9
"""Share of the largest diagonal entry of a normal matrix that its ridge is [-].

Rounding disturbs a normal matrix by about 1e-16 of that entry, and a component that a window shows
contributes 1e-6 or more. At 1e-12 fits of ordinary motion, where loads and offsets hardly differ,
follow the noise."""

_LEAST_CURVATURE: Final = 1e-12
"""Least share of the largest diagonal entry by which a component is damped [-]: one without any
effect stays where it is."""


class Linearisation(NamedTuple):
    """Residuals, ``(r,)``, and their derivatives, ``(r, d)``, at a point, ``(d,)``."""

    point: Array
    residuals: Array
    jacobian: Array

    @property
    def cost(self) -> float:
        """Sum of squares of the residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def is_finite(self) -> bool:
        """Whether all derivatives are finite."""
        return bool(np.all(np.isfinite(self.jacobian)))

    def predicted(self, point: Array) -> Array:
        """Return the residuals, ``(r,)``, at a point, ``(d,)``, by the linear model."""
        return self.residuals + self.jacobian @ (point - self.point)

    def predicted_cost(self, point: Array) -> float:
        """Return the sum of squares of the residuals at a point, ``(d,)``, by the linear model."""
        residuals = self.predicted(point)
        return float(residuals @ residuals)

    def restricted(self, point: Array, free: Flags) -> Self:
        """Return the model about a point, ``(d,)``, as one of its ``free`` components alone."""
        return type(self)(point[free], self.predicted(point), self.jacobian[:, free])


class Quadratic(NamedTuple):
    """Half a cost, but for a constant: ``g (x - p) + (x - p) H (x - p) / 2``."""

    point: Array  # p, (d,)
    gradient: Array  # g, (d,)
    hessian: Array  # H, (d, d), positive semi-definite

    @classmethod
    def of(cls, at: Linearisation) -> Self:
        """Return half the cost of a linear model: Gauss and Newton's, without second derivatives.

        J. Nocedal, S. Wright, Numerical Optimization, 2006, section 10.3.
        """
        jacobian = at.jacobian
        return cls(at.point, jacobian.T @ at.residuals, jacobian.T @ jacobian)

    def with_ridge(self) -> Self:
        """Return a function with a ridge that keeps components without any effect finite."""
        hessian = self.hessian
        return self._replace(hessian=hessian + ridge_of(hessian) * np.eye(len(hessian)))

    def damped(self, damping: float) -> Self:
        """Return a function that is steeper away from the point, by a share of its diagonal [-].

        D. Marquardt, J. SIAM 11(2), 1963: steps are independent of the components' units.
        """
        diagonal = np.diag(self.hessian)
        scale = np.maximum(diagonal, _LEAST_CURVATURE * max(np.max(diagonal), 1e-300))
        return self._replace(hessian=self.hessian + damping * np.diag(scale))

    def lowest(self) -> Array:
        """Return the lowest point within the unit box, ``(d,)``; the Hessian must be definite."""
        from ema_monitor.optimizers.bounded_quadratic import lowest_in_box  # with the compiler

        return lowest_in_box(self.hessian, self.gradient, self.point)

    def lowest_between(self, lower: Array, upper: Array) -> Array:
        """Return the lowest point between bounds, ``(d,)`` each; the Hessian must be definite."""
        span = upper - lower
        in_box = Quadratic(
            (self.point - lower) / span, self.gradient * span, self.hessian * np.outer(span, span)
        )
        return lower + span * in_box.lowest()


def ridge_of(normal: Array) -> float:
    """Return what to add to the diagonal of a normal matrix, ``(d, d)``, to make it solvable.

    It is far below what any visible component has there, and keeps an invisible one finite.
    """
    return RIDGE * max(float(np.max(np.diag(normal), initial=0.0)), 1e-200)


def refitted(at: Linearisation, rest: Array, free: Flags) -> Array:
    """Return the lowest point, ``(d,)``, of a linear model within the unit box.

    Components that are not ``free``, ``(d,)``, have the values of ``rest``, ``(d,)``.
    """
    point = np.where(free, at.point, rest)
    point[free] = Quadratic.of(at.restricted(point, free)).with_ridge().lowest()
    return point
