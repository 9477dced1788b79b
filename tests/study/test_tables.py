# SPDX-License-Identifier: Apache-2.0
"""Tables of the thesis next to tables of the study, from complete, incomplete and missing runs."""

import numpy as np
import pandas as pd
import pytest

from ema_study.printed import PRINTED, SUM, TOTAL
from ema_study.sources import PRINTED_RUNS, with_own_code
from ema_study.tables import study_tables, with_coefficients, write_tables

from .synthetic_runs import synthetic_runs

THESIS_MODEL, FAST_MODEL = "thesis's model", "fast model"

pytestmark = pytest.mark.long

NUMBERS = list(range(8, 62))


@pytest.fixture(scope="module")
def runs():
    return pd.concat([synthetic_runs("fast", 3), synthetic_runs("thesis", 2)], ignore_index=True)


@pytest.fixture(scope="module")
def tables(runs):
    return {table.number: table for table in study_tables(runs)}


def sources_of(table):
    return list(table.frame.columns.unique("source"))


def test_printed_runs_are_next_to_those_of_the_study(tables):
    frame = tables[12].frame

    assert sources_of(tables[12]) == [PRINTED, THESIS_MODEL, FAST_MODEL]
    assert frame.loc["1", (PRINTED, "k7")] == 0.9263
    assert frame.loc["truth", (PRINTED, "k1")] == 0.25
    assert frame.loc["mean as printed", (PRINTED, "time [s]")] == 1662
    assert np.isnan(frame.loc["4", (FAST_MODEL, "error [%]")])


def test_code_of_the_thesis_is_listed_under_its_algorithm(tables, runs):
    own_code = with_own_code(FAST_MODEL)
    of_table = runs[(runs["table"] == 13) & (runs["model"] == "fast")]
    errors = of_table[of_table["algorithm"] == "de_thesis"].set_index("run")["error_percent"]
    errors = errors[~errors.index.duplicated(keep="first")]

    assert own_code not in sources_of(tables[11])
    assert own_code in sources_of(tables[13])
    assert tables[13].frame.loc["2", (own_code, "error [%]")] == pytest.approx(errors[2])
    assert tables[57].frame[own_code, "error [%]"].dropna().index.unique("algorithm").tolist() == [
        "de",
        "gwo",
    ]


def test_runs_with_the_printed_rule_are_excluded(runs):
    printed_rule = runs["rule"] == "printed"
    spoiled = runs.assign(error_percent=runs["error_percent"].where(~printed_rule, 1e6))

    assert printed_rule.any()
    for table in study_tables(spoiled):
        errors = table.frame.select_dtypes("number")
        assert not (errors.abs() > 5e5).any(axis=None)


def test_reliability_coefficient_follows_its_formula():
    times = pd.Series({"ga": 1.0, "pso": 2.0, "de": 3.0, "gwo": 4.0})
    errors = times**0.0

    coefficients = with_coefficients(times, errors)["RC"].drop(SUM)
    assert coefficients.tolist() == pytest.approx([90.0, 80.0, 70.0, 60.0])
    errors["gwo"] = np.nan
    assert with_coefficients(times, errors)["RC"].isna().all()


@pytest.mark.parametrize("missing", ["all", "most", "one algorithm"])
def test_tables_of_incomplete_runs_have_empty_cells(missing, runs):
    fewer = {
        "all": pd.DataFrame(),
        "most": runs[(runs["table"] == 20) & (runs["run"] == 1) & (runs["model"] == "fast")],
        "one algorithm": runs[(runs["algorithm"] != "pso") & (runs["model"] == "fast")],
    }[missing]

    tables = {table.number: table for table in study_tables(fewer)}

    assert list(tables) == NUMBERS
    assert (FAST_MODEL in sources_of(tables[58])) == (missing != "all")
    if missing != "all":
        coefficients = tables[60].frame[FAST_MODEL].filter(like="RC")
        assert np.isnan(coefficients.to_numpy()).all()
        total = tables[58].frame[FAST_MODEL][TOTAL]
        assert np.isnan(total["pso", "low"])
        assert np.isnan(total["ga", "low"]) == (missing == "most")


def test_written_tables_can_be_read_again(tables, tmp_path):
    paths = write_tables(tables.values(), tmp_path / "new" / "tables")

    assert [path.name for path in paths] == [f"table_{number:02d}.csv" for number in NUMBERS]
    csv = pd.read_csv(paths[NUMBERS.index(60)], index_col=0)
    products = tables[60].frame[PRINTED_RUNS, "total, time x error [s.%]"]
    assert csv.loc[SUM, "printed runs: total, time x error [s.%]"] == pytest.approx(
        products[SUM], rel=1e-6
    )
