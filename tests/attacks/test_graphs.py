# SPDX-License-Identifier: Apache-2.0
"""In a disturbed graph each window is answered once, and every loss is reported."""

import os

import pytest

from .graphs import CONDITIONS, run_condition
from .killed_nodes import NodeKills
from .soak import run as soak


@pytest.mark.long
def test_killed_and_paused_nodes_are_reported_and_recover(case_of, case_number):
    case = case_of(case_number)
    NodeKills(case).run()
    assert case.failures == []
    assert case.counts["messages read back"] > 100


@pytest.mark.long
@pytest.mark.parametrize("condition", CONDITIONS)
def test_disturbed_graph_keeps_all_rules(case_of, condition, case_number):
    case = case_of(case_number, seed=2)
    run_condition(case, condition)
    assert case.failures == []
    assert case.counts["windows"] > 3
    if condition == "restart of the monitor":
        assert case.counts["runs"] == 2


@pytest.mark.long
def test_no_process_grows(case_of):
    """Soak for EMA_SOAK_MINUTES; with fewer than 30 the slope is too inaccurate to judge."""
    case = case_of()
    soak(case, float(os.environ.get("EMA_SOAK_MINUTES", "40")))
    assert case.failures == []
