# SPDX-License-Identifier: Apache-2.0
"""Tables that the study repeats, and the runs that each table needs."""

from pathlib import Path

import pandas as pd
import pytest

from ema_study import api
from ema_study.contents import NUMBERS, jobs_of, table_titles, title_of
from ema_study.plan import plan
from ema_study.run import K, as_frame, run_job
from ema_study.tables import study_tables

from .synthetic_runs import synthetic_runs


@pytest.mark.parametrize(
    ("number", "tables", "count"),
    [
        (8, {8}, 11),
        (24, {24}, 3),
        (26, {26}, 6),
        (28, set(range(20, 28)), 36),
        (57, {57}, 18),
        (61, {56, 57}, 36),
    ],
)
def test_table_needs_only_its_own_runs(number, tables, count):
    jobs = jobs_of(number, "fast", 3)
    assert {job.table for job in jobs} == tables
    assert len(jobs) == count


@pytest.mark.parametrize("number", [58, 59, 60])
def test_overviews_need_all_single_faults_of_the_comparison(number):
    needed = {job.table for job in jobs_of(number, "fast", 1)}
    faults = {job.table for job in plan("fast", 1) if 11 <= job.table <= 54}
    assert needed == faults
    assert len(needed) == 40


@pytest.mark.long
@pytest.mark.parametrize("number", NUMBERS)
def test_table_of_its_own_runs_equals_the_table_of_the_whole_study(number):
    runs = synthetic_runs("fast", 2)
    keys = {(job.table, job.algorithm, job.run) for job in jobs_of(number, "fast", 2)}
    chosen = runs[
        [key in keys for key in zip(runs["table"], runs["algorithm"], runs["run"], strict=True)]
    ]
    [whole], [alone] = study_tables(runs, [number]), study_tables(chosen, [number])
    pd.testing.assert_frame_equal(alone.frame, whole.frame)


def test_every_table_has_a_title_and_is_listed():
    assert (NUMBERS[0], NUMBERS[-1]) == (8, 61)
    assert title_of(24) == "Backlash high, GA"
    listed = [int(number) for numbers, _ in table_titles() for number in numbers.split(" to ")]
    assert listed[0] == 8
    assert listed[-1] == 61
    assert listed == sorted(listed)


@pytest.mark.parametrize("number", [0, 7, 62])
def test_unknown_table_is_refused(number):
    for refuse in (title_of, api.table, lambda number: jobs_of(number, "fast", 1)):
        with pytest.raises(ValueError, match=f"table {number}: expected 8 to 61"):
            refuse(number)


def test_unknown_model_is_refused():
    with pytest.raises(ValueError, match=r"model 'slow'.*fast.*thesis"):
        api.table(24, model="slow")


def test_python_call_repeats_a_table_with_the_runs_of_the_command():
    table = api.table(21, runs=1)
    [job] = jobs_of(21, "fast", 1)
    expected = as_frame([run_job(job)]).iloc[0]
    assert table.number == 21
    ours, printed = table.frame["fast model"], table.frame["printed"]
    assert ours.loc["1", K].tolist() == expected[K].tolist()
    assert ours.loc["1", "error [%]"] == expected["error_percent"] < 1.0
    assert printed.loc["mean as printed", "error [%]"] == 0.29


def test_documentation_names_each_table():
    text = (Path(__file__).parents[2] / "docs" / "study.md").read_text(encoding="utf-8")
    for numbers, title in table_titles():
        assert f"| {numbers} | {title} |" in text
