# SPDX-License-Identifier: Apache-2.0
"""A faulty record among the healthy records is named, but no record of a healthy set."""

from collections.abc import Iterable
from dataclasses import replace

import pytest

from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.outliers import FEWEST, outliers
from ema_monitor.quantities import FRICTION, INERTIA, TORQUE

from .baselines import baseline_of, changed


def with_faults(baseline: Baseline, numbers: Iterable[int], **change: float) -> Baseline:
    """Return the baseline with changes in some of its records."""
    records = list(baseline.records)
    for number in numbers:
        records[number] = replace(records[number], values=changed(records[number].values, **change))
    return replace(baseline, records=tuple(records))


@pytest.mark.parametrize("number", [0, 4, 8])
@pytest.mark.parametrize(
    ("change", "name", "size"),
    [
        ({"friction": 1.31}, FRICTION, 0.31),
        ({"friction": 0.8}, FRICTION, -0.2),
        ({"torque": 0.8}, TORQUE, -0.2),
        ({"inertia": 1.3}, INERTIA, 0.3),
    ],
)
def test_faulty_record_is_named_with_its_quantity_and_change(number, change, name, size):
    baseline = with_faults(baseline_of(), [number], **change)
    (outlier,) = outliers(baseline)
    assert outlier.record is baseline.records[number]
    # The tolerance includes its scatter of 1 % between days and records, and errors of 0.6 %.
    assert outlier.comparison[name] in outlier.comparison.changed
    assert outlier.comparison[name].change == pytest.approx(size, abs=0.05)


def test_two_faulty_records_of_different_days_are_both_named():
    """The second fault becomes visible only after the first record is left out."""
    baseline = with_faults(baseline_of(), [0, 5], friction=1.5)
    numbers = {baseline.records.index(outlier.record) for outlier in outliers(baseline)}
    assert numbers == {0, 5}


def test_healthy_record_next_to_the_faulty_one_of_its_day_is_not_named():
    """On a day with two records, the healthy one also differs from the faulty one."""
    baseline = with_faults(baseline_of(days=3, a_day=2), [2], friction=1.31)
    (outlier,) = outliers(baseline)
    assert outlier.record is baseline.records[2]


def test_three_records_are_too_few_to_name_one():
    baseline = with_faults(baseline_of(days=1, a_day=FEWEST - 1), [1], friction=2.0)
    assert outliers(baseline) == []


@pytest.mark.slow
@pytest.mark.parametrize("scatter", [0.003, 0.01, 0.03])
def test_healthy_sets_have_no_outlier(scatter):
    for seed in range(20):
        days, a_day = 1 + seed % 4, 2 + seed % 3
        baseline = baseline_of(seed, days=days, a_day=a_day, scatter=scatter)
        assert outliers(baseline) == [], seed
