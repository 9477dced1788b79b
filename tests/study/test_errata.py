"""The thesis's slips: found where they are, and nowhere else."""

import csv
import re
import statistics
from collections import Counter
from importlib.resources import files

import pytest

from ema_study.errata import errata, printed_means_that_differ
from ema_study.errata.printed_means import (
    Comparison,
    comparisons,
    overviews_with,
    wrong_means,
)
from ema_study.printed_tables import run_means


@pytest.fixture(scope="module")
def slips():
    return errata()


@pytest.fixture(scope="module")
def rows():
    """Return the thesis's runs straight from their file, all cells as text."""
    with (files("ema_study") / "thesis_runs.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def one_about(slips, where):
    [slip] = [slip for slip in slips if slip.where.startswith(where)]
    return slip


def test_two_cells_and_what_follows_from_them_are_all_that_differ():
    differing = printed_means_that_differ()
    cells = set(zip(differing["table"], differing["cell"], strict=True))

    assert (58, "PSO high, eccentricity") in cells
    assert (59, "PSO low, short circuit") in cells
    assert set(differing["table"]) == {58, 59, 60}
    # In the overviews only PSO's rows differ, and the mean over the algorithms' short circuit.
    of_overviews = {cell for table, cell in cells if table < 60}
    assert {cell for cell in of_overviews if not cell.startswith("PSO")} == {"mean, short circuit"}
    # In table 60 only the two faults that these cells belong to, and the total.
    assert {cell.split(",")[0] for table, cell in cells if table == 60} <= {
        "short circuit",
        "eccentricity",
        "total",
    }


def test_every_printed_mean_is_checked():
    checked = list(comparisons())
    by_table = {table: sum(one.table == table for one in checked) for table in range(8, 62)}

    assert sum(by_table[table] for table in run_means().index.unique("table")) == 2 * 50 - 2 + 4
    assert [by_table[table] for table in (19, 28, 37, 46, 55)] == [4] * 5
    assert (by_table[58], by_table[59]) == (8 * 7 + 5, 8 * 7 + 5)
    assert (by_table[60], by_table[61]) == (6 * 9, 9)


def test_a_difference_of_rounding_is_none():
    comparison = Comparison(12, "mean error", "%", 0.93, 0.935, 0.01)

    assert not comparison.differs
    assert comparison._replace(printed=0.92).differs


def test_every_slip_says_where_what_and_why(slips):
    assert len(slips) > 30
    for slip in slips:
        assert all(slip), slip
        assert "nan" not in slip.evidence.split(), slip
    assert len({(slip.where, slip.found) for slip in slips}) == len(slips)


def test_zero_phases_of_gwo_are_those_in_the_file(slips, rows):
    zeros = Counter(row["algorithm"] for row in rows if float(row["k7"]) == 0.0)
    sizes = Counter(row["algorithm"] for row in rows)
    others = sum(zeros.values()) - zeros["gwo"]

    leaders = one_about(slips, "Appendix B, section 5.5").evidence
    collapse = one_about(slips, "Sections 7.2.4, 7.3 (GWO)").evidence

    assert f"in {zeros['gwo']} of {sizes['gwo']} runs of GWO, in {others} of the" in leaders
    for algorithm in ("ga", "pso", "de", "gwo"):
        assert f"{algorithm.upper()} {zeros[algorithm]} of {sizes[algorithm]}" in collapse
    # What makes it tell: no true k7 is 0, and hardly any other run has it.
    assert min(float(row["true_k7"]) for row in rows) > 0.0
    assert others < 0.1 * zeros["gwo"]


def test_a_generation_too_many_is_told_by_the_time_of_its_neighbours(slips, rows):
    table = [row for row in rows if row["table"] == "48"]
    [odd] = [row for row in table if int(row["generations"]) > 200]
    paces = [float(row["time_s"]) / int(row["generations"]) for row in table if row is not odd]
    by_time = float(odd["time_s"]) / statistics.median(paces)
    [meant] = re.findall(r"probably (\d+)", one_about(slips, "Table 48").found)

    assert abs(int(meant) - by_time) < 1.0
    assert sorted([*meant, "0"]) == sorted(odd["generations"])


def test_stops_of_low_and_high_faults_are_those_in_the_file(slips, rows):
    slip = one_about(slips, "Sections 7.1, 7.2.1 (low and high)")
    own = [
        row for row in rows if row["algorithm"] in ("de", "gwo") and 11 <= int(row["table"]) <= 54
    ]
    stopped = Counter((row["fault"], row["level"]) for row in own if int(row["generations"]) < 200)
    never = {row["fault"] for row in own} - {fault for fault, level in stopped if level == "high"}

    assert never == {"friction", "eccentricity"}
    for fault in never:
        assert f"{fault} {stopped[fault, 'low']} and 0 of 20" in slip.evidence
        assert fault in slip.found
    # Only of friction there is a model that can say how well it fits.
    assert "of friction cost" in slip.evidence
    assert "of eccentricity cost" not in slip.evidence


def test_precision_study_ran_to_the_end_as_often_as_in_the_file(slips, rows):
    of_table = [row for row in rows if row["table"] == "57"]
    to_the_end = sum(int(row["generations"]) == 200 for row in of_table)

    evidence = one_about(slips, "Section 7.2.6").evidence
    assert f"{to_the_end} of {len(of_table)} runs made 200" in evidence


def test_starting_population_of_gwo_is_no_further_generation(slips, rows):
    evidence = one_about(slips, "Section 7.3 (time of a generation)").evidence
    for algorithm in ("ga", "pso", "de", "gwo"):
        of_table = [row for row in rows if (row["table"], row["algorithm"]) == ("56", algorithm)]
        time_s = statistics.fmean(float(row["time_s"]) for row in of_table)
        generations = statistics.fmean(int(row["generations"]) for row in of_table)
        pair = f"{algorithm.upper()} {time_s / generations:.1f} and"
        assert (pair in evidence) == (algorithm != "gwo")
        if algorithm != "gwo":
            assert f"{pair} {time_s / (generations + 1):.1f} s" in evidence
        else:
            assert f"GWO's are {time_s / generations:.1f} s" in evidence


def test_gwo_stopped_early_although_its_printed_code_does_not_let_it(slips, rows):
    gwo = [row for row in rows if row["algorithm"] == "gwo" and 11 <= int(row["table"]) <= 54]
    stopped = sum(int(row["generations"]) < 200 for row in gwo)
    [slip] = [one for one in slips if one.where == "Appendix B" and "Max_iter" in one.printed]

    assert f"{stopped} of the {len(gwo)} runs" in slip.evidence
    assert stopped > len(gwo) / 2


def test_threshold_is_judged_without_the_cases_that_eq_4_24_spoils(slips):
    [slip] = [one for one in slips if one.where == "Section 7.1" and "5e-4" in one.printed]
    low, high = map(float, re.findall(r"cost ([\d.]+) to ([\d.]+) A", slip.evidence)[0])

    assert 1e-3 < low < high < 0.02
    assert "9 of 9" in slip.evidence
    assert "eccentricity low" in slip.evidence.partition("Left out")[2]


def test_time_constant_of_the_windings_is_theirs(slips):
    # Table 2 of the thesis: 2.13 ohm and 7.2e-4 H.
    assert f"{1e6 * 7.2e-4 / 2.13:.0f} us" in one_about(slips, "Table 2, eq. 3.6").evidence


def test_two_wrong_cells_explain_all_that_differs():
    wrong = wrong_means()

    assert {(one.table, one.algorithm, one.level, one.fault) for one in wrong} == {
        (58, "pso", "high", "eccentricity"),
        (59, "pso", "low", "short_circuit"),
    }
    assert not [one for one in comparisons(overviews_with(wrong)) if one.differs]
    # One of them alone does not.
    for one in wrong:
        assert [left for left in comparisons(overviews_with([one])) if left.differs]


def test_the_printed_modulation_fits_eccentricity_worse_than_none_does(slips):
    text = one_about(slips, "Eq. 4.24").evidence
    pattern = r"cost ([\d.]+)(?: A\^2\.s)? and (?:the healthy ones )?([\d.]+\d)"
    costs = re.findall(pattern, text)

    assert len(costs) == 4
    (low, low_fast, high, high_fast) = [(float(truth), float(healthy)) for truth, healthy in costs]
    for truth, healthy in (low, high):
        assert truth > healthy
    for truth, healthy in (low_fast, high_fast):
        assert truth < 0.5 * healthy
