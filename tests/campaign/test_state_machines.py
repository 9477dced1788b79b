"""What holds does so in all orders of steps."""

import importlib

import pytest


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_few_walks(held, number: int):
    counts = held("state_machines", number, 5)
    (steps,) = [count for name, count in counts.items() if name.endswith(": steps")]
    assert steps > 20


@pytest.mark.long
@pytest.mark.parametrize("number", [0, 1, 2])
def test_walks_reach_every_state(held, number: int):
    counts = held("state_machines", number)
    assert importlib.import_module("state_machines").judge(counts) == []


@pytest.mark.parametrize("name", ["queue", "lifecycle", "prognosis"])
def test_state_that_no_walk_of_a_case_reaches_fails(name: str):
    machines = importlib.import_module("state_machines")
    (kind,) = (one for one in machines._MACHINES if one.machine() == name)
    walks, _ = machines._WALKS[name]
    counts = {f"{name}: walks": walks} | {f"{name}: {state}": walks for state in kind.STATES}
    assert machines.judge(counts) == []
    missed = kind.STATES[-1]
    counts[f"{name}: {missed}"] = 0
    assert machines.judge(counts) == [
        f"{name}: 0 of {walks} walks reach {missed!r}, expected 1% of them"
    ]
