"""A level changes when several estimates in a row say so, and not before."""

from itertools import pairwise

import pytest

from ema_core.levels import ERROR, OK, WARN
from ema_monitor.node.level_filter import LevelFilter


@pytest.mark.parametrize(
    ("levels", "confirmations", "filtered"),
    [
        ([WARN], 2, [WARN]),
        ([OK, WARN, OK, WARN, OK], 2, [OK, OK, OK, OK, OK]),
        ([OK, WARN, WARN, OK, OK], 2, [OK, OK, WARN, WARN, OK]),
        # An error after a warning confirms that it is no longer OK.
        ([OK, WARN, ERROR], 2, [OK, OK, ERROR]),
        # What goes up and down confirms nothing.
        ([WARN, ERROR, OK, ERROR, OK], 2, [WARN, WARN, WARN, WARN, WARN]),
        ([OK, ERROR, OK], 1, [OK, ERROR, OK]),
        ([OK, WARN, WARN, WARN], 3, [OK, OK, OK, WARN]),
    ],
)
def test_change_is_taken_when_it_is_confirmed(
    levels: list[int], confirmations: int, filtered: list[int]
):
    one, seen, changes = LevelFilter(), [], []
    for level in levels:
        changes.append(one.add(level, confirmations))
        seen.append(one.level)
    assert seen == filtered
    assert changes == [True, *(a != b for a, b in pairwise(filtered))]
