"""Whether our errors agree with the thesis's, and the reasons that are given where not."""

import numpy as np
import pandas as pd
import pytest

from ema_study.agreement import agreement, time_per_10000_windows
from ema_study.cases import CASES
from ema_study.printed_runs import PRINTED, printed_runs
from ema_study.sources import FAST_MODEL, THESIS_MODEL

from .synthetic_runs import synthetic_runs


@pytest.fixture
def runs():
    """Return three runs with the thesis's model that are the thesis's own ones."""
    ours = synthetic_runs("thesis", 3)
    return ours[(ours["algorithm"] == "pso") & (ours["rule"] != "printed")]


def side(runs, fault, source):
    """Return what the comparison says of a fault and a source, by quantity."""
    rows = agreement(runs).T.to_dict()
    return {what: value for (one, what), value in rows[fault].items() if one == source}


def changed(runs, table, **columns):
    of_table = runs["table"] == table
    runs = runs.copy()
    for name, value in columns.items():
        runs.loc[of_table, name] = value
    return runs


def test_the_thesis_side_is_that_of_its_particle_swarm_runs():
    row = side(pd.DataFrame(), "friction high", PRINTED)

    assert (row["component"], row["true value"], row["runs"]) == ("k1", 0.75, 10)
    assert (row["lowest error [%]"], row["highest error [%]"]) == (2.32, 3.38)
    assert row["mean error [%]"] == pytest.approx(2.77)
    assert 0.736 < row["mean estimate"] < 0.739


def test_every_fault_has_a_row_without_any_runs():
    table = agreement(pd.DataFrame())

    assert list(table.index) == list(CASES)
    assert list(table.columns.unique("source")) == [PRINTED]


def test_the_multiple_fault_is_that_of_the_study_of_precision(runs):
    spoiled = changed(runs, 56, error_percent=1e3)

    thesis, ours = (side(spoiled, "multiple", source) for source in (PRINTED, THESIS_MODEL))

    assert thesis["mean error [%]"] == pytest.approx(1.0646)
    assert thesis["component"] == ""
    assert ours["mean error [%]"] < 10.0
    assert np.isnan(ours["mean estimate"])


def test_a_mean_error_within_the_range_needs_no_reason(runs):
    row = side(changed(runs, 16, error_percent=2.9), "friction high", THESIS_MODEL)

    assert row["within"] is True
    assert row["reason"] == ""
    assert row["runs"] == 3


@pytest.mark.parametrize(
    ("model", "cause"), [("fast", "torque constant"), ("thesis", "gear ratio")]
)
def test_a_lower_error_is_explained_by_the_smaller_bias(runs, model, cause):
    better = changed(runs, 16, error_percent=0.5, k1=0.7480).assign(model=model)
    label = {"fast": FAST_MODEL, "thesis": THESIS_MODEL}[model]

    row = side(better, "friction high", label)

    assert row["within"] is False
    assert row["mean estimate"] == pytest.approx(0.748)
    assert "closer to the truth: off by -0.0020, the thesis's by -0.0120" in row["reason"]
    assert cause in row["reason"]


def test_a_smaller_bias_is_not_claimed_where_there_is_none(runs):
    other = changed(runs, 16, error_percent=0.5, k1=0.70).assign(model="fast")

    reason = side(other, "friction high", FAST_MODEL)["reason"]

    assert "no closer to the truth" in reason
    assert "torque constant" not in reason


def test_eccentricity_fails_with_the_printed_equation_as_the_truth_costs_more(runs):
    failed = changed(runs, 39, error_percent=15.7, cost=0.02)

    row = side(failed, "eccentricity low", THESIS_MODEL)

    assert row["within"] is False
    assert "eq. 4.24 as printed" in row["reason"]
    assert "3 of 3 searches found a point that costs less" in row["reason"]


def test_a_search_that_stopped_early_is_not_blamed_on_the_model(runs):
    early = changed(runs, 21, error_percent=5.0, cost=1.0)

    reason = side(early, "backlash low", THESIS_MODEL)["reason"]

    assert "3 of 3 searches ended above the cost of the truth" in reason
    assert "does not describe" not in reason
    assert "eq. 4.24" not in reason


def test_other_algorithms_and_the_printed_rule_do_not_count(runs):
    others = runs[runs["table"] == 16]
    noise = pd.concat(
        [
            others.assign(rule="printed", error_percent=100.0),
            others.assign(algorithm="ga", error_percent=100.0),
            changed(others, 16, error_percent=2.5),
        ]
    )

    row = side(noise, "friction high", THESIS_MODEL)

    assert (row["runs"], row["mean error [%]"]) == (3, 2.5)


def test_a_fault_without_runs_is_neither_within_nor_without(runs):
    row = side(runs[runs["table"] == 16], "gain low", THESIS_MODEL)

    assert row["runs"] == 0
    assert row["within"] is None
    assert row["reason"] == ""


def test_time_of_10000_windows_is_the_median_over_runs():
    ours = synthetic_runs("fast", 3).assign(time_s=2.0, evaluations=1000)
    ours = ours[ours["table"] <= 14]
    ours.loc[ours["table"] <= 10, "time_s"] = 1e6  # most runs of DE, which do not count

    table = time_per_10000_windows(ours)

    thesis = printed_runs()
    thesis = thesis[(thesis["algorithm"] == "ga") & (thesis["table"] > 10)]
    expected = (10_000 * thesis["time_s"] / (50 * thesis["generations"])).median()
    assert table.loc["GA", PRINTED] == pytest.approx(expected)
    assert table.loc["GA", FAST_MODEL] == pytest.approx(20.0)
    assert table.loc["DE", FAST_MODEL] == pytest.approx(20.0)
    assert table.loc["DE, thesis's code", FAST_MODEL] == pytest.approx(20.0)
    assert list(time_per_10000_windows(pd.DataFrame()).columns) == [PRINTED]
