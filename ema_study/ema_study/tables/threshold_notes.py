"""What to know of the tables in which the floor-corrected threshold says nothing."""

import pandas as pd

from ema_study.averages import single_fault_runs
from ema_study.case_costs import describes, truth_and_healthy_costs
from ema_study.cases import CASES, SINGLE_FAULTS
from ema_study.plan import VARIANTS
from ema_study.printed_runs import printed_runs
from ema_study.sources import MODEL_LABELS, SOURCES
from ema_study.stop_rules import THRESHOLD


def threshold_notes(number: int, sources: dict[str, pd.DataFrame]) -> list[str]:
    """Return notes on the cases of a table of DE's or GWO's runs that a model does not describe.

    Where the true faults cost more than the healthy ones, the threshold, which is 1e-3 above the
    cost of the true ones, is met by the healthy vector already.

    Parameters
    ----------
    number
        Of the table.
    sources
        Runs by source.
    """
    [case] = [name for name, tables in _tables_with_threshold().items() if number in tables] or [""]
    notes = []
    for model in _models_of(sources):
        if case not in _not_described(model):
            continue
        at_truth, at_healthy = truth_and_healthy_costs(model, case)
        runs = pd.concat(
            [
                sources[source.label]
                for source in SOURCES
                if source.model == model and source.label in sources
            ]
        )
        ended = runs.loc[runs["table"] == number, "generations"]
        if ended.empty:
            continue
        notes.append(
            f"With the {MODEL_LABELS[model]} the true faults cost {at_truth:.4f} A²·s, the healthy "
            f"ones {at_healthy:.4f}: the floor-corrected threshold of {at_truth + THRESHOLD:.4f} "
            f"is met at once, and the runs end after {_range(ended)} generations, with the first "
            "one behind generation 20 that brings nothing. Their time and error are not those of a "
            "search that was let finish."
        )
    return notes


def threshold_summary(sources: dict[str, pd.DataFrame], fault: str | None = None) -> list[str]:
    """Return notes on the cases that a model does not describe, for a table of means.

    Parameters
    ----------
    sources
        Runs by source.
    fault
        Kind of fault that the table is about; all single ones by default.
    """
    notes = []
    for model in _models_of(sources):
        cases = [name for name in _not_described(model) if fault in (None, CASES[name].fault)]
        if not cases:
            continue
        tables = sorted(number for name in cases for number in _tables_with_threshold()[name])
        notes.append(
            f"With the {MODEL_LABELS[model]} the true faults cost more than the healthy ones in "
            f"{_listed(cases)}: DE and GWO meet the floor-corrected threshold at once and stop "
            f"as soon as they may (tables {_listed(list(map(str, tables)))})."
        )
    return notes


def _models_of(sources: dict[str, pd.DataFrame]) -> list[str]:
    return [model for model, label in MODEL_LABELS.items() if label in sources]


def _not_described(model: str) -> list[str]:
    single = (name for name, case in CASES.items() if case.fault in SINGLE_FAULTS)
    return [name for name in single if not describes(model, name)]


def _tables_with_threshold() -> dict[str, list[int]]:
    """Return the tables of DE and GWO among the tables of each single fault, by case."""
    runs = single_fault_runs(printed_runs())
    runs = runs[runs["algorithm"].isin(list(VARIANTS))]
    return {
        name: sorted(
            set(runs.loc[(runs["fault"] == case.fault) & (runs["level"] == case.level), "table"])
        )
        for name, case in CASES.items()
        if case.fault in SINGLE_FAULTS
    }


def _range(numbers: "pd.Series[int]") -> str:
    low, high = int(numbers.min()), int(numbers.max())
    return str(low) if low == high else f"{low} to {high}"


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
