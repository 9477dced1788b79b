"""Why the mean error of a model's runs is not within the thesis's range, in figures."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np
import pandas as pd

from ema_study.case_costs import describes, truth_and_healthy_costs
from ema_study.cases import StudyCase
from ema_study.causes import STEPS, VARIANTS, Variant, component, optimum
from ema_study.record import K

_AS_LOW: Final = 1.01
"""A search has got down to a point if it costs less than this many times that [-]."""

_OF_MODEL: Final = {"thesis": VARIANTS[0], "fast": VARIANTS[-1]}


def reason(model: str, case: StudyCase, ours: pd.DataFrame, thesis: pd.DataFrame) -> str:
    """Return what the difference between our mean error and the thesis's is made of.

    Parameters
    ----------
    model
        Name of the model.
    case
        The fault.
    ours, thesis
        Its runs, at least one each.

    Notes
    -----
    The error is divided into what the optimum of a model next to the truth has, and what the
    searches add; the optima are those of ``ema_study.causes``. What none of it accounts for is
    called unexplained.
    """
    parts = [_direction(ours, thesis)]
    place = component(case.name)
    if place is not None:
        parts.append(_estimates(K[place], ours, thesis))
    parts += _misfit(model, case, place)
    parts.append(_search(model, case, place, ours))
    if model == "thesis":
        parts += _torque_constant(case, place)
    else:
        parts.append(_steps(case, place))
    parts.append(_unexplained(case, thesis))
    return " ".join(parts)


def _direction(ours: pd.DataFrame, thesis: pd.DataFrame) -> str:
    error, errors = ours["error_percent"].mean(), thesis["error_percent"]
    of = "That of a single run" if len(ours) == 1 else f"The mean of {len(ours)} runs"
    if error < errors.min():
        return f"{of}, {error:.2f} %, is below the thesis's lowest, {errors.min():.2f} %."
    return f"{of}, {error:.2f} %, is above the thesis's highest, {errors.max():.2f} %."


def _estimates(column: str, ours: pd.DataFrame, thesis: pd.DataFrame) -> str:
    off, thesis_off = (_bias(one, column) for one in (ours, thesis))
    rest, thesis_rest = (_other_components(one, column) for one in (ours, thesis))
    return (
        f"{column} is off by {off:+.4f}, the thesis's by {thesis_off:+.4f}; the other components "
        f"together by {rest:.2f} %, the thesis's by {thesis_rest:.2f} %."
    )


def _misfit(model: str, case: StudyCase, place: int | None) -> Iterator[str]:
    """Yield that the model does not describe the fault, where it does not."""
    if describes(model, case.name):
        return
    at_truth, at_healthy = truth_and_healthy_costs(model, case.name)
    lowest = optimum(_OF_MODEL[model], case.name)
    pair = VARIANTS[2]
    of_pair = optimum(pair, case.name)
    yield (
        f"This model does not describe the fault: the true faults cost {at_truth:.4f} A²·s, the "
        f"healthy ones {at_healthy:.4f}, and the optimum still {lowest.cost:.4f}."
    )
    yield (
        "The cause is eq. 4.24: with the driven pair of phases instead, likewise calibrated by the "
        f"row of differences alone, the optimum costs {of_pair.cost:.4f} and has "
        f"{_found(pair, case, place)}."
    )


def _search(model: str, case: StudyCase, place: int | None, ours: pd.DataFrame) -> str:
    variant = _OF_MODEL[model]
    lowest = optimum(variant, case.name)
    text = f"The optimum of this model has {_found(variant, case, place)}"
    stuck = int((ours["cost"] > _AS_LOW * lowest.cost).sum())
    if stuck:
        return (
            f"{text}; {stuck} of {len(ours)} searches ended above its cost: they stopped before "
            "it, or at another one."
        )
    beyond = ours["error_percent"].mean() - lowest.error_percent
    return (
        f"{text}, and the searches come down to its cost: all but {beyond:+.2f} points is the "
        "model's."
    )


def _torque_constant(case: StudyCase, place: int | None) -> Iterator[str]:
    """Yield what becomes of the thesis's model with the reference's torque constant."""
    if not describes("thesis", case.name):
        return  # of an optimum that is nowhere near the truth, a shift tells nothing
    text = f"With the reference's torque constant for G_M it has {_found(VARIANTS[1], case, place)}"
    if place is None:
        yield f"{text}."
        return
    off, left = (
        float(optimum(variant, case.name).faults[place] - case.truth[place])
        for variant in VARIANTS[:2]
    )
    yield (
        f"{text}: G_M shifts {K[place]} by {off - left:+.4f}, without it {left:+.4f} of the "
        f"{off:+.4f} is left."
    )


def _steps(case: StudyCase, place: int | None) -> str:
    """Return what each step from the thesis's model to the fast one changes."""
    optima = [optimum(variant, case.name) for variant in VARIANTS]
    changes = [
        f"{what} {after.error_percent - before.error_percent:+.2f}"
        for what, (before, after) in zip(STEPS, pairwise(optima), strict=True)
    ]
    whole = optima[-1].error_percent - optima[0].error_percent
    return (
        f"That of the thesis's model has {_found(VARIANTS[0], case, place)}. One step after the "
        f"other makes the difference of {whole:+.2f} points: {', '.join(changes)}."
    )


def _unexplained(case: StudyCase, thesis: pd.DataFrame) -> str:
    printed = thesis["error_percent"].mean()
    if not describes("thesis", case.name):
        return (
            "Unexplained: what model the thesis's runs were made with. They find the fault to "
            f"{printed:.2f} %, so it cannot have been eq. 4.24 as printed."
        )
    of_model = optimum(VARIANTS[0], case.name).error_percent
    return (
        f"Unexplained: the {printed - of_model:+.2f} points by which the thesis's mean, "
        f"{printed:.2f} %, differs from the optimum of its model as it is rebuilt here. It does "
        "not print all of its reference (gear ratio, sampling of the current), and its searches "
        "are in its figure."
    )


def _found(variant: Variant, case: StudyCase, place: int | None) -> str:
    found = optimum(variant, case.name)
    error = f"an error of {found.error_percent:.2f} %"
    return error if place is None else f"{error} ({K[place]} {found.faults[place]:.4f})"


def _bias(runs: pd.DataFrame, column: str) -> float:
    return float((runs[column] - runs[f"true_{column}"]).mean())


def _other_components(runs: pd.DataFrame, column: str) -> float:
    """Return the mean error of the components that are to be healthy [%]."""
    others = [k for k in K if k not in (column, "k7")]
    squares = sum((runs[k] - runs[f"true_{k}"]) ** 2 for k in others)
    return float(100.0 * np.sqrt(squares).mean())
