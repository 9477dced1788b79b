# SPDX-License-Identifier: Apache-2.0
"""Stop rules of the thesis."""

import pytest

from ema_study.stop_rules import stop_rule

FLOOR = 0.009


def stops_at(rule, costs):
    """Return the first generation (0 is the start) at which a rule stops; None if it never does."""
    return next((n for n in range(len(costs)) if rule.reached(costs[: n + 1])), None)


def test_tables_9_and_10_use_all_generations():
    assert stops_at(stop_rule("all_generations", "de", "low", 1, FLOOR), [0.0] * 300) is None


@pytest.mark.parametrize("algorithm", ["ga", "pso", "de", "gwo"])
def test_speed_study_stops_at_the_threshold_with_any_algorithm(algorithm):
    rule = stop_rule("floor_corrected", algorithm, "fast_stop", 1, FLOOR)
    assert rule.threshold == 1e-3 + FLOOR
    assert stops_at(rule, [1.0, 2e-2, 9e-3, 1e-4]) == 2


def test_threshold_and_stall_requires_both_and_20_generations():
    falling = [10.0 ** -(n / 4.0) for n in range(40)]
    still = falling + [falling[-1]] * 3
    rule = stop_rule("printed", "de", "low", 1, FLOOR)
    assert stops_at(rule, falling) is None
    assert stops_at(rule, still) == 40
    assert stops_at(rule, [1.0 + cost for cost in still]) is None


@pytest.mark.parametrize("scale", [1.0, 1e-6])
@pytest.mark.parametrize(("algorithm", "generations"), [("ga", 50), ("pso", 20)])
def test_matlab_stall_uses_its_own_number_of_generations(algorithm, generations, scale):
    rule = stop_rule("floor_corrected", algorithm, "low", 7, FLOOR)
    assert stops_at(rule, [scale, *[0.5 * scale] * 100]) == generations + 1
    # A relative decrease of 4e-9 in total: below 1e-9 per generation, but above 1e-9 in all.
    creeping = [scale * (1.0 - 4e-9 * n / generations) for n in range(100)]
    assert stops_at(rule, creeping) == (generations + 1 if algorithm == "ga" else None)


def test_unchanged_requires_the_same_best_for_10_generations():
    costs = [3.0, 2.0, *[1.0] * 10, 0.9, *[0.8] * 11]
    rule = stop_rule("unchanged", "ga", "stall_stop", 1, FLOOR)
    assert stops_at(rule, costs) == 23
    assert stops_at(rule, costs[:23]) is None


def test_floor_is_added_to_the_printed_threshold():
    assert stop_rule("printed", "de", "low", 1, FLOOR).threshold == 1e-3
    assert stop_rule("floor_corrected", "gwo", "low", 1, FLOOR).threshold == 1e-3 + FLOOR
