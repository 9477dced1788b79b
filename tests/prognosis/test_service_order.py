"""Which tests are believed by their service hours alone."""

from itertools import combinations, pairwise

import numpy as np
import pytest

from ema_monitor.prognosis.service_order import ServiceOrder


@pytest.mark.parametrize("seed", range(20))
def test_used_are_the_most_tests_whose_hours_never_go_back(seed: int):
    """After each test, by trying all choices; and those in use stay where others are no more."""
    rng = np.random.default_rng(seed)
    hours = rng.integers(0, 8, 9).astype(float)
    order, before = ServiceOrder(), []
    for n in range(1, len(hours) + 1):
        revoked = order.add(hours[n - 1])
        used = order.used
        ascends = all(hours[a] <= hours[b] for a, b in pairwise(used))
        assert ascends
        assert used == sorted(set(used))
        larger = combinations(range(n), len(used) + 1)
        assert not any(all(hours[a] <= hours[b] for a, b in pairwise(c)) for c in larger)
        assert revoked == sorted(set(before) - set(used))
        if len(used) == len(before):
            assert used == before
        before = list(used)


def test_choice_keeps_what_it_need_not_change():
    order = ServiceOrder()
    for hours in (10.0, 20.0, 15.0, 30.0, 900.0, 40.0):
        order.add(hours)
    assert order.used == [0, 1, 3, 4]
    # 15 h would do as well as 20 h.
    assert order.add(50.0) == [4]
    assert order.used == [0, 1, 3, 5, 6]


@pytest.mark.parametrize(
    ("hours", "waits"),
    [
        ((0.0, 10.0, 20.0, 120.0), False),
        ((0.0, 10.0, 20.0, 121.0), True),
        # Two tests do not tell how far apart they are.
        ((0.0, 10.0, 1000.0), False),
        # Nor do tests of one and the same hour.
        ((5.0, 5.0, 5.0, 5.0, 1000.0), False),
        # What was confirmed is an interval as others are.
        ((0.0, 10.0, 20.0, 500.0, 510.0, 5000.0), False),
        # Nobody goes back to it.
        ((0.0, 10.0, 20.0, 500.0, 30.0), True),
        ((0.0, 10.0, 20.0, 500.0, 30.0, 40.0), False),
    ],
)
def test_last_test_waits_beyond_ten_times_the_longest_interval(hours, waits: bool):
    order = ServiceOrder()
    for item in hours:
        order.add(item)
    assert order.is_waiting == waits
    assert order.confirmed == (order.used[:-1] if waits else order.used)
