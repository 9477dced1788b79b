# SPDX-License-Identifier: Apache-2.0
"""Robust linear regression, with a covariance that is valid for rows correlated within strokes."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array

_HUBER: Final = 2.5
_PASSES: Final = 4
_TINY: Final = 1e-12
_NORMAL: Final = 1.4826


class CoefficientPrior(NamedTuple):
    """Means and standard deviations of a weak normal prior of the coefficients, ``(p,)`` each."""

    values: Array
    sigmas: Array


class Robust(NamedTuple):
    """Result of a robust fit: coefficients, ``(p,)``, row weights and residuals, ``(n,)``."""

    values: Array
    weights: Array
    residuals: Array


class Regression(NamedTuple):
    """Coefficients, ``(p,)``, their covariance, ``(p, p)``, and the residuals, ``(n,)``."""

    values: Array
    covariance: Array
    residuals: Array


def robust_fit(design: Array, target: Array, prior: CoefficientPrior) -> Robust:
    """Return a robust linear regression of ``target``, ``(n,)``, on ``design``, ``(n, p)``.

    Outliers have reduced weights (Huber's function).
    """
    precision = np.diag(prior.sigmas**-2.0)
    weights, noise = np.ones(len(target)), float(np.var(target))
    values, square = prior.values, _square(target)
    for step in range(_PASSES):
        if step:
            residuals = target - design @ values
            scale = _NORMAL * float(np.median(np.abs(residuals))) + _TINY * math.sqrt(square)
            weights = 1.0 / np.maximum(1.0, np.abs(residuals) / (_HUBER * scale))
            noise = max(_TINY * square, float(weights @ residuals**2) / len(residuals))
        matrix = design.T @ (weights[:, None] * design) + noise * precision
        moment = design.T @ (weights * target) + noise * (precision @ prior.values)
        values = np.asarray(np.linalg.solve(matrix, moment), dtype=np.float64)
    return Robust(values, weights, target - design @ values)


def regress(
    design: Array, target: Array, clusters: NDArray[np.intp], prior: CoefficientPrior
) -> Regression:
    """Return a robust linear regression of ``target`` on ``design``, with its covariance.

    Parameters
    ----------
    design, target
        ``(n, p)`` and ``(n,)``.
    clusters
        Stroke index of each row, ``(n,)``. Only errors of different strokes are independent.
    prior
        Weak prior, which regularises undetermined coefficients.

    Notes
    -----
    Huber's weights with a threshold of 2.5 standard deviations, and the sandwich covariance over
    clusters, scaled by G / (G - p), with the covariance of independent errors as its lower bound
    (Liang and Zeger, 1986).
    """
    values, weights, residuals = robust_fit(design, target, prior)
    n, p = design.shape
    precision = np.diag(prior.sigmas**-2.0)
    noise = float(weights @ residuals**2) / max(1, n - p) + _TINY**2 * _square(target)
    information = design.T @ (weights[:, None] * design) + noise * precision
    bread = np.asarray(np.linalg.inv(information), dtype=np.float64)
    _, groups = np.unique(clusters, return_inverse=True)
    count = int(groups.max()) + 1
    scores = design * (weights * residuals)[:, None]
    sums = np.stack([np.bincount(groups, column, count) for column in scores.T], axis=1)
    inner = sums.T @ sums * (count / max(1, count - p)) + noise**2 * precision
    return Regression(values, _at_least(bread @ inner @ bread, noise * bread), residuals)


def _square(target: Array) -> float:
    """Return the mean square of the target, to scale rounding errors; 1 if it is 0."""
    return float(np.mean(target**2)) or 1.0


def _at_least(covariance: Array, floor: Array) -> Array:
    """Return an exactly symmetric covariance, increased to ``floor`` in every direction."""
    scale = np.sqrt(np.diag(floor))
    units = np.outer(scale, scale)
    root = np.linalg.cholesky(floor / units + _TINY * np.eye(len(scale)))
    inverse = np.linalg.inv(root)
    inner = inverse @ (covariance / units) @ inverse.T
    values, vectors = np.linalg.eigh((inner + inner.T) / 2.0)
    lifted = vectors @ np.diag(np.maximum(values, 1.0)) @ vectors.T
    covariance = units * (root @ lifted @ root.T)
    return (covariance + covariance.T) / 2.0
