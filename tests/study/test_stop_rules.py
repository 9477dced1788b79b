"""The thesis's stop rules."""

import pytest

from ema_study.stop_rules import (
    AllGenerations,
    RelativeStall,
    Threshold,
    ThresholdAndStall,
    Unchanged,
    stop_rule,
)

FLOOR = 0.009


def stops_at(rule, costs):
    """Generation, from 0 for the start, at which a rule first stops; None if it never does."""
    return next((n for n in range(len(costs)) if rule.reached(costs[: n + 1])), None)


def test_tables_9_and_10_use_all_generations():
    assert stops_at(stop_rule("all_generations", "de", "low", 1, FLOOR), [0.0] * 300) is None


def test_threshold_alone_stops_at_once():
    assert stops_at(Threshold(1, 1e-3), [1.0, 1e-2, 1e-3, 1e-4]) == 2


def test_threshold_and_stall_waits_for_both_and_for_20_generations():
    falling = [10.0 ** -(n / 4.0) for n in range(40)]
    still = falling + [falling[-1]] * 3
    assert stops_at(ThresholdAndStall(1, 1e-3, 1e-12, 1), falling) is None
    assert stops_at(ThresholdAndStall(1, 1e-3, 1e-12, 1), still) == 40
    assert stops_at(ThresholdAndStall(1, 1e-12, 1e-12, 1), still) is None


@pytest.mark.parametrize(("algorithm", "populations"), [("de", 22), ("gwo", 21)])
def test_first_generation_to_stop_at_is_the_21st(algorithm, populations):
    """GWO's first pack is its first generation, DE's first population is none."""
    rule = stop_rule("printed", algorithm, "low", 1, FLOOR)
    assert stops_at(rule, [1e-4] * 40) == populations - 1


@pytest.mark.parametrize(
    ("algorithm", "generations", "averaged"), [("ga", 50, True), ("pso", 20, False)]
)
def test_matlab_stalls_over_its_own_number_of_generations(algorithm, generations, averaged):
    rule = stop_rule("floor_corrected", algorithm, "low", 7, FLOOR)
    assert rule == RelativeStall(7, generations, 1e-9, averaged)
    assert stops_at(rule, [1.0, *[0.5] * 100]) == generations + 1


@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_relative_stall_does_not_depend_on_the_unit_of_the_cost(scale):
    """0.99^n falls by 18 % in 20 generations."""
    costs = [scale * 0.99**n for n in range(60)]
    assert stops_at(RelativeStall(1, 20, 0.1, averaged=False), costs) is None
    assert stops_at(RelativeStall(1, 20, 0.3, averaged=False), costs) == 21
    # Averaged, it is a twentieth of that.
    assert stops_at(RelativeStall(1, 20, 0.02, averaged=True), costs) == 21


def test_unchanged_wants_the_same_best_for_10_generations():
    costs = [3.0, 2.0, *[1.0] * 10, 0.9, *[0.8] * 11]
    assert stops_at(Unchanged(1), costs) == 23
    assert stops_at(Unchanged(1), costs[:23]) is None


@pytest.mark.parametrize("algorithm", ["de", "gwo", "de_thesis", "gwo_thesis"])
def test_floor_is_added_to_the_printed_threshold(algorithm):
    printed = stop_rule("printed", algorithm, "low", 1, FLOOR)
    corrected = stop_rule("floor_corrected", algorithm, "low", 1, FLOOR)
    assert isinstance(printed, ThresholdAndStall)
    assert isinstance(corrected, ThresholdAndStall)
    assert printed.threshold == 1e-3
    assert corrected.threshold == pytest.approx(1e-3 + FLOOR)
    assert printed.tolerance == (1e-12 if algorithm.startswith("de") else 1e-16)


def test_speed_study_stops_by_the_threshold_alone_whatever_the_algorithm():
    for algorithm in ("ga", "pso", "de", "gwo"):
        rule = stop_rule("floor_corrected", algorithm, "fast_stop", 1, FLOOR)
        assert rule == Threshold(1, 1e-3 + FLOOR)
    assert stop_rule("unchanged", "ga", "stall_stop", 1, FLOOR) == Unchanged(1, 10)
    assert stop_rule("all_generations", "de", "low", 1, FLOOR) == AllGenerations(1)


def test_unknown_rule_is_refused_by_name():
    with pytest.raises(ValueError, match="'sometimes' is unknown; known: all_generations, printed"):
        stop_rule("sometimes", "ga", "low", 1, FLOOR)
