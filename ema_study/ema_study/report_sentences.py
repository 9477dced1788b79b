"""What the report says in words, computed from the runs."""

from collections.abc import Iterator
from typing import Final

import pandas as pd

from ema_study.averages import single_fault_runs
from ema_study.claims import claims
from ema_study.plan import RUNS, plan
from ema_study.printed_runs import PRINTED
from ema_study.report_tables import significant
from ema_study.sources import ALGORITHM_NAMES, MODEL_LABELS, by_source
from ema_study.stop_rules import THRESHOLD

_KEY: Final = ["model", "table", "algorithm", "run", "rule"]


def completeness(runs: pd.DataFrame) -> pd.DataFrame:
    """Return how many runs of the full study there are with each model.

    Parameters
    ----------
    runs
        Our runs; may be empty.

    Returns
    -------
    pandas.DataFrame
        Columns "model", "runs", "of the full study" and "tables that lack runs", the latter as
        text.
    """
    rows = []
    for model, label in MODEL_LABELS.items():
        jobs = plan(model, RUNS)
        made = set() if runs.empty else set(runs[_KEY].itertuples(index=False, name=None))
        lacking = [job for job in jobs if job.key not in made]
        rows.append(
            {
                "model": label,
                "runs": len(jobs) - len(lacking),
                "of the full study": len(jobs),
                "tables that lack runs": _ranges({job.table for job in lacking}) or "none",
            }
        )
    return pd.DataFrame(rows)


def ranking_sentences(runs: pd.DataFrame) -> Iterator[str]:
    """Yield how the algorithms rank over the single faults, a sentence for each source.

    Parameters
    ----------
    runs
        Our runs; may be empty.
    """
    for label, frame in by_source(runs).items():
        single = single_fault_runs(frame)
        if single.empty:
            continue
        # Each fault and level counts alike, however many runs it has.
        means = (
            single.groupby(["algorithm", "fault", "level"])[["error_percent", "time_s"]]
            .mean()
            .groupby("algorithm")
            .mean()
        )
        errors = means["error_percent"].sort_values()
        times = means["time_s"].sort_values()
        name = "The thesis prints" if label == PRINTED else f"{label.capitalize()}:"
        yield (
            f"{name} mean errors of {_listed(errors, '{:.2f} %')}; fastest is "
            f"{ALGORITHM_NAMES[str(times.index[0])]} with {significant(times.iloc[0])} s a run."
        )


def agreement_sentences(agreement: pd.DataFrame) -> Iterator[str]:
    """Yield in how many faults each model's error is within the thesis's range, below or above.

    Parameters
    ----------
    agreement
        Of ``ema_study.agreement.agreement``.
    """
    for label in MODEL_LABELS.values():
        if (label, "within") not in agreement.columns:
            yield f"There are no runs with the {label}."
            continue
        errors = agreement[label, "mean error [%]"].astype(float).dropna()
        if errors.empty:
            yield f"There are no particle swarm runs with the {label}."
            continue
        printed = agreement[PRINTED].loc[errors.index, "mean error [%]"].astype(float)
        ours = agreement[label].loc[errors.index]
        outside = ~ours["within"].to_numpy(dtype=bool)
        is_lower = (errors < printed).to_numpy()
        lower, higher = errors.index[outside & is_lower], errors.index[outside & ~is_lower]
        within = len(errors) - len(lower) - len(higher)
        yield (
            f"With the {label}, the mean error of PSO lies within the range of the thesis's ten "
            f"runs in {within} of {len(errors)} faults{_named('below', lower)}"
            f"{_named('above', higher)}."
            f"{_single_runs(ours['runs'].tolist())}"
        )


def reasons(agreement: pd.DataFrame) -> pd.DataFrame:
    """Return why errors are not within the thesis's range, a row each.

    Parameters
    ----------
    agreement
        Of ``ema_study.agreement.agreement``.
    """
    rows = [
        {"fault": fault, "model": label, "reason": reason}
        for label in MODEL_LABELS.values()
        if (label, "reason") in agreement.columns
        for fault, reason in agreement[label, "reason"].items()
        if reason
    ]
    return pd.DataFrame(rows, columns=["fault", "model", "reason"])


def printed_rule_sentences(runs: pd.DataFrame) -> Iterator[str]:
    """Yield whether the stop rule's threshold as printed was ever reached, for each model.

    Parameters
    ----------
    runs
        Our runs; may be empty.
    """
    for model, label in MODEL_LABELS.items():
        if runs.empty:
            continue
        under = runs[(runs["model"] == model) & (runs["rule"] == "printed")]
        if len(under):
            reached = int((under["cost"] <= THRESHOLD).sum())
            yield (
                f"With the {label}, {reached} of {len(under)} runs under the stop rule as printed "
                f"reached its threshold of {significant(THRESHOLD, 1)} A²·s; the lowest cost was "
                f"{significant(under['cost'].min())} A²·s."
            )


def claims_sentence() -> str:
    """Return how many claims of chapter 4 our responses bear out."""
    found = claims()
    return (
        f"Of {len(found)} claims of chapter 4 that can be measured, our responses bear out "
        f"{sum(claim.agrees for claim in found)}."
    )


def _single_runs(numbers: list[int]) -> str:
    """Return in how many faults what is called a mean is a single run; empty for none."""
    single = numbers.count(1)
    return f" {single} of the {len(numbers)} means are of a single run." if single else ""


def _named(where: str, faults: pd.Index) -> str:
    return f"; {where} in {len(faults)}: {', '.join(map(str, faults))}" if len(faults) else ""


def _listed(values: pd.Series, form: str) -> str:
    return ", ".join(
        f"{ALGORITHM_NAMES[str(name)]} {form.format(value)}" for name, value in values.items()
    )


def _ranges(numbers: set[int]) -> str:
    """Return numbers as text, neighbours as ranges."""
    parts: list[list[int]] = []
    for number in sorted(numbers):
        if parts and number - parts[-1][-1] == 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(
        f"{part[0]} to {part[-1]}" if len(part) > 2 else ", ".join(map(str, part)) for part in parts
    )
