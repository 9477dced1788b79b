# SPDX-License-Identifier: Apache-2.0
"""The transcribed data of the thesis are complete and consistent with its own sums."""

import numpy as np
import pytest

from ema_study.cases import ALGORITHMS, LEVELS, SINGLE_FAULTS
from ema_study.printed import (
    MEAN,
    OVERVIEWS,
    PRINTED,
    SIGMA,
    SUM,
    TOTAL,
    printed_runs,
    printed_table,
)


def test_each_table_has_ten_runs_of_each_algorithm():
    runs = printed_runs()

    assert len(runs) == 500
    assert set(runs["model"]) == {PRINTED}
    sizes = runs.groupby(["table", "algorithm", "level"]).size()
    assert set(sizes) == {10}
    assert set(sizes.index.unique("table")) == set(printed_table("run_means").index.unique("table"))


@pytest.mark.parametrize(("table", "half_a_digit"), [(58, 0.0005), (59, 0.5)])
def test_overviews_agree_with_totals_and_deviations_of_their_rows(table, half_a_digit):
    # Totals come from unrounded cells, so they may be off by twice half a digit. A deviation of
    # five values changes by at most 1.12 times the largest change of a value.
    printed = printed_table(f"table_{table}")
    rows = printed.drop(index=(MEAN, ""))
    faults = rows[list(SINGLE_FAULTS)]

    assert OVERVIEWS.keys() == {58, 59}
    assert len(rows) == len(ALGORITHMS) * len(LEVELS)
    tolerance = 2.2 * half_a_digit
    np.testing.assert_allclose(rows[TOTAL], faults.mean(axis=1), rtol=0, atol=tolerance)
    np.testing.assert_allclose(rows[SIGMA], faults.std(axis=1), rtol=0, atol=tolerance)
    last = printed.loc[(MEAN, ""), list(SINGLE_FAULTS)].to_numpy(dtype=float)
    np.testing.assert_allclose(last, faults.mean(), rtol=0, atol=tolerance)


def test_reliability_coefficients_add_up_to_300_percent():
    single = printed_table("table_60").drop(index=SUM).xs("RC", axis=1, level=1)
    multiple = printed_table("table_61").drop(index=SUM)["RC"]

    # four coefficients with two decimals
    np.testing.assert_allclose(single.sum(), 300.0, rtol=0, atol=0.0201)
    assert multiple.sum() == pytest.approx(300.0, abs=0.0201)
