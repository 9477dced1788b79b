# SPDX-License-Identifier: Apache-2.0
"""Causes of biases: optima near the truth."""

import pytest

from ema_core.description import ActuatorDescription
from ema_study.cases import CASES
from ema_study.models import problem

from .optima import VARIANTS, optimum

pytestmark = pytest.mark.long


@pytest.mark.parametrize("case", ["friction high", "eccentricity low", "multiple"])
@pytest.mark.parametrize("variant", [VARIANTS[0], VARIANTS[-1]], ids=lambda variant: variant.model)
def test_optimum_has_the_cost_in_the_study_and_less_than_the_truth(variant, case):
    objective, _, at_truth, _ = problem(variant.model, case)
    optimum_found = optimum(variant, case)
    [residuals] = objective.residuals(objective.encode(optimum_found.faults)[None])

    assert residuals @ residuals == pytest.approx(optimum_found.cost, rel=1e-9)
    assert optimum_found.cost < at_truth


def test_torque_constant_causes_the_bias_of_backlash():
    before, after = (optimum(variant, "backlash high") for variant in VARIANTS[:2])
    truth = CASES["backlash high"].truth[1]
    p = ActuatorDescription().parameters

    # The model underestimates the torque, and so reaches less play with the same current.
    assert p.k_t > p.G_M
    assert before.faults[1] < truth
    assert abs(after.faults[1] - truth) < 0.2 * abs(before.faults[1] - truth)


@pytest.mark.parametrize("level", ["low", "high"])
def test_eccentricity_is_identified_with_the_driven_pair_and_not_with_eq_4_24(level):
    case = f"eccentricity {level}"
    errors = [optimum(variant, case).error_percent for variant in VARIANTS]
    assert max(errors[2:]) < 1.0 < 10.0 < min(errors[:2])
    # The printed equation fits worse at the truth than at its optimum, or without any fault.
    _, _, at_truth, at_healthy = problem("thesis", case)
    assert optimum(VARIANTS[0], case).cost < at_healthy < at_truth
