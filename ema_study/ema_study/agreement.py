"""Whether our errors agree with the thesis's, fault by fault, and why not where they do not."""

from typing import Final

import numpy as np
import pandas as pd

from ema_core.faults import FAULT_NAMES
from ema_study.case_costs import truth_and_healthy_costs
from ema_study.cases import CASES, MULTIPLE, StudyCase
from ema_study.plan import ALGORITHMS, VARIANTS
from ema_study.printed_runs import PRINTED, printed_runs
from ema_study.record import K
from ema_study.reliability import PRECISION_STUDY
from ema_study.sources import ALGORITHM_NAMES, MODEL_LABELS, by_source, statistical

ALGORITHM: Final = "pso"
"""The algorithm that is compared: the thesis's best, and Matlab's own rather than its author's."""

_SPREAD_AS_SEARCHED = 1.01
"""A search that ends above this many times the cost of the truth has not got down to it."""

_WINDOWS = 10_000

_NOT_PRINTED = (
    "The form of model and calibration is the thesis's; what it does not print of its reference "
    "(gear ratio, sampling of the current) may differ."
)

_CALIBRATION = (
    "This model's torque constant is the reference's, and its calibration fits lift, friction and "
    "inertia before it stores what is left as a row of differences; the thesis's model has a gain "
    "of its own for it and stores all of it, which is right near the healthy state only."
)


def agreement(runs: pd.DataFrame) -> pd.DataFrame:
    """Compare the errors of particle swarm runs, fault by fault, with the thesis's.

    Parameters
    ----------
    runs
        Our runs, as of ``ema_study.record.as_frame``; may be incomplete or empty.

    Returns
    -------
    pandas.DataFrame
        Index: the names of ``CASES``; the multiple fault is that of the study of precision (table
        57). Columns (source, quantity). Of "printed": "component" that is faulty (empty for the
        multiple fault), its "true value", "runs", "lowest error [%]", "mean error [%]", "highest
        error [%]" and the "mean estimate" of the component. Of each of our models that has runs:
        "runs", "mean error [%]", "mean estimate", "within" (whether the mean error is between the
        thesis's lowest and highest; None without runs) and "reason" (why not; else empty).
    """
    ours = {
        label: frame for label, frame in by_source(runs).items() if label in MODEL_LABELS.values()
    }
    models = {label: model for model, label in MODEL_LABELS.items()}
    rows: dict[str, dict[tuple[str, str], object]] = {}
    for name, case in CASES.items():
        thesis = _of_case(printed_runs(), case)
        row: dict[tuple[str, str], object] = {
            (PRINTED, what): value for what, value in _printed_side(case, thesis).items()
        }
        for label, frame in ours.items():
            side = _our_side(models[label], case, _of_case(frame, case), thesis)
            row |= {(label, what): value for what, value in side.items()}
        rows[name] = row
    columns = pd.MultiIndex.from_tuples(
        list(next(iter(rows.values()))), names=["source", "quantity"]
    )
    cells = [list(row.values()) for row in rows.values()]
    table = pd.DataFrame(cells, index=pd.Index(list(rows), name="fault"), columns=columns)
    return table.astype({column: object for column in columns if column[1] == "within"})


def time_per_10000_windows(runs: pd.DataFrame) -> pd.DataFrame:
    """Return what 10,000 evaluations take: the median over runs, by algorithm [s].

    Parameters
    ----------
    runs
        Our runs; may be empty.

    Returns
    -------
    pandas.DataFrame
        Index the algorithms as called, the thesis's own DE and GWO apart; columns "printed" and
        the labels of our models. Runs of tables 11 to 57; the thesis's evaluations are 50 times
        its generations.
    """
    thesis = printed_runs()
    columns = {PRINTED: _median_time(thesis.assign(evaluations=50 * thesis["generations"]))}
    ours = statistical(runs)
    for model, label in MODEL_LABELS.items():
        if not ours.empty and (ours["model"] == model).any():
            columns[label] = _median_time(ours[ours["model"] == model])
    names = dict(ALGORITHM_NAMES)
    names |= {VARIANTS[name]: f"{ALGORITHM_NAMES[name]}, thesis's code" for name in VARIANTS}
    table = pd.DataFrame(columns).reindex([*ALGORITHMS, *VARIANTS.values()])
    return table.rename(index=names).rename_axis("algorithm")


def _median_time(runs: pd.DataFrame) -> pd.Series:
    runs = runs[runs["table"] > 10]
    return (_WINDOWS * runs["time_s"] / runs["evaluations"]).groupby(runs["algorithm"]).median()


def _of_case(runs: pd.DataFrame, case: StudyCase) -> pd.DataFrame:
    """Return the particle swarm's runs of a case."""
    of_case = (runs["algorithm"] == ALGORITHM) & (runs["fault"] == case.fault)
    if case.fault == MULTIPLE:
        return runs[of_case & (runs["table"] == PRECISION_STUDY)]
    return runs[of_case & (runs["level"] == case.level)]


def _component(case: StudyCase) -> str | None:
    """Return the column of the one faulty component; None of the multiple fault."""
    if case.fault == MULTIPLE:
        return None
    [name] = case.faults
    return K[FAULT_NAMES.index(name)]


def _printed_side(case: StudyCase, thesis: pd.DataFrame) -> dict[str, object]:
    component = _component(case)
    errors = thesis["error_percent"]
    return {
        "component": component or "",
        "true value": thesis[f"true_{component}"].mean() if component else np.nan,
        "runs": len(thesis),
        "lowest error [%]": errors.min(),
        "mean error [%]": errors.mean(),
        "highest error [%]": errors.max(),
        "mean estimate": thesis[component].mean() if component else np.nan,
    }


def _our_side(
    model: str, case: StudyCase, ours: pd.DataFrame, thesis: pd.DataFrame
) -> dict[str, object]:
    component = _component(case)
    error = ours["error_percent"].mean()
    lowest, highest = thesis["error_percent"].min(), thesis["error_percent"].max()
    if ours.empty:
        within, reason = None, ""
    elif error < lowest:
        within, reason = False, _why_lower(model, component, ours, thesis)
    elif error > highest:
        within, reason = False, _why_higher(model, case, ours)
    else:
        within, reason = True, ""
    return {
        "runs": len(ours),
        "mean error [%]": error,
        "mean estimate": ours[component].mean() if component else np.nan,
        "within": within,
        "reason": reason,
    }


def _why_lower(model: str, component: str | None, ours: pd.DataFrame, thesis: pd.DataFrame) -> str:
    parts = ["Lower than the thesis's lowest."]
    rest, thesis_rest = _other_components(ours, component), _other_components(thesis, component)
    closer = rest < thesis_rest
    if component is not None:
        bias, thesis_bias = _bias(ours, component), _bias(thesis, component)
        closer = abs(bias) < abs(thesis_bias)
        parts.append(
            f"The mean estimate is {'closer' if closer else 'no closer'} to the truth: off by "
            f"{bias:+.4f}, the thesis's by {thesis_bias:+.4f}."
        )
    if rest < thesis_rest:
        which = "The components" if component is None else "The other components"
        parts.append(
            f"{which} together are off by {rest:.2f} %, the thesis's by {thesis_rest:.2f} %."
        )
    if model == "thesis":
        parts.append(_NOT_PRINTED)
    elif closer:
        parts.append(_CALIBRATION)
    return " ".join(parts)


def _why_higher(model: str, case: StudyCase, ours: pd.DataFrame) -> str:
    parts = ["Higher than the thesis's highest."]
    at_truth, at_healthy = truth_and_healthy_costs(model, case.name)
    if at_truth > at_healthy:
        parts.append(
            f"The model does not describe this fault: the true faults cost {at_truth:.4f} A^2.s, "
            f"the healthy ones {at_healthy:.4f}."
        )
        if model == "thesis" and case.fault == "eccentricity":
            parts.append(
                "That is eq. 4.24 as printed; the thesis's runs find this fault, so its model "
                "cannot have been that."
            )
    below = int((ours["cost"] < at_truth).sum())
    stuck = int((ours["cost"] > _SPREAD_AS_SEARCHED * at_truth).sum())
    if below:
        parts.append(
            f"{below} of {len(ours)} searches found a point that costs less than the truth: "
            "there the model is off, not the search."
        )
        if model == "thesis" and at_truth <= at_healthy:
            parts.append(_NOT_PRINTED)
    if stuck:
        parts.append(
            f"{stuck} of {len(ours)} searches ended above the cost of the truth: they stopped "
            "before the minimum, or at another one."
        )
    if not below and not stuck:
        parts.append("The searches ended at the cost of the truth: the minimum is flat.")
    return " ".join(parts)


def _bias(runs: pd.DataFrame, component: str) -> float:
    return float((runs[component] - runs[f"true_{component}"]).mean())


def _other_components(runs: pd.DataFrame, component: str | None) -> float:
    """Return the mean error of the components that are to be healthy [%]."""
    others = [k for k in K if k not in (component, "k7")]
    squares = sum((runs[k] - runs[f"true_{k}"]) ** 2 for k in others)
    return float(100.0 * np.sqrt(squares).mean())
