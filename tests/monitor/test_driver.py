# SPDX-License-Identifier: Apache-2.0
"""The loop that drives an optimizer: counting, best point so far, and each stop criterion."""

from typing import cast

import numpy as np
import pytest

from ema_monitor.optimizers.driver import Termination, minimise
from ema_monitor.optimizers.interface import Optimizer

NAN = float("nan")


class Script:
    """An optimizer that asks for numbered points, as many in each generation as costs are given.

    The residual of a point is the square root of a given cost.
    """

    uses_residuals = False

    def __init__(self, costs, converged_after=None):
        self.costs = [np.atleast_1d(np.asarray(c, dtype=float)) for c in costs]
        self.asked = 0
        self.reported = []
        self.converged = False
        self.converged_after = converged_after

    def ask(self):
        self.asked += 1
        number = np.arange(float(len(self.costs[self.asked - 1])))
        return np.stack([np.full(len(number), self.asked - 1.0), number], axis=1)

    def residuals(self, points):
        picked = np.array([self.costs[int(g)][int(i)] for g, i in points])
        return np.sqrt(picked)[:, None]

    def tell(self, points, costs, residuals):
        self.reported.append(costs)
        self.converged = len(self.reported) == self.converged_after


def drive(script, residuals_of=None, **termination):
    optimizer = cast(Optimizer, script)
    return list(minimise(residuals_of or script.residuals, optimizer, Termination(**termination)))


def run(costs, converged_after=None, **termination):
    script = Script(costs, converged_after)
    return script, drive(script, **termination)


def test_best_point_so_far_is_kept():
    _, progress = run([[5.0, 4.0], [7.0, 3.0], [9.0, 8.0]], converged_after=3)
    # Costs are squares of roots: rounding.
    assert [p.cost for p in progress] == pytest.approx([4.0, 3.0, 3.0], rel=1e-14)
    assert [p.point.tolist() for p in progress] == [[0.0, 1.0], [1.0, 1.0], [1.0, 1.0]]
    assert [p.generation for p in progress] == [1, 2, 3]
    assert [p.evaluations for p in progress] == [2, 4, 6]


def test_cost_is_the_sum_of_squares():
    script = Script([[0.0, 0.0]], converged_after=1)
    rows = np.array([[3.0, 4.0, 12.0], [1.0, 2.0, 2.0]])
    [progress] = drive(script, lambda _: rows)
    assert script.reported[0].tolist() == [169.0, 9.0]
    assert progress.cost == 9.0


def test_non_finite_residuals_cost_infinity():
    script, progress = run([[NAN, 2.0], [1.0, NAN]], converged_after=2)
    assert script.reported[0].tolist() == [np.inf, pytest.approx(2.0)]
    assert script.reported[1].tolist() == [pytest.approx(1.0), np.inf]
    assert progress[-1].cost == pytest.approx(1.0)


def test_run_stops_when_the_optimizer_has_converged():
    script, progress = run([1.0] * 9, converged_after=4)
    assert len(progress) == script.asked == 4


@pytest.mark.parametrize(("budget", "done"), [(3, 1), (5, 1), (6, 2), (11, 3), (100, 4)])
def test_generation_that_would_exceed_the_budget_is_not_started(budget, done):
    sizes = (3, 3, 4, 2)
    script, progress = run([np.full(n, 9.0) for n in sizes], 4, budget=budget)
    assert len(progress) == done
    assert progress[-1].evaluations == sum(sizes[:done]) <= budget
    assert len(script.reported) == done


def test_budget_below_the_first_generation_is_refused():
    with pytest.raises(ValueError, match=r"budget = 2 evaluations: at least 3 are needed"):
        run([[1.0, 1.0, 1.0]], budget=2)


FALLS, SLOW = [8.0, 4.0, 2.0], [8.0 * 0.95**n for n in range(20)]


@pytest.mark.parametrize(
    ("costs", "termination", "done"),
    [
        ([3.0, 0.0, 0.0], {}, 2),
        # Three that improve (the first has no earlier generation to compare with), then none.
        *(
            ([*FALLS, *[2.0] * 20], {"stall_generations": n, "tolerance": 0.1}, 3 + n)
            for n in (1, 5)
        ),
        # The first finite cost is an improvement.
        ([NAN, 8.0, *[4.0] * 3], {"stall_generations": 2, "tolerance": 0.1}, 5),
        ([8.0] * 3 + [4.0] * 4, {"stall_generations": 3, "tolerance": 0.1}, 7),
        # An improvement below the tolerance still counts as a stall.
        (SLOW, {"stall_generations": 4, "tolerance": 0.1}, 5),
        (SLOW, {"stall_generations": 4, "tolerance": 0.04}, 20),
    ],
)
def test_run_ends_at_a_cost_of_zero_or_after_generations_without_improvement(
    costs, termination, done
):
    _, progress = run(costs, len(costs), **termination)
    assert len(progress) == done
    # Improvements below the tolerance are used, though.
    assert progress[-1].cost == pytest.approx(np.nanmin(costs[:done]))


def test_custom_termination_rule_needs_no_other_driver():
    class Five:
        budget = 10**6

        def reached(self, best_costs):
            return len(best_costs) == 5

    script = Script([1.0] * 9)
    assert len(list(minimise(script.residuals, cast(Optimizer, script), Five()))) == 5
