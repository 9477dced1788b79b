"""A level rises at once, and falls when several estimates in a row say so."""

from itertools import pairwise

import pytest

from ema_core.levels import ERROR, OK, WARN
from ema_monitor.node.actuator import LevelFilter


@pytest.mark.parametrize(
    ("levels", "confirmations", "filtered"),
    [
        ([WARN], 2, [WARN]),
        ([OK, WARN, OK, WARN, OK], 2, [OK, WARN, WARN, WARN, WARN]),
        ([OK, WARN, WARN, OK, OK], 2, [OK, WARN, WARN, WARN, OK]),
        ([OK, WARN, ERROR], 2, [OK, WARN, ERROR]),
        # Of those that are lower the last is taken.
        ([ERROR, OK, WARN, OK, OK], 2, [ERROR, ERROR, WARN, WARN, OK]),
        ([OK, ERROR, OK], 1, [OK, ERROR, OK]),
        ([ERROR, OK, OK, OK], 3, [ERROR, ERROR, ERROR, OK]),
    ],
)
def test_level_rises_at_once_and_falls_when_that_is_confirmed(
    levels: list[int], confirmations: int, filtered: list[int]
):
    one, seen, changes = LevelFilter(), [], []
    for level in levels:
        changes.append(one.add(level, confirmations))
        seen.append(one.level)
    assert seen == filtered
    assert changes == [True, *(a != b for a, b in pairwise(filtered))]
