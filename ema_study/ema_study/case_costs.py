"""What the true and the healthy faults cost with a model."""

from functools import cache

from ema_core.faults import healthy_faults
from ema_study.models import problem


@cache
def truth_and_healthy_costs(model: str, case: str) -> tuple[float, float]:
    """Return what a case's true faults cost, and what the healthy ones do [A^2.s].

    Parameters
    ----------
    model
        One of ``ema_study.models.MODELS``.
    case
        One of ``ema_study.cases.CASES``.
    """
    objective, _, at_truth = problem(model, case)
    [residuals] = objective.residuals(objective.encode(healthy_faults())[None])
    return at_truth, float(residuals @ residuals)


def describes(model: str, case: str) -> bool:
    """Return whether a model describes a case: its true faults cost less than the healthy ones."""
    at_truth, at_healthy = truth_and_healthy_costs(model, case)
    return at_truth < at_healthy
