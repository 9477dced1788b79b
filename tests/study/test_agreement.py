# SPDX-License-Identifier: Apache-2.0
"""Errors of the study agree with the errors in the thesis."""

import numpy as np
import pandas as pd
import pytest

from ema_study.agreement import agreement, time_per_10000_windows
from ema_study.printed import PRINTED, printed_runs

from .synthetic_runs import synthetic_runs

THESIS_MODEL, FAST_MODEL = "thesis's model", "fast model"


@pytest.fixture
def runs():
    """Return three runs with the thesis's model, whose results are those printed in the thesis."""
    ours = synthetic_runs("thesis", 3)
    return ours[(ours["algorithm"] == "pso") & (ours["rule"] != "printed")]


def side(runs, fault, source):
    """Return the comparison for a fault and a source, by quantity."""
    rows = agreement(runs).T.to_dict()
    return {
        what: value for (row_source, what), value in rows[fault].items() if row_source == source
    }


def changed(runs, table, **columns):
    of_table = runs["table"] == table
    runs = runs.copy()
    for name, value in columns.items():
        runs.loc[of_table, name] = value
    return runs


def test_the_thesis_errors_come_from_its_particle_swarm_runs():
    row = side(pd.DataFrame(), "friction high", PRINTED)

    assert (row["component"], row["true value"], row["runs"]) == ("k1", 0.75, 10)
    assert (row["lowest error [%]"], row["highest error [%]"]) == (2.32, 3.38)
    assert row["mean error [%]"] == pytest.approx(2.77)
    assert 0.736 < row["mean estimate"] < 0.739


def test_the_multiple_fault_comes_from_the_study_of_precision(runs):
    spoiled = changed(runs, 56, error_percent=1e3)

    thesis, ours = (side(spoiled, "multiple", source) for source in (PRINTED, THESIS_MODEL))

    assert thesis["mean error [%]"] == pytest.approx(1.0646)
    assert thesis["component"] == ""
    assert ours["mean error [%]"] < 10.0
    assert np.isnan(ours["mean estimate"])


@pytest.mark.parametrize(
    ("error", "verdict"), [(2.9, "within"), (0.5, "better"), (2.31, "better"), (3.39, "worse")]
)
def test_verdict_states_on_which_side_of_the_range_an_error_is(runs, error, verdict):
    row = side(changed(runs, 16, error_percent=error), "friction high", THESIS_MODEL)

    assert (row["verdict"], row["runs"]) == (verdict, 3)


def test_time_of_10000_windows_is_the_median_over_runs():
    ours = synthetic_runs("fast", 3).assign(time_s=2.0, evaluations=1000)
    ours = ours[ours["table"] <= 14]
    ours.loc[ours["table"] <= 10, "time_s"] = 1e6  # Most runs use DE, and do not count.

    table = time_per_10000_windows(ours)

    thesis = printed_runs()
    for algorithm, uncounted in (("ga", 1), ("pso", 1), ("de", 1), ("gwo", 0)):
        of_it = thesis[(thesis["algorithm"] == algorithm) & (thesis["table"] > 10)]
        evaluations = 50 * (of_it["generations"] + uncounted)
        expected = (10_000 * of_it["time_s"] / evaluations).median()
        assert table.loc[algorithm.upper(), PRINTED] == pytest.approx(expected)
    assert table.loc["GA", FAST_MODEL] == pytest.approx(20.0)
    assert table.loc["DE", FAST_MODEL] == pytest.approx(20.0)
    assert table.loc["DE, thesis's code", FAST_MODEL] == pytest.approx(20.0)
    assert list(time_per_10000_windows(pd.DataFrame()).columns) == [PRINTED]
