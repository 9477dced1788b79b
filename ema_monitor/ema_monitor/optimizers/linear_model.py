"""Linear models of residuals, the quadratic function of half their square, and its minimum."""

from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.arrays import Array, Flags

RIDGE: Final = 1e-9
"""Ridge of a normal matrix, as a share of its largest diagonal entry [-].

Rounding errors of a normal matrix are about 1e-16 of this entry. Fits of ordinary motion, in which
loads and offsets are nearly collinear, depend on this value: change it only with the tests of
combined stretches."""

_LEAST_CURVATURE: Final = 1e-12
"""Least damping of a component, as a share of the largest diagonal entry [-]: a component without
effect does not move."""


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
        """Return the model about a point, ``(d,)``, in its ``free`` components only."""
        return type(self)(point[free], self.predicted(point), self.jacobian[:, free])


class Quadratic(NamedTuple):
    """Half of a cost, up to a constant: ``g (x - p) + (x - p) H (x - p) / 2``."""

    point: Array  # p, (d,)
    gradient: Array  # g, (d,)
    hessian: Array  # H, (d, d), positive semi-definite

    @classmethod
    def of(cls, at: Linearisation) -> Self:
        """Return half the cost of a linear model (Gauss-Newton), without second derivatives.

        J. Nocedal, S. Wright, Numerical Optimization, 2006, section 10.3.
        """
        jacobian = at.jacobian
        return cls(at.point, jacobian.T @ at.residuals, jacobian.T @ jacobian)

    def with_ridge(self) -> Self:
        """Return the function with a ridge, which keeps components without effect finite."""
        hessian = self.hessian
        return self._replace(hessian=hessian + ridge_of(hessian) * np.eye(len(hessian)))

    def damped(self, damping: float) -> Self:
        """Return the function with its diagonal increased by a share [-].

        D. Marquardt, J. SIAM 11(2), 1963: steps are independent of the units of the components.
        """
        diagonal = np.diag(self.hessian)
        scale = np.maximum(diagonal, _LEAST_CURVATURE * max(np.max(diagonal), 1e-300))
        return self._replace(hessian=self.hessian + damping * np.diag(scale))

    def lowest(self) -> Array:
        """Return the minimum within the unit box, ``(d,)``; the Hessian must be definite."""
        from ema_monitor.optimizers.bounded_quadratic import lowest_in_box  # with the compiler

        return lowest_in_box(self.hessian, self.gradient, self.point)

    def lowest_between(self, lower: Array, upper: Array) -> Array:
        """Return the minimum between bounds, ``(d,)`` each; the Hessian must be definite."""
        span = upper - lower
        in_box = Quadratic(
            (self.point - lower) / span, self.gradient * span, self.hessian * np.outer(span, span)
        )
        return lower + span * in_box.lowest()


def ridge_of(normal: Array) -> float:
    """Return the ridge that makes a normal matrix, ``(d, d)``, solvable.

    The ridge is far below the diagonal entry of any component that has an effect, and keeps
    components without effect finite.
    """
    return RIDGE * max(float(np.max(np.diag(normal), initial=0.0)), 1e-200)


def refitted(at: Linearisation, rest: Array, free: Flags) -> Array:
    """Return the minimum, ``(d,)``, of a linear model within the unit box.

    Components that are not ``free``, ``(d,)``, have the values of ``rest``, ``(d,)``.
    """
    point = np.where(free, at.point, rest)
    point[free] = Quadratic.of(at.restricted(point, free)).with_ridge().lowest()
    return point
