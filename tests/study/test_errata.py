"""The thesis's slips: found where they are, and nowhere else."""

import re

import pytest

from ema_study.errata import errata, printed_means_that_differ
from ema_study.errata.printed_means import Comparison, comparisons
from ema_study.printed_tables import run_means


@pytest.fixture(scope="module")
def slips():
    return errata()


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


@pytest.mark.parametrize(
    ("where", "evidence"),
    [
        ("Appendix B, section 5.5", "in 69 of 120 runs of GWO, in 5 of the 380 others"),
        ("Table 48", "1905 s"),
        ("Table 61", "Best: PSO for speed, DE for precision"),
        ("Eq. 7.1 (error)", "500 of 500 printed errors"),
        ("Section 7.1, table 8", "1.15 and 5.74 generations a minute, but 1.92 and 1.91"),
        ("Section 7.1, tables 9, 10", "1.50 to 1, and 1.43 to 1"),
        ("Section 7.2.6", "33 of 40 runs made 200 generations"),
        ("Section 7.1 (stop rule)", "table 26 run 6: 20"),
        ("Table 2, eq. 3.6", "338 us"),
        ("Chapter 8", "gain GWO"),
    ],
)
def test_evidence_is_what_the_runs_and_models_give(slips, where, evidence):
    assert evidence in one_about(slips, where).evidence


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
