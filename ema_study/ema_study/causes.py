"""Where the biases of an estimate come from: the model's own optimum next to the truth.

A search can find no better than the lowest point of its cost. That point, found by descending from
the true faults, is compared between models that differ in one thing at a time.
"""

from dataclasses import replace
from functools import cache
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.faults import FAULT_NAMES, estimation_error, healthy_faults
from ema_monitor.calibration import Calibration
from ema_monitor.healthy_fit import calibrate
from ema_monitor.objective import Objective
from ema_monitor.optimizers.driver import Progress, minimise
from ema_monitor.optimizers.interface import Hints
from ema_monitor.optimizers.least_squares import ScreenedLeastSquares
from ema_study.cases import CASES
from ema_study.models import FITNESS, MODELS, reference_window
from ema_study.sources import FAST_MODEL, THESIS_MODEL
from ema_study.stop_rules import AllGenerations

_BUDGET: Final = 2000
_BESIDE: Final = 0.02


class Variant(NamedTuple):
    """A model and its calibration.

    Attributes
    ----------
    label
        What it is called.
    model
        One of ``ema_study.models.MODELS``.
    true_torque_constant
        Whether the gain of torque G_M is the reference's k_t.
    structural
        Whether the calibration fits lift, friction and inertia; else it is the row of differences
        alone, as the thesis's.
    """

    label: str
    model: str
    true_torque_constant: bool
    structural: bool


VARIANTS: Final = (
    Variant(THESIS_MODEL, "thesis", False, False),
    Variant(f"{THESIS_MODEL}, G_M = k_t", "thesis", True, False),
    Variant(f"{FAST_MODEL}, differences alone", "fast", True, False),
    Variant(FAST_MODEL, "fast", True, True),
)
"""From the thesis's model to the shipped one, each but for one thing as the one before."""

STEPS: Final = (
    "the torque constant in place of G_M",
    "the driven pair of phases in place of the one phase",
    "fitting lift, friction and inertia",
)
"""What each of the variants has that the one before has not."""


class Optimum(NamedTuple):
    """The end of a descent from the true faults.

    Attributes
    ----------
    faults
        Fault vector, ``(8,)``.
    error_percent
        Its error (M14) [%].
    cost
        What it costs [A^2.s].
    """

    faults: NDArray[np.float64]
    error_percent: float
    cost: float


@cache
def optimum(variant: Variant, case: str) -> Optimum:
    """Return the optimum next to the truth.

    Parameters
    ----------
    variant
        One of ``VARIANTS``.
    case
        One of ``ema_study.cases.CASES``.

    Notes
    -----
    By least squares, in coordinates in which the residuals are smooth. Friction sticks and slips,
    so the cost has wrinkles that may hold a descent: the lower of two counts, one from the truth
    and one from 0.02 beside it in each component. There may be a somewhat lower one yet.
    """
    truth = CASES[case].truth
    objective = Objective(reference_window(truth), _calibration(variant), FITNESS)
    start = objective.encode(truth)
    beside = start + np.where(start > 0.5, -_BESIDE, _BESIDE)
    found = min(
        (_descent(objective, one) for one in (start, beside)), key=lambda descent: descent.cost
    )
    faults, _ = objective.decode(found.point[None])
    return Optimum(faults[0], float(estimation_error(faults[0], truth)), found.cost)


def _descent(objective: Objective, start: NDArray[np.float64]) -> Progress:
    # Any cost is good enough, so that no screen follows the descent; nothing in it is random.
    optimizer = ScreenedLeastSquares(start, np.random.default_rng(0), Hints(good_cost=np.inf))
    *_, last = minimise(objective.residuals, optimizer, AllGenerations(_BUDGET))
    return last


@cache
def _calibration(variant: Variant) -> Calibration:
    description = ActuatorDescription()
    if variant.true_torque_constant:
        parameters = description.parameters
        description = replace(description, parameters=parameters.replace({"G_M": parameters.k_t}))
    return calibrate(
        [reference_window(healthy_faults())],
        description,
        MODELS[variant.model],
        structural=variant.structural,
    )


def component(case: str) -> int | None:
    """Return the place of the one faulty component of a case; None of the multiple fault."""
    faults = CASES[case].faults
    if len(faults) > 1:
        return None
    [name] = faults
    return FAULT_NAMES.index(name)


def causes_table() -> pd.DataFrame:
    """Return the optimum of every variant in every case.

    Returns
    -------
    pandas.DataFrame
        Index the cases. Columns (label of the variant, quantity): "error [%]" and "estimate" of
        the faulty component, empty for the multiple fault; before them ("truth", "component").
    """
    rows = {}
    for case in CASES:
        place = component(case)
        row: dict[tuple[str, str], float] = {
            ("truth", "component"): _of(CASES[case].truth, place),
        }
        for variant in VARIANTS:
            found = optimum(variant, case)
            row[variant.label, "error [%]"] = found.error_percent
            row[variant.label, "estimate"] = _of(found.faults, place)
        rows[case] = row
    columns = pd.MultiIndex.from_tuples(list(rows["multiple"]), names=["source", "quantity"])
    cells = [list(row.values()) for row in rows.values()]
    return pd.DataFrame(cells, index=pd.Index(list(rows), name="fault"), columns=columns)


def modulation_table() -> pd.DataFrame:
    """Return what eq. 4.24 makes of eccentricity, and what the driven pair of phases does.

    Returns
    -------
    pandas.DataFrame
        Index (case, what modulates); columns "truth [A²·s]", "healthy [A²·s]" and
        "optimum [A²·s]", what these cost, and the "estimate" of k6 at the optimum. Both are
        calibrated by the row of differences alone, with the reference's torque constant.
    """
    rows = {}
    for case in CASES:
        if CASES[case].fault != "eccentricity":
            continue
        for variant, name in zip(VARIANTS[1:3], ("eq. 4.24", "driven pair"), strict=True):
            objective = Objective(
                reference_window(CASES[case].truth), _calibration(variant), FITNESS
            )
            points = [objective.encode(faults) for faults in (CASES[case].truth, healthy_faults())]
            truth, healthy = np.sum(objective.residuals(np.array(points)) ** 2, axis=1)
            found = optimum(variant, case)
            rows[case, name] = [truth, healthy, found.cost, _of(found.faults, component(case))]
    return pd.DataFrame.from_dict(
        rows,
        orient="index",
        columns=["truth [A²·s]", "healthy [A²·s]", "optimum [A²·s]", "estimate"],
    ).set_axis(pd.MultiIndex.from_tuples(list(rows), names=["fault", "modulation"]))


def _of(faults: NDArray[np.float64], place: int | None) -> float:
    return float("nan") if place is None else float(faults[place])
