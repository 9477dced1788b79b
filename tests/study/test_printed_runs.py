"""The thesis's data: complete, and transcribed so that its own sums come out."""

import numpy as np
import pandas as pd
import pytest

from ema_study.cases import LEVELS, SINGLE_FAULTS
from ema_study.plan import ALGORITHMS
from ema_study.printed import (
    MEAN,
    OVERVIEWS,
    PRINTED,
    SIGMA,
    SUM,
    TOTAL,
    fault_means,
    ga_trials,
    overview,
    printed_runs,
    reliability_multiple,
    reliability_single,
    run_means,
)
from ema_study.run import K


def test_there_are_ten_runs_of_each_algorithm_in_each_table():
    runs = printed_runs()

    assert len(runs) == 500
    assert set(runs["model"]) == {PRINTED}
    sizes = runs.groupby(["table", "algorithm", "level"]).size()
    assert set(sizes) == {10}
    assert set(sizes.index.unique("table")) == set(run_means().index.unique("table"))


def test_first_pso_run_is_as_in_table_12():
    runs = printed_runs()
    run = runs[(runs["table"] == 12) & (runs["run"] == 1)].iloc[0]

    expected = [0.2478, 0.0001, 0.0, 0.0002, 0.0001, 0.0015, 0.9263, 0.4946]
    assert run[K].tolist() == expected
    assert (run["time_s"], run["error_percent"], run["generations"]) == (1953, 0.60, 152)


@pytest.mark.parametrize(("table", "half_a_digit"), [(58, 0.0005), (59, 0.5)])
def test_overviews_have_the_totals_and_deviations_of_their_rows(table, half_a_digit):
    # Totals come from unrounded cells, so they may be off by half a digit twice; a deviation of
    # five moves by at most 1.12 times what its members move by.
    printed = overview(table)
    rows = printed.drop(index=(MEAN, ""))
    faults = rows[list(SINGLE_FAULTS)]

    assert OVERVIEWS.keys() == {58, 59}
    assert len(rows) == len(ALGORITHMS) * len(LEVELS)
    tolerance = 2.2 * half_a_digit
    np.testing.assert_allclose(rows[TOTAL], faults.mean(axis=1), rtol=0, atol=tolerance)
    np.testing.assert_allclose(rows[SIGMA], faults.std(axis=1), rtol=0, atol=tolerance)
    last = printed.loc[(MEAN, ""), list(SINGLE_FAULTS)].to_numpy(dtype=float)
    np.testing.assert_allclose(last, faults.mean(), rtol=0, atol=tolerance)


def test_summaries_of_faults_are_the_means_of_the_means_beside_the_runs():
    means = run_means().reset_index()
    for printed in fault_means().reset_index().to_dict("records"):
        table, level = printed["table"], printed["level"]
        first = table - 8 if level == "low" else table - 4
        rows = means[means["table"].between(first, first + 3)]
        # half a digit of the summary and half a digit of its members
        assert printed["time_s"] == pytest.approx(rows["time_s"].mean(), abs=1.0)
        assert printed["error_percent"] == pytest.approx(rows["error_percent"].mean(), abs=0.0101)


def test_reliability_coefficients_share_three_times_hundred_percent():
    single = reliability_single().drop(index=SUM).xs("RC", axis=1, level=1)
    multiple = reliability_multiple().drop(index=SUM)["RC"]

    # four coefficients of two decimals
    np.testing.assert_allclose(single.sum(), 300.0, rtol=0, atol=0.0201)
    assert multiple.sum() == pytest.approx(300.0, abs=0.0201)


def test_reliability_products_have_the_printed_sums():
    single = reliability_single().xs("time x error", axis=1, level=1)
    multiple = reliability_multiple()

    np.testing.assert_allclose(single.drop(index=SUM).sum(), single.loc[SUM], rtol=0, atol=2.5)
    products = multiple["time_s"] * multiple["error_percent"]
    pd.testing.assert_series_equal(
        products.drop(index=SUM),
        multiple["time x error"].drop(index=SUM),
        check_names=False,
        rtol=1e-12,
    )
    assert multiple.loc[SUM, "time x error"] == pytest.approx(products.sum(), abs=1e-6)


def test_trials_of_ga_are_as_in_table_8():
    trials = ga_trials()

    assert list(trials.index) == list(range(1, 13))
    assert list(trials.index[trials["parallel"]]) == [10, 11, 12]
    per_minute = 60.0 * trials["generations"] / trials["time_s"]
    assert per_minute[6] == pytest.approx(1.15)
    assert trials[["population", "time_s"]].iloc[-1].tolist() == [50, 2175]
