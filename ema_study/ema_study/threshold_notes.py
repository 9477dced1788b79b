"""Notes on the tables in which the floor-corrected threshold has no meaning.

Where the true faults cost more than the healthy ones, the threshold, 1e-3 above the cost of the
true ones, is met by the healthy vector already: DE and GWO stop as soon as they may. ``sources``
are runs by label of their source.
"""

from collections.abc import Mapping

import pandas as pd

from ema_study.cases import CASES, SINGLE_FAULTS
from ema_study.models import describes, truth_and_healthy_costs
from ema_study.plan import VARIANTS
from ema_study.printed_runs import printed_runs
from ema_study.sources import MODEL_LABELS, single_fault_runs, with_own_code
from ema_study.stop_rules import THRESHOLD


def table_notes(number: int, sources: Mapping[str, pd.DataFrame]) -> list[str]:
    """Return notes on a table of DE's or GWO's runs whose case a model does not describe."""
    notes = []
    for model, label in MODEL_LABELS.items():
        found = [sources[one] for one in (label, with_own_code(label)) if one in sources]
        for case in _not_described(model) if found else ():
            runs = pd.concat(found)
            ended = runs.loc[runs["table"] == number, "generations"]
            if number not in _tables_with_threshold(case) or ended.empty:
                continue
            at_truth, at_healthy = truth_and_healthy_costs(model, case)
            low, high = int(ended.min()), int(ended.max())
            span = str(low) if low == high else f"{low} to {high}"
            notes.append(
                f"With the {label} the true faults cost {at_truth:.4f} A²·s, the healthy ones "
                f"{at_healthy:.4f}: the floor-corrected threshold of {at_truth + THRESHOLD:.4f} is "
                f"met at once, and the runs end after {span} generations, at the first one after "
                "generation 20 without an improvement. Their time and error are not those of a "
                "complete search."
            )
    return notes


def summary_notes(sources: Mapping[str, pd.DataFrame], fault: str | None = None) -> list[str]:
    """Return notes on the cases that a model does not describe, for a table of means.

    The table is about one kind of ``fault``, or all single ones.
    """
    notes = []
    for model, label in MODEL_LABELS.items():
        cases = _not_described(model) if label in sources else []
        cases = [name for name in cases if fault in (None, CASES[name].fault)]
        if cases:
            tables = sorted(number for case in cases for number in _tables_with_threshold(case))
            notes.append(
                f"With the {label} the true faults cost more than the healthy ones in "
                f"{_listed(cases)}: DE and GWO meet the floor-corrected threshold at once and stop "
                f"as soon as they may (tables {_listed([str(number) for number in tables])})."
            )
    return notes


def _not_described(model: str) -> list[str]:
    single = (name for name, case in CASES.items() if case.fault in SINGLE_FAULTS)
    return [name for name in single if not describes(model, name)]


def _tables_with_threshold(case: str) -> list[int]:
    """Return the tables of DE and GWO in a single fault."""
    runs = single_fault_runs(printed_runs())
    of_case = (runs["fault"] == CASES[case].fault) & (runs["level"] == CASES[case].level)
    return sorted(set(runs.loc[of_case & runs["algorithm"].isin(list(VARIANTS)), "table"]))


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
