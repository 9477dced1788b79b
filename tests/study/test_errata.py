# SPDX-License-Identifier: Apache-2.0
"""Errata that the code relies on, from the thesis's own runs or from the models.

docs/errata.md has the numbers; these tests compute the numbers that other modules rely on.
"""

from pathlib import Path

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, estimation_error
from ema_study.cases import CASES
from ema_study.models import problem
from ema_study.printed import printed_runs, printed_table
from ema_study.run import K
from ema_study.stop_rules import THRESHOLD
from ema_study.tables import multiple_fault_reliability, reliability_of_overviews

TRUE_K = [f"true_{k}" for k in K]


@pytest.fixture(scope="module")
def page():
    """Return the text of docs/errata.md without line breaks."""
    text = (Path(__file__).parents[2] / "docs" / "errata.md").read_text(encoding="utf-8")
    return " ".join(text.split())


@pytest.fixture
def runs():
    return printed_runs()


def square_of_the_estimate(k6, true_k6):
    return k6**2


def errors(estimates, truths, weight):
    """Return errors [%], in which ``weight(k6, true k6)`` multiplies the squared error of k7."""
    squares = (estimates - truths) ** 2
    squares[:, ECCENTRICITY_PHASE] *= weight(estimates[:, ECCENTRICITY], truths[:, ECCENTRICITY])
    return 100.0 * np.sqrt(squares.sum(axis=1))


def rounding(estimates, truths, weight, tables):
    """Return the rounding error [%] from half a digit of the printed error and of each estimate."""
    here = errors(estimates, truths, weight)
    total = np.where(np.isin(tables, (9, 10, 56, 57)), 0.5e-3, 0.5e-2)
    for column in range(estimates.shape[1]):
        changes = []
        for half_digit in (-0.5e-4, 0.5e-4):
            moved = estimates.copy()
            moved[:, column] = np.maximum(moved[:, column] + half_digit, 0.0)
            changes.append(np.abs(errors(moved, truths, weight) - here))
        total += np.max(changes, axis=0)
    return total


def reproduced(runs, high_backlash, weight=square_of_the_estimate):
    """Return how many printed errors follow from the estimates, and the largest deviation [%]."""
    estimates, truths = runs[K].to_numpy(float), runs[TRUE_K].to_numpy(float).copy()
    truths[truths == 0.747] = high_backlash
    deviations = np.abs(errors(estimates, truths, weight) - runs["error_percent"])
    within = deviations <= rounding(estimates, truths, weight, runs["table"])
    return int(within.sum()), float(deviations.max())


def test_all_500_printed_errors_weigh_the_phase_by_the_square_of_the_estimated_k6(runs, page):
    count, largest = reproduced(runs, 0.7474)

    assert count == 500
    assert f"{count} of 500 printed errors" in page
    assert f"the largest deviation is {largest:.3f} %" in page
    # A wrong weight is not mistaken for rounding.
    runs.loc[runs["table"] == 12, "error_percent"] += 0.03
    assert reproduced(runs, 0.7474)[0] == 490


def test_errors_of_the_study_equal_the_printed_ones_except_for_phase_wraps(runs):
    estimates, truths = runs[K].to_numpy(float), runs[TRUE_K].to_numpy(float)
    ours = np.array([estimation_error(*pair) for pair in zip(estimates, truths, strict=True)])
    not_wrapped = np.abs(estimates[:, 6] - truths[:, 6]) <= 0.5

    theirs = errors(estimates, truths, square_of_the_estimate)
    np.testing.assert_allclose(theirs[not_wrapped], ours[not_wrapped], rtol=1e-12)
    assert not_wrapped.sum() > 400


def test_eq_4_24_gives_the_true_eccentricity_a_higher_cost_than_none(page):
    for level in ("low", "high"):
        _, _, truth, healthy = problem("thesis", f"eccentricity {level}")
        of_pair = problem("fast", f"eccentricity {level}").cost_at_truth
        assert of_pair < 0.5 * healthy < healthy < truth
        assert f"the true faults cost {truth:.4f} A^2.s and the healthy ones {healthy:.4f}" in page
        assert f"of the driven pair they cost {of_pair:.4f}" in page


def test_true_faults_cost_more_than_the_printed_threshold(page):
    problems = {name: problem("thesis", name) for name in CASES}
    described = [name for name, entry in problems.items() if entry.is_described]
    costs = [problems[name].cost_at_truth for name in described]

    assert set(CASES) - set(described) == {"eccentricity low", "eccentricity high"}
    assert min(costs) > THRESHOLD
    assert f"cost {min(costs):.4f} to {max(costs):.4f} A^2.s, above 1e-3 in 9 of 9" in page


def test_table_61_multiplies_times_of_one_study_by_errors_of_another(runs, page):
    printed = printed_table("table_61")["RC"].dropna()
    mixed = multiple_fault_reliability(runs, 56, 57)["RC"].dropna()
    # Printed from means with two decimals. The smallest mean is 0.6 %, so products are off by up to
    # 1 %.
    np.testing.assert_allclose(mixed, printed, rtol=0, atol=0.3)

    for table in (56, 57):
        alone = multiple_fault_reliability(runs, table, table)["RC"].dropna()
        row = ", ".join(f"{str(name).upper()} {value:.1f}" for name, value in alone.items())
        assert f"table {table} alone: {row}" in page


def test_table_60_follows_from_the_printed_tables_58_and_59(page):
    printed = printed_table("table_60")
    follows = reliability_of_overviews(printed_table("table_59"), printed_table("table_58"))
    worst = np.nanmax(((follows - printed).abs() / printed).to_numpy())

    assert f"Table 60 follows from the printed 58 and 59 to {100.0 * worst:.2f} %" in page
