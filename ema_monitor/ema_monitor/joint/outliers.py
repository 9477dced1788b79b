# SPDX-License-Identifier: Apache-2.0
"""Detection of healthy records that differ from the other healthy records of the unit."""

from dataclasses import replace
from typing import Final, NamedTuple

from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.comparing import Comparer
from ema_monitor.joint.comparison import Comparison
from ema_monitor.joint.record import JointRecord

FEWEST: Final = 4
"""Minimum number of healthy records for the search for outliers."""

_UNLIKELY: Final = 1e-5
"""Probability below which a healthy record is an outlier.

Every record of a baseline is tested, and as few as three records predict poorly. With this
threshold, less than 1 % of healthy baselines have a false outlier.
"""


class Outlier(NamedTuple):
    """A differing healthy record, its index in the baseline, and its comparison with the rest."""

    record: JointRecord
    number: int
    comparison: Comparison


def outliers(baseline: Baseline) -> list[Outlier]:
    """Return the healthy records that have a changed quantity, the least probable record first.

    Each record is compared with all other records. An outlier is removed before the next
    comparison: otherwise healthy records of the same day would differ as well. Records with the
    same fault mask each other. For fewer than ``FEWEST`` records, the list is empty.
    """
    outliers: list[Outlier] = []
    rest, numbers = list(baseline.records), list(range(len(baseline.records)))
    while len(rest) >= FEWEST:
        compared = [_left_out(baseline, rest, number) for number in range(len(rest))]
        worst = min(range(len(rest)), key=lambda number: _probability(compared[number]))
        if _probability(compared[worst]) >= _UNLIKELY:
            break
        outliers.append(Outlier(rest.pop(worst), numbers.pop(worst), compared[worst]))
    return outliers


def _left_out(baseline: Baseline, records: list[JointRecord], number: int) -> Comparison:
    """Return the comparison of a record with all other records."""
    rest = (*records[:number], *records[number + 1 :])
    comparer = Comparer(replace(baseline, records=rest, labelled=()))
    return comparer.compare(records[number], with_improvements=False)


def _probability(comparison: Comparison) -> float:
    return comparison.probability if comparison.changed else 1.0
