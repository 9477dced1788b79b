# SPDX-License-Identifier: Apache-2.0
"""Vectors of kernels: each lane gives the same result as numpy or a float."""

import itertools
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from ema_core.simd import LANES, any_lane, broadcast, load, select, store

SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.7, -1e300, 5e-324, math.inf, -math.inf, math.nan]
# Each special value is combined with each other; vectors are filled up from the front.
PAIRS = list(itertools.product(SPECIAL, SPECIAL))
PAIRS += PAIRS[: -len(PAIRS) % LANES]
A, B = np.array(PAIRS).T.copy()


def in_lanes(function: Any, *arrays: np.ndarray) -> np.ndarray:
    """Return the results of a function of vectors for arrays, ``(n, k)`` with its k results."""
    compiled: Any = numba.njit(function, error_model="numpy")

    @numba.njit
    def run(arrays):
        result = np.empty((len(arrays[0]), len(compiled(*load(arrays, 0)))))
        for first in range(0, len(result), LANES):
            for column, lanes in enumerate(compiled(*load(arrays, first))):
                store(result, first, column, lanes)
        return result

    return run(arrays)


OPERATIONS = (
    *("a + b", "a - b", "a * b", "a / b", "copysign(a, b)", "min(a, b)", "max(a, b)"),
    *("-a", "abs(a)", "floor(a)", "select(a < b, a, b)", "select(a <= b, a, b)"),
    *("select(a > b, a, b)", "select(a >= b, a, b)", "select(a == b, a, 7.0)"),
    *("select(a != b, a, 7.0)", "select((a < 1.0) & (b < 1.0), a, 7.0)"),
    *("select((a < 1.0) | (b < 1.0), a, 7.0)", "select(~(a < b), a, b)"),
    # A scalar applies to all lanes.
    *("2.0 - a", "a - 2", "3 / a", "max(0.25, min(a, 1))", "select(a > 0.5, 1, a)"),
    "broadcast(4) * broadcast(0.5) + a",
)


def function_of(operations: Iterable[str], **names: Any) -> Any:
    """Return the function of a and b that computes all operations, with ``names`` in scope."""
    return eval(f"lambda a, b: ({', '.join(operations)},)", names)


@pytest.mark.slow
def test_lanes_give_the_same_results_as_arrays():
    of_lanes = function_of(
        OPERATIONS, copysign=math.copysign, floor=math.floor, select=select, broadcast=broadcast
    )
    of_arrays = function_of(
        OPERATIONS,
        copysign=np.copysign,
        floor=np.floor,
        select=np.where,
        broadcast=float,
        # As for floats: the first argument if one is NaN or both are equal.
        min=lambda a, b: np.where(b < a, b, a),
        max=lambda a, b: np.where(b > a, b, a),
    )
    with np.errstate(all="ignore"):
        expected = of_arrays(A, B)
    for name, actual, reference in zip(
        OPERATIONS, in_lanes(of_lanes, A, B).T, expected, strict=True
    ):
        np.testing.assert_array_equal(actual, reference, err_msg=name)
        # The sign of zeros is equal, too.
        numbers = ~np.isnan(reference)
        assert np.array_equal(np.signbit(actual[numbers]), np.signbit(reference[numbers])), name


def test_variable_may_be_initialised_with_a_number():
    def total(a):
        result = 0.0
        for _ in range(5):
            result = result + a
        return (result,)

    a = np.arange(LANES, dtype=float)
    np.testing.assert_array_equal(in_lanes(total, a), 5 * a[:, None])


class Inner(NamedTuple):
    x: Any
    y: Any


class Outer(NamedTuple):
    number: float
    inner: Inner
    three: tuple[Any, Any, Any]


def test_load_keeps_the_structure_of_tuples_and_their_numbers():
    columns = np.arange(5.0 * 3 * LANES).reshape(5, -1)

    @numba.njit
    def run(tuples, first, result):
        loaded = load(tuples, first)
        whole: float = loaded.number
        if whole > 1.0:
            b, _, c = loaded.three
            store(result, 0, 0, loaded.inner.x + whole * loaded.inner.y)
            store(result, 0, 1, b + 100.0 * c)

    result = np.empty((LANES, 2))
    run(Outer(3.0, Inner(columns[0], columns[1]), tuple(columns[2:])), LANES + 1, result)
    lanes = slice(LANES + 1, 2 * LANES + 1)
    np.testing.assert_array_equal(result[:, 0], columns[0, lanes] + 3.0 * columns[1, lanes])
    np.testing.assert_array_equal(result[:, 1], columns[2, lanes] + 100.0 * columns[4, lanes])


@pytest.mark.parametrize("layout", ["rows", "columns", "every_other"])
def test_store_writes_only_its_lanes(layout):
    n = LANES + 5
    result = {
        "rows": np.zeros((n, 4)),
        "columns": np.zeros((4, n)).T,
        "every_other": np.zeros((2 * n, 8))[::2, ::2],
    }[layout]
    values = 1.0 + np.arange(LANES)
    numba.njit(lambda result, a: store(result, 3, 2, load(a, 0)))(result, values)
    expected = np.zeros((n, 4))
    expected[3 : 3 + LANES, 2] = values
    np.testing.assert_array_equal(result, expected)
    if result.base is not None:
        assert np.sum(result.base) == np.sum(values)


def test_any_lane_reads_only_the_lanes_of_its_vector():
    @numba.njit
    def any_above(values, limit):
        return any_lane(load(values, 0) > limit)

    assert not any_above(np.zeros(LANES), 0.5)
    for lane in range(LANES):
        assert any_above(np.eye(LANES)[lane], 0.5)
