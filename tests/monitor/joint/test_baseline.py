"""A baseline is extended by labelled records, and by healthy records that were not made yet."""

import numpy as np
import pytest

from ema_monitor.joint.comparing import Comparer
from ema_monitor.joint.comparison import FRICTION

from .baselines import HEALTHY, baseline_of, record_of


def test_record_is_labelled_with_its_state():
    baseline = baseline_of()
    record, other = record_of(HEALTHY, day=40), record_of(HEALTHY, day=41)
    labelled = baseline.with_record("dry", record).with_record("worn", other)
    assert [(one.state, one.record) for one in labelled.labelled] == [
        ("dry", record), ("worn", other),
    ]  # fmt: skip
    assert labelled.states() == {"healthy": 9, "dry": 1, "worn": 1}
    assert labelled.records == baseline.records
    assert baseline.labelled == ()


def test_label_of_a_record_replaces_its_earlier_label():
    """Also if the record was fitted anew: it is the same telemetry."""
    first, again = record_of(HEALTHY, day=40), record_of(1.01 * HEALTHY, day=40)
    labelled = baseline_of().with_record("dry", first).with_record("worn", again)
    (label,) = labelled.labelled
    assert (label.state, label.record) == ("worn", again)


def test_healthy_record_of_the_baseline_is_not_labelled():
    baseline = baseline_of()
    with pytest.raises(ValueError, match="it is one of the healthy records of the calibration"):
        baseline.with_record("dry", baseline.records[4])


def test_further_records_of_several_days_are_on_days_of_their_own():
    baseline = baseline_of(days=3, a_day=2)
    extended = baseline.extended(6, 2)
    last = max(baseline.days)
    assert extended.records[:6] == baseline.records
    assert sorted(extended.days[6:]) == [last + 1] * 3 + [last + 2] * 3
    assert set(baseline.extended(4, 0).days[6:]) == {last}


@pytest.mark.slow
@pytest.mark.parametrize("days", [2, 3, 4])
@pytest.mark.parametrize("scatter", [0.004, 0.008, 0.016])
def test_more_days_beyond_several_lower_the_smallest_change_as_predicted(days, scatter):
    """The baselines of a seed share their first days."""
    predicted, reached = [], []
    for seed in range(12):
        baseline = baseline_of(seed, days=days, scatter=scatter)
        more = baseline_of(seed, days=days + 2, scatter=scatter)
        known = Comparer(baseline).correlations
        extended = Comparer(baseline.extended(6, 2), known_correlations=known)
        predicted.append(extended.smallest_changes[FRICTION])
        reached.append(Comparer(more).smallest_changes[FRICTION])
    # What two days show varies by half, a mean of 12 by 15 %.
    assert np.mean(predicted) == pytest.approx(np.mean(reached), rel=0.25)
