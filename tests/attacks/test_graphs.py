"""In a disturbed graph each window is answered once, and nothing is lost silently."""

import os

import pytest

from .graphs import CONDITIONS, run_condition
from .killed_nodes import NodeKills
from .soak import run as soak


@pytest.mark.long
def test_killed_nodes_lose_the_open_chunk_or_the_current_test_alone(case_of):
    # With this seed the monitor, the recorder and the dashboard are killed in turn.
    case = case_of(seed=180)
    NodeKills(case, 3, 1, 0.0).run()
    assert case.failures == []
    killed = {
        name: case.counts[f"kills of {name}"] for name in ("monitor", "recorder", "dashboard")
    }
    assert set(killed.values()) == {1}
    assert case.counts["kills of player"] == 1
    assert case.counts["tests in histories checked"] > 0
    assert case.counts["messages read back"] > 100


@pytest.mark.long
def test_nodes_that_are_killed_or_stand_still_are_missed_and_go_on(case_of, case_number):
    case = case_of(case_number)
    NodeKills(case).run()
    assert case.failures == []


@pytest.mark.long
def test_graph_whose_monitor_is_restarted_keeps_all_rules(case_of):
    case = case_of()
    run_condition(case, "restart of the monitor", 3.0, 3.0)
    assert case.failures == []
    assert case.counts["runs"] == 2
    assert case.counts["valid"] >= 2


@pytest.mark.long
@pytest.mark.parametrize("condition", CONDITIONS)
def test_disturbed_graph_keeps_all_rules(case_of, condition, case_number):
    case = case_of(case_number, seed=2)
    run_condition(case, condition)
    assert case.failures == []
    assert case.counts["windows"] > 3


@pytest.mark.long
def test_no_process_grows(case_of):
    """A soak of EMA_SOAK_MINUTES: a slope of fewer than 30 is not known well enough to judge."""
    case = case_of(steps=int(os.environ.get("EMA_SOAK_MINUTES", "40")))
    soak(case)
    assert case.failures == []
