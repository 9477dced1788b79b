# SPDX-License-Identifier: Apache-2.0
"""Linear models of residuals, and the quadratic model of half their sum of squares."""

from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.arrays import Array, Flags

RIDGE: Final = 1e-9
"""Ridge of a normal matrix, relative to its largest diagonal entry [-].

Rounding errors of a normal matrix are about 1e-16 of this entry. Fits of ordinary motion, in which
loads and offsets are nearly collinear, depend on this value: after a change, run the tests of
combined stretches."""

_LEAST_CURVATURE: Final = 1e-12
"""Smallest diagonal entry for the damping, relative to the largest diagonal entry [-]. It keeps a
component without effect in place."""


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
        """Return the residuals, ``(r,)``, that the linear model predicts at a point, ``(d,)``."""
        return self.residuals + self.jacobian @ (point - self.point)

    def predicted_cost(self, point: Array) -> float:
        """Return the cost that the linear model predicts at a point, ``(d,)``."""
        residuals = self.predicted(point)
        return float(residuals @ residuals)

    def restricted(self, point: Array, free: Flags) -> Self:
        """Return the linear model about a point, ``(d,)``, in the ``free`` components alone."""
        return type(self)(point[free], self.predicted(point), self.jacobian[:, free])


class Quadratic(NamedTuple):
    """Quadratic model of half a cost, up to a constant: ``g (x - p) + (x - p) H (x - p) / 2``."""

    point: Array  # p, (d,)
    gradient: Array  # g, (d,)
    hessian: Array  # H, (d, d), positive semi-definite

    @classmethod
    def of(cls, at: Linearisation) -> Self:
        """Return the quadratic model of a linear model's cost (Gauss-Newton approximation).

        J. Nocedal, S. Wright, Numerical Optimization, 2006, section 10.3.
        """
        jacobian = at.jacobian
        return cls(at.point, jacobian.T @ at.residuals, jacobian.T @ jacobian)

    def with_ridge(self) -> Self:
        """Return the model with a ridge on the Hessian, so that its minimum is unique."""
        hessian = self.hessian
        return self._replace(hessian=hessian + ridge_of(hessian) * np.eye(len(hessian)))

    def damped(self, damping: float) -> Self:
        """Return the model with the Hessian's diagonal increased by the share ``damping`` [-].

        D. Marquardt, J. SIAM 11(2), 1963: steps are independent of the units of the components.
        """
        diagonal = np.diag(self.hessian)
        scale = np.maximum(diagonal, _LEAST_CURVATURE * max(np.max(diagonal), 1e-300))
        return self._replace(hessian=self.hessian + damping * np.diag(scale))

    def lowest(self) -> Array:
        """Return the minimiser in the unit box, ``(d,)``.

        The Hessian must be positive definite.
        """
        from ema_monitor.optimizers.bounded_quadratic import lowest_in_box  # with the compiler

        return lowest_in_box(self.hessian, self.gradient, self.point)

    def lowest_between(self, lower: Array, upper: Array) -> Array:
        """Return the minimiser between bounds, ``(d,)`` each.

        The Hessian must be positive definite.
        """
        span = upper - lower
        in_box = Quadratic(
            (self.point - lower) / span, self.gradient * span, self.hessian * np.outer(span, span)
        )
        return lower + span * in_box.lowest()


def ridge_of(normal: Array) -> float:
    """Return the diagonal addition that makes a normal matrix, ``(d, d)``, invertible.

    The ridge is far below the diagonal entry of any component that affects the residuals.
    """
    return RIDGE * max(float(np.max(np.diag(normal), initial=0.0)), 1e-200)


def refitted(at: Linearisation, rest: Array, free: Flags) -> Array:
    """Return the minimiser of a linear model's cost in the unit box, ``(d,)``.

    Components that are not ``free``, ``(d,)``, keep the values in ``rest``, ``(d,)``.
    """
    point = np.where(free, at.point, rest)
    point[free] = Quadratic.of(at.restricted(point, free)).with_ridge().lowest()
    return point
