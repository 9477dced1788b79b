# SPDX-License-Identifier: Apache-2.0
"""Invariants hold for all orders of steps."""

import pytest

from .conftest import SEED
from .stateful import walk
from .walk_claims import Claimed
from .walk_lifecycle import Lifecycle
from .walk_prognosis import Prognosis
from .walk_queue import Queue

STEPS = {Claimed: 30, Queue: 50, Lifecycle: 30, Prognosis: 25}


@pytest.mark.slow
@pytest.mark.parametrize("kind", STEPS)
def test_few_walks_keep_all_invariants(kind):
    walk(kind, SEED, 5, STEPS[kind])


@pytest.mark.long
@pytest.mark.parametrize("kind", STEPS)
def test_many_walks_keep_all_invariants(kind, case_number):
    walk(kind, 1_000_003 * SEED + case_number, 40, STEPS[kind])
