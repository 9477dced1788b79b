# SPDX-License-Identifier: Apache-2.0
"""The lowest cost near the true faults, for models that differ in one respect at a time.

No search finds a better point: the error there is the bias of the model (docs/study.md).
"""

from dataclasses import replace
from functools import cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.faults import estimation_error, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.identification.objective import Objective
from ema_monitor.optimizers.driver import SearchProgress, minimise
from ema_monitor.optimizers.interface import Hints
from ema_monitor.optimizers.least_squares import ScreenedLeastSquares
from ema_study.cases import CASES
from ema_study.models import FITNESS, MODELS, reference_window
from ema_study.stop_rules import stop_rule

_BUDGET: Final = 2000
_BESIDE: Final = 0.02


class Variant(NamedTuple):
    """A model and its calibration."""

    model: str
    true_torque_constant: bool
    """Whether the torque gain G_M is k_t of the reference."""
    structural: bool
    """Whether the calibration fits lift, friction and inertia.

    If not, it is the row of differences alone, as in the thesis.
    """


VARIANTS: Final = (
    Variant("thesis", False, False),
    Variant("thesis", True, False),
    Variant("fast", True, False),
    Variant("fast", True, True),
)
"""From the thesis's model to the shipped one, one change per step."""


class Optimum(NamedTuple):
    """The end of a descent from the true faults: its error (M14) [%] and its cost [A^2.s]."""

    faults: NDArray[np.float64]
    error_percent: float
    cost: float


@cache
def optimum(variant: Variant, case: str) -> Optimum:
    """Return the optimum near the truth.

    The descent is by least squares, in coordinates in which the residuals are smooth. Friction
    sticks and slips, so that the cost has local minima. Therefore the lower end of two descents
    counts: one from the truth, and one from a point 0.02 away in each component.
    """
    truth = CASES[case].truth
    objective = Objective(reference_window(truth), _calibration(variant), FITNESS)
    start = objective.encode(truth)
    beside = start + np.where(start > 0.5, -_BESIDE, _BESIDE)
    lowest = min(
        (_descent(objective, start_point) for start_point in (start, beside)),
        key=lambda descent: descent.cost,
    )
    faults, _ = objective.decode(lowest.point[None])
    return Optimum(faults[0], float(estimation_error(faults[0], truth)), lowest.cost)


def _descent(objective: Objective, start: NDArray[np.float64]) -> SearchProgress:
    # Any cost is accepted, so that no screening follows the descent; the result is deterministic.
    optimizer = ScreenedLeastSquares(start, np.random.default_rng(0), Hints(good_cost=np.inf))
    *_, last = minimise(
        objective.residuals, optimizer, stop_rule("all_generations", "pso", "low", _BUDGET, 0.0)
    )
    return last


@cache
def _calibration(variant: Variant) -> Calibration:
    description = ActuatorDescription()
    if variant.true_torque_constant:
        parameters = description.parameters
        description = replace(description, parameters=parameters.replace({"G_M": parameters.k_t}))
    return calibrate_model(
        [reference_window(healthy_faults())],
        description,
        MODELS[variant.model],
        structural=variant.structural,
    )
