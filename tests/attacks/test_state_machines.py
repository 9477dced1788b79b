"""What holds does so in all orders of steps; every state is reached."""

import pytest

from .stateful import LEAST_WALKS, unreached, walk
from .walk_claims import Claimed
from .walk_lifecycle import Lifecycle
from .walk_prognosis import Prognosis
from .walk_queue import Queue

STEPS = {Claimed: 30, Queue: 50, Lifecycle: 30, Prognosis: 25}


@pytest.mark.slow
@pytest.mark.parametrize("kind", STEPS, ids=lambda kind: kind.machine())
def test_a_few_walks(case_of, kind):
    case = case_of(steps=5)
    walk(case, kind, 5, STEPS[kind])
    assert case.failures == []
    assert case.counts[f"{kind.machine()}: steps"] > 20


@pytest.mark.long
@pytest.mark.parametrize("kind", STEPS, ids=lambda kind: kind.machine())
def test_walks_reach_every_state(case_of, kind, case_number):
    case = case_of(case_number)
    walk(case, kind, LEAST_WALKS, STEPS[kind])
    assert case.failures == []
    assert unreached(case.counts, kind) == []
