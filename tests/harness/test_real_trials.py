"""Which trials of real machines are compared with which: never with themselves."""

from collections import Counter

from ..benchmarks import benchmark

STATES = ("normal", "backlash1", "spalling1")


def test_trials_are_compared_with_others_and_faulty_trials_once_by_each_number_of_days():
    real = benchmark("real")
    trials = [real.Trial(s, load, n) for s in STATES for load in real.LOADS for n in real.TRIALS]
    found = real.comparisons(trials)
    counts = Counter((one.days, test) for one in found if not one.labelled for test in one.tests)
    for one in found:
        assert len(one.healthy) == one.days
        for test in one.tests:
            assert test.load == one.load
            assert test.state != real.HEALTHY or test.number not in one.healthy
            assert test not in one.labelled
            assert all(test.number != other.number for other in one.labelled)
    for days in real.DAYS:
        faulty = [counts[days, one] for one in trials if one.state != real.HEALTHY]
        assert set(faulty) == {1}
    # Each trial is left out of the labels once, the healthy ones as well.
    left_out = Counter(test for one in found if one.labelled for test in one.tests)
    assert left_out == Counter(trials)
