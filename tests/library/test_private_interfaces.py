# SPDX-License-Identifier: Apache-2.0
"""Only three files use private interfaces of libraries, and the interfaces still work.

``tests/core/test_simd.py`` tests the operations of lanes, ``tests/core/test_jit.py`` the cache of
kernels.
"""

import re

import numba
import numpy as np
import pytest
from numba import types
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.context import Context

from ema_core.simd import LANES, MASK, VECTOR, load, store

from ..packages import FOLDERS


def test_only_three_files_use_private_interfaces():
    private = re.compile(
        r"rclpy\._|numba\.core|cgutils|\b(?:self|node|executor)\._(?:take_\w*subscription"
        r"|state_machine|service_change_state|parameter_overrides)\b"
    )
    users = {
        path.name
        for name, folder in FOLDERS.items()
        for path in (folder / name).rglob("*.py")
        if private.search(path.read_text())
    }
    assert users == {"_jit.py", "rclpy_private.py", "simd.py"}


@pytest.mark.parametrize("number", [types.float64, types.float32, types.int64, types.intp])
def test_numbers_convert_to_a_vector_and_not_back(number: types.Type):
    context = Context()
    assert context.can_convert(number, VECTOR) == Conversion.safe
    for kind in (MASK, types.unicode_type, types.Array(types.float64, 1, "C")):
        assert context.can_convert(kind, VECTOR) is None
    assert context.can_convert(VECTOR, number) is None


def test_conversion_ranks_a_vector_after_the_number_itself():
    """Otherwise the sum of numbers in a kernel would be a vector."""
    assert Conversion.exact < Conversion.promote < Conversion.safe < Conversion.unsafe


def test_sum_of_numbers_stays_a_number_until_added_to_a_vector():
    @numba.njit
    def sums(values, increment, result):
        number = increment + 1
        store(result, 0, 0, load(values, 0) + number)
        return number

    values, result = np.arange(float(LANES)), np.empty((LANES, 1))
    number = sums(values, 1, result)
    assert (number, type(number)) == (2, int)
    np.testing.assert_array_equal(result[:, 0], values + 2.0)
