"""The vectors of kernels: every operation, lane by lane, is that of numpy or of a float."""

import itertools
import math
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from ema_core.simd import LANES, any_lane, broadcast, load, select, store

SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.7, -1e300, 5e-324, math.inf, -math.inf, math.nan]
# Every special value meets every other; what is missing to full vectors comes from the front.
PAIRS = list(itertools.product(SPECIAL, SPECIAL))
PAIRS += PAIRS[: -len(PAIRS) % LANES]
A, B = np.array(PAIRS).T.copy()


def in_lanes(function: Any, *arrays: np.ndarray) -> np.ndarray:
    """What a function of vectors gives for arrays, ``(n,)`` with full vectors."""
    compiled = numba.njit(function, error_model="numpy")

    @numba.njit
    def run(arrays, result):
        for first in range(0, len(result), LANES):
            store(result, first, 0, compiled(*load(arrays, first)))

    result = np.empty((len(arrays[0]), 1))
    run(arrays, result)
    return result[:, 0]


def assert_same(result: np.ndarray, expected: np.ndarray) -> None:
    """Equal with the sign of zeros, and not a number in the same places."""
    np.testing.assert_array_equal(result, expected)
    numbers = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(result[numbers]), np.signbit(expected[numbers]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of_lanes", "of_arrays"),
    [
        (lambda a, b: a + b, np.add),
        (lambda a, b: a - b, np.subtract),
        (lambda a, b: a * b, np.multiply),
        (lambda a, b: a / b, np.divide),
        (lambda a, b: math.copysign(a, b), np.copysign),
        # As for floats, the first where one is not a number or both are equal.
        (lambda a, b: min(a, b), lambda a, b: np.where(b < a, b, a)),
        (lambda a, b: max(a, b), lambda a, b: np.where(b > a, b, a)),
        (lambda a, b: -a, lambda a, b: -a),
        (lambda a, b: abs(a), lambda a, b: np.abs(a)),
        (lambda a, b: math.floor(a), lambda a, b: np.floor(a)),
        (lambda a, b: select(a < b, a, b), lambda a, b: np.where(a < b, a, b)),
        (lambda a, b: select(a <= b, a, b), lambda a, b: np.where(a <= b, a, b)),
        (lambda a, b: select(a > b, a, b), lambda a, b: np.where(a > b, a, b)),
        (lambda a, b: select(a >= b, a, b), lambda a, b: np.where(a >= b, a, b)),
        (lambda a, b: select(a == b, a, 7.0), lambda a, b: np.where(a == b, a, 7.0)),
        (lambda a, b: select(a != b, a, 7.0), lambda a, b: np.where(a != b, a, 7.0)),
        (
            lambda a, b: select((a < 1.0) & (b < 1.0), a, 7.0),
            lambda a, b: np.where((a < 1) & (b < 1), a, 7),
        ),
        (
            lambda a, b: select((a < 1.0) | (b < 1.0), a, 7.0),
            lambda a, b: np.where((a < 1) | (b < 1), a, 7),
        ),
        (lambda a, b: select(~(a < b), a, b), lambda a, b: np.where(a < b, b, a)),
    ],
)
def test_lanes_do_what_arrays_do(of_lanes, of_arrays):
    with np.errstate(all="ignore"):
        assert_same(in_lanes(of_lanes, A, B), of_arrays(A, B))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of_lanes", "of_arrays"),
    [
        (lambda a: 2.0 - a, lambda a: 2.0 - a),
        (lambda a: a - 2, lambda a: a - 2.0),
        (lambda a: 3 / a, lambda a: 3.0 / a),
        (lambda a: max(0.25, min(a, 1)), lambda a: np.clip(a, 0.25, 1.0)),
        (lambda a: select(a > 0.5, 1, a), lambda a: np.where(a > 0.5, 1.0, a)),
        (lambda a: broadcast(4) * broadcast(0.5) + a, lambda a: 2.0 + a),
    ],
)
def test_number_stands_for_all_lanes(of_lanes, of_arrays):
    a = np.random.default_rng(1).normal(0.5, 1.0, 4 * LANES)
    np.testing.assert_array_equal(in_lanes(of_lanes, a), of_arrays(a))


def test_variable_may_begin_as_a_number():
    def total(a):
        result = 0.0
        for _ in range(5):
            result = result + a
        return result

    a = np.arange(LANES, dtype=float)
    np.testing.assert_array_equal(in_lanes(total, a), 5 * a)


class Inner(NamedTuple):
    x: Any
    y: Any


class Outer(NamedTuple):
    number: float
    inner: Inner
    three: tuple[Any, Any, Any]


def test_load_keeps_the_shape_of_tuples_and_their_numbers():
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
def test_store_writes_its_lanes_and_nothing_else(layout):
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


def test_any_lane_sees_each_lane_and_no_other():
    @numba.njit
    def any_above(values, limit):
        return any_lane(load(values, 0) > limit)

    assert not any_above(np.zeros(LANES), 0.5)
    for lane in range(LANES):
        assert any_above(np.eye(LANES)[lane], 0.5)
