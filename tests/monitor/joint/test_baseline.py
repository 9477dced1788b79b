# SPDX-License-Identifier: Apache-2.0
"""A baseline is extended by labelled records, and by hypothetical healthy records."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ema_monitor.joint.comparing import Comparer
from ema_monitor.joint.figures import SPEED_STEPS
from ema_monitor.joint.shape import DRY, VISCOUS
from ema_monitor.quantities import FRICTION

from .baselines import HEALTHY, USUAL_SPEED, baseline_of, record_of


def test_record_is_labelled_with_its_state():
    baseline = baseline_of()
    record, second = record_of(HEALTHY, day=40), record_of(HEALTHY, day=41)
    labelled = baseline.with_record("dry", record).with_record("worn", second)
    assert [(label.state, label.record) for label in labelled.labelled] == [
        ("dry", record), ("worn", second),
    ]  # fmt: skip
    assert labelled.states() == {"healthy": 9, "dry": 1, "worn": 1}
    assert labelled.records == baseline.records
    assert baseline.labelled == ()


def test_label_of_a_record_replaces_its_earlier_label():
    """This holds also for the same telemetry in a refitted record."""
    first, again = record_of(HEALTHY, day=40), record_of(1.01 * HEALTHY, day=40)
    labelled = baseline_of().with_record("dry", first).with_record("worn", again)
    (label,) = labelled.labelled
    assert (label.state, label.record) == ("worn", again)


def test_healthy_record_of_the_baseline_cannot_be_labelled():
    baseline = baseline_of()
    with pytest.raises(ValueError, match="it is one of the healthy records of the calibration"):
        baseline.with_record("dry", baseline.records[4])


def test_hypothetical_records_are_on_additional_days():
    baseline = baseline_of(days=3, a_day=2)
    extended = baseline.extended(6, 2)
    last = max(baseline.days)
    assert extended.records[:6] == baseline.records
    assert sorted(extended.days[6:]) == [last + 1] * 3 + [last + 2] * 3
    assert set(baseline.extended(4, 0).days[6:]) == {last}


@pytest.mark.slow
@pytest.mark.parametrize("days", [2, 3, 4])
@pytest.mark.parametrize("scatter", [0.004, 0.008, 0.016])
def test_additional_days_lower_the_smallest_change_as_predicted(days, scatter):
    """Baselines with the same seed share their first days."""
    predicted, reached = [], []
    for seed in range(12):
        baseline = baseline_of(seed, days=days, scatter=scatter)
        more = baseline_of(seed, days=days + 2, scatter=scatter)
        correlations = Comparer(baseline).correlations
        extended = Comparer(baseline.extended(6, 2), assumed_correlations=correlations)
        predicted.append(extended.smallest_changes[FRICTION])
        reached.append(Comparer(more).smallest_changes[FRICTION])
    # The information of two days varies by half, and a mean of 12 by 15 %.
    assert np.mean(predicted) == pytest.approx(np.mean(reached), rel=0.25)


def of_motion(speeds, travels):
    """Return a baseline whose records have these speeds and travels."""
    base = baseline_of(a_day=len(speeds) // 3)
    records = zip(base.records, speeds, travels, strict=True)
    return replace(
        base, records=tuple(replace(record, usual_speed=v, travel=x) for record, v, x in records)
    )


def test_repeating_motion_is_distinguished_from_motion_alike_by_chance():
    """Speeds scatter by 0.6 % in repeated motion, and by 2 % in sweeps with random starts."""
    rng = np.random.default_rng(3)
    repeated, by_chance = 0, 0
    for _ in range(100):
        speeds = np.exp(rng.standard_normal(9))
        alike = USUAL_SPEED * speeds ** (0.006 / 1.0)
        sweep = USUAL_SPEED * speeds**0.02
        repeated += of_motion(alike, np.full(9, 2.0)).repeats
        by_chance += of_motion(sweep, np.full(9, 2.0)).repeats
    assert repeated >= 95
    assert by_chance <= 10


def test_motion_with_different_accelerations_does_not_repeat():
    """Sweeps of one speed and travel with random starts differ in roughness by a third."""
    base = of_motion(np.full(9, USUAL_SPEED), np.full(9, 2.0))
    steps = np.log([1.0, 1.01, 0.99] * 3)
    for scale, repeats in ((1.0, True), (12.0, False)):
        records = (
            replace(record, figures={SPEED_STEPS: scale * step})
            for record, step in zip(base.records, steps, strict=True)
        )
        assert replace(base, records=tuple(records)).repeats is repeats


def test_different_speed_to_travel_ratio_makes_friction_uncertain_by_the_share_of_the_inertia():
    """Speed and travel are within the healthy ranges, but their ratio is not."""
    speeds, travels = USUAL_SPEED * np.array([0.8, 1.0, 1.2] * 3), np.array([1.6, 2.0, 2.4] * 3)
    base = of_motion(speeds, travels)
    same = record_of(HEALTHY, usual_speed=USUAL_SPEED, travel=2.0)
    fast = replace(same, usual_speed=1.2 * USUAL_SPEED, travel=1.6)
    assert base.motion_errors(same).tolist() == [0.0] * 5
    errors = base.motion_errors(fast)
    inertial = base.healthy[1] * USUAL_SPEED * USUAL_SPEED / 2.0 / base.friction
    for number in (DRY, VISCOUS):
        expected = 0.05 * math.log(1.5) * inertial * base.scales[number]
        assert errors[number] == pytest.approx(expected, rel=0.02)
    heavy = replace(base, records=tuple(_heavy(record) for record in base.records))
    assert heavy.motion_errors(fast)[DRY] > 9.0 * errors[DRY]


def _heavy(record):
    """Return a record of ten times the inertia."""
    return replace(record, values=record.values * np.array([1.0, 10.0, 1.0, 1.0, 1.0]))
