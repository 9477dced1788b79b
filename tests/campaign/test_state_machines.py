"""What holds does so in all orders of steps."""

import pytest

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_few_walks(held, number: int):
    counts = held("state_machines", number, 5)
    (steps,) = [count for name, count in counts.items() if name.endswith(": steps")]
    assert steps > 20


@pytest.mark.long
@pytest.mark.parametrize("number", [0, 1, 2])
def test_walks_reach_every_state(held, number: int):
    import importlib

    counts = held("state_machines", number)
    assert importlib.import_module("state_machines").judge(counts) == []
