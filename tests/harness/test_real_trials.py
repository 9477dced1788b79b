# SPDX-License-Identifier: Apache-2.0
"""Trials of real machines are never compared with themselves."""

from collections import Counter
from pathlib import Path

import pytest

from ..benchmarks import benchmark

STATES = ("normal", "backlash1", "spalling1")


def test_healthy_trials_are_compared_with_others_and_faulty_trials_once_per_number_of_days():
    real = benchmark("real")
    trials = [real.Trial(s, load, n) for s in STATES for load in real.LOADS for n in real.TRIALS]
    comparisons = real.comparisons(trials)
    counts = Counter(
        (comparison.days, test)
        for comparison in comparisons
        if not comparison.labelled
        for test in comparison.tests
    )
    for comparison in comparisons:
        assert len(comparison.healthy) == comparison.days
        for test in comparison.tests:
            assert test.load == comparison.load
            assert test.state != real.HEALTHY or test.number not in comparison.healthy
            assert test not in comparison.labelled
            assert all(test.number != example.number for example in comparison.labelled)
    for days in real.DAYS:
        faulty = [
            counts[days, comparison] for comparison in trials if comparison.state != real.HEALTHY
        ]
        assert set(faulty) == {1}
    # Each trial, healthy ones included, is left out of the labels once.
    left_out = Counter(
        test for comparison in comparisons if comparison.labelled for test in comparison.tests
    )
    assert left_out == Counter(trials)


def test_tables_replace_those_with_the_same_headings():
    document = benchmark("real_document")
    rest = "\n\nBetween.\n\n| c |\n|---|\n| x |\n"
    rows = document.table(["a", "b"], [["new", ""]])
    assert rows == ["| a | b |", "| --- | --- |", "| new | |"]
    text = f"# Title\n\n| a | b |\n|---|---|\n| old | 1 |\n| old | 2 |{rest}"
    new = f"# Title\n\n| a | b |\n| --- | --- |\n| new | |{rest}"
    assert document.rewritten(text, [rows]) == new
    with pytest.raises(ValueError, match="0 tables begin with"):
        document.rewritten(text, [document.table(["d"], [])])


def test_documentation_has_the_tables_that_the_script_writes():
    document, real = benchmark("real_document"), benchmark("real")
    friction = {"judgement": "unchanged", "smallest_change": 0.1}
    trial = {"verdict": "valid", "quantities": {"friction": friction}, "states": {"healthy": 1.0}}
    states = (real.HEALTHY, *real.REPORTED)
    figures = {
        "trials": [
            {**trial, "state": state, "load": load, "days": days, "labelled": labelled}
            for state in states
            for load in real.LOADS
            for days in real.DAYS
            for labelled in (False, True)  # For each number of days: at least three healthy trials.
        ],
        "reports": [
            {"state": state, "load": load, "level": "OK", "friction": friction}
            for state in states
            for load in real.LOADS
        ],
        "aircraft": {
            "5 mm": [
                {"date": first, "ratio": 1.1, "level": "WARN", "life_days": [0.4, 10.4, 33.5]}
                for first, _ in document.PERIODS.values()
            ]
        },
        "emps": {
            "coefficients": {**real.PUBLISHED, "constant load": -3.0},
            "records": {"pulses": {"verdict": "departed", "reason": "It rose. Not judged: play"}},
        },
    }
    tables = list(document.tables(figures))
    assert tables[0][2] == "| healthy " + 3 * "| 0 of 1 / 0 of 1 / 0 of 3 " + "|"
    assert tables[-2][-1] == "| pulses | departed | It rose |"
    assert tables[-1][2].endswith("| 1.10 | WARN | 0.4, 10, 34 (test of 2017-07-31) |")
    text = (Path(__file__).parents[2] / "docs" / "real-data.md").read_text()
    assert len(document.rewritten(text, tables).splitlines()) > 100
