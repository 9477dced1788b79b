"""Robust linear regression, with a covariance that holds for rows correlated within strokes."""

from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array

_HUBER: Final = 2.5
_PASSES: Final = 4
_TINY: Final = 1e-12
_NORMAL: Final = 1.4826


class Regression(NamedTuple):
    """Coefficients, ``(p,)``, their covariance, ``(p, p)``, and the residuals, ``(n,)``."""

    values: Array
    covariance: Array
    residuals: Array


def regress(
    design: Array, target: Array, clusters: Array, prior: Array, prior_sigma: Array
) -> Regression:
    """Fit ``target`` by the columns of ``design``, insensitive to outliers.

    Parameters
    ----------
    design, target
        ``(n, p)`` and ``(n,)``.
    clusters
        Number of the stroke of each row; errors are independent between strokes only.
    prior, prior_sigma
        Weak normal prior of the coefficients, ``(p,)``: it decides what the rows leave open.

    Notes
    -----
    Huber's weights with a threshold of 2.5 standard deviations, and the sandwich covariance over
    clusters, scaled by G / (G - p) and never below that of independent errors (Liang and Zeger,
    1986).
    """
    n, p = design.shape
    weights = np.ones(n)
    precision = np.diag(prior_sigma**-2.0)
    values = prior
    for _ in range(_PASSES):
        residuals = target - design @ values if _ else target
        if _:
            scale = _NORMAL * float(np.median(np.abs(residuals))) + _TINY
            weights = 1.0 / np.maximum(1.0, np.abs(residuals) / (_HUBER * scale))
        normal = design.T @ (weights[:, None] * design)
        noise = max(_TINY, float(weights @ residuals**2) / n) if _ else float(np.var(target))
        matrix = normal + noise * precision
        values = np.linalg.solve(
            matrix, design.T @ (weights * target) + noise * (precision @ prior)
        )
    residuals = target - design @ values
    noise = float(weights @ residuals**2) / max(1, n - p)
    bread = np.linalg.inv(normal + noise * precision)
    scores = design * (weights * residuals)[:, None]
    groups, index = np.unique(clusters, return_inverse=True)
    sums = np.zeros((len(groups), p))
    np.add.at(sums, index, scores)
    count = len(groups)
    sandwich = bread @ (sums.T @ sums * (count / max(1, count - p)) + noise**2 * precision) @ bread
    white = noise * bread
    return Regression(values, _at_least(sandwich, white), residuals)


def _at_least(covariance: Array, floor: Array) -> Array:
    """Return a covariance that is in no direction smaller than another."""
    scale = np.sqrt(np.diag(floor))
    relative = np.linalg.cholesky(floor / np.outer(scale, scale) + _TINY * np.eye(len(scale)))
    inverse = np.linalg.inv(relative)
    inner = inverse @ (covariance / np.outer(scale, scale)) @ inverse.T
    values, vectors = np.linalg.eigh((inner + inner.T) / 2.0)
    lifted = vectors @ np.diag(np.maximum(values, 1.0)) @ vectors.T
    return np.outer(scale, scale) * (relative @ lifted @ relative.T)
