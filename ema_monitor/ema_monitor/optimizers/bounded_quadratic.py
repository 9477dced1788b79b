# SPDX-License-Identifier: Apache-2.0
"""Minimisation of a convex quadratic function in the unit box."""

import math

import numpy as np

from ema_core._jit import kernel
from ema_core.arrays import Array


@kernel()
def room(x, move):
    """Return the largest multiple of a component's move that stays in the box [-]; may exceed 1.

    It is inf for a move of 0.
    """
    if move == 0.0:
        return math.inf
    return ((1.0 - x) if move > 0.0 else x) / abs(move)


@kernel()
def slope_at(x, hessian, gradient, start):
    """Return a quadratic function's gradient at ``x``, ``(d,)``, from the gradient at ``start``."""
    slope = gradient.copy()
    for i in range(len(x)):
        for j in range(len(x)):
            slope[i] += hessian[i, j] * (x[j] - start[j])
    return slope


@kernel()
def step_of_free(hessian, slope, held):
    """Return the Newton step by Cholesky decomposition, ``(d,)``; 0 for ``held`` components."""
    d = len(slope)
    lower, step = np.zeros((d, d)), np.zeros(d)
    for i in range(d):
        if held[i]:
            continue
        value = -slope[i]
        for j in range(i):
            rest = hessian[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            if not held[j]:
                lower[i, j] = rest / lower[j, j]
            value -= lower[i, j] * step[j]
        rest = hessian[i, i]
        for k in range(i):
            rest -= lower[i, k] * lower[i, k]
        lower[i, i] = math.sqrt(rest)
        step[i] = value / lower[i, i]
    for i in range(d - 1, -1, -1):
        if held[i]:
            continue
        for k in range(i + 1, d):
            step[i] -= lower[k, i] * step[k]
        step[i] /= lower[i, i]
    return step


@kernel(nogil=False)
def lowest_in_box(hessian: Array, gradient: Array, start: Array) -> Array:
    """Return the minimiser of a convex quadratic function in the unit box, ``(d,)``.

    The function is ``g (x - start) + (x - start) H (x - start) / 2``. Its gradient g at ``start``
    is ``gradient``, ``(d,)``; its Hessian H is ``hessian``, ``(d, d)``, which must be positive
    definite.
    """
    return lowest_of(hessian, gradient, start, start, np.ones(len(start), dtype=np.bool_))


@kernel(nogil=False)
def lowest_of_each(hessian, gradient, at, starts, free):
    """Return the minimiser found from each start, ``(n, d)``.

    ``starts`` and ``free`` are ``(n, d)``; `lowest_of` describes the other arguments.
    """
    best = starts.copy()
    for i in range(len(starts)):
        best[i] = lowest_of(hessian, gradient, at, starts[i], free[i])
    return best


@kernel(nogil=False)
def lowest_of(hessian, gradient, at, start, free):
    """Return the minimiser of a quadratic function over its ``free`` components, ``(d,)``.

    The search is limited to the unit box. All other components keep their values in ``start``.
    Primal active-set method: move towards the minimum over the free components up to the first
    bound, and fix the component there. At a minimum, release the fixed component with the steepest
    descent.
    ``gradient`` is the gradient at the point ``at``, which may differ from the start.
    """
    d = len(start)
    x, held, steepest_start = start.copy(), ~free, 0.0
    slope = slope_at(x, hessian, gradient, at)
    for i in range(d):
        if free[i]:
            steepest_start = max(steepest_start, abs(slope[i]))
    # Each iteration settles a face of the box. Far fewer iterations than the limit are needed.
    for _ in range(10 * d):
        move = step_of_free(hessian, slope, held)
        reach = 1.0
        for i in range(d):
            reach = min(reach, room(x[i], move[i]))
        for i in range(d):
            if reach < 1.0 and room(x[i], move[i]) <= reach:
                held[i], x[i] = True, 1.0 if move[i] > 0.0 else 0.0
            else:
                x[i] = min(max(x[i] + reach * move[i], 0.0), 1.0)
        slope = slope_at(x, hessian, gradient, at)
        if reach < 1.0:
            continue
        most, steepest = 0.0, 0
        for i in range(d):
            descent = -slope[i] if x[i] == 0.0 else slope[i]
            if held[i] and free[i] and descent > most:
                most, steepest = descent, i
        if most <= 1e-14 * steepest_start:
            break
        held[steepest] = False
    return x
