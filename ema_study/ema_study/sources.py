"""Where runs come from: the thesis, or our models, each with and without the thesis's own code."""

from typing import Final

import pandas as pd

from ema_study.plan import ALGORITHMS, VARIANTS
from ema_study.printed_runs import PRINTED, printed_runs

PRINTED_RUNS: Final = "printed runs"
"""Label of what is computed from the thesis's runs, beside ``PRINTED``, what it prints itself."""

THESIS_MODEL: Final = "thesis's model"
FAST_MODEL: Final = "fast model"

MODEL_LABELS: Final = {"thesis": THESIS_MODEL, "fast": FAST_MODEL}
"""Labels of our sources by name of the model, in the order of the tables."""

ALGORITHM_NAMES: Final = {"ga": "GA", "pso": "PSO", "de": "DE", "gwo": "GWO"}
"""What the algorithms are called, in the order of the tables."""

_BY_VARIANT = {variant: algorithm for algorithm, variant in VARIANTS.items()}
_FIRST_TABLE_OF_RUNS = 9


def with_own_code(label: str) -> str:
    """Return the label of a model whose DE and GWO are the thesis's own code."""
    return f"{label}, thesis's code"


def statistical(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs that belong to tables 9 to 57.

    The trials of table 8 do not, nor do the runs that show that the printed threshold is never met.
    """
    if runs.empty:
        return runs
    of_tables = runs["table"] >= _FIRST_TABLE_OF_RUNS
    if "rule" in runs:
        of_tables &= runs["rule"] != "printed"
    return runs[of_tables]


def by_source(runs: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the runs of tables 9 to 57 by label of their source, the thesis's first.

    Parameters
    ----------
    runs
        Ours, as of ``ema_study.record.as_frame``; may be empty.

    Returns
    -------
    dict
        ``PRINTED`` and then our sources, as far as there are runs. "algorithm" is one of the four
        everywhere; where the thesis's code runs DE and GWO, GA and PSO are the same as without,
        and "own_code" tells which is which.
    """
    sources = {PRINTED: printed_runs().assign(own_code=False)}
    ours = statistical(runs)
    if ours.empty:
        return sources
    own_code = ours["algorithm"].isin(list(_BY_VARIANT))
    ours = ours.assign(algorithm=ours["algorithm"].replace(_BY_VARIANT), own_code=own_code)
    ours = ours[ours["algorithm"].isin(ALGORITHMS)]
    for model, label in MODEL_LABELS.items():
        of_model = ours[ours["model"] == model]
        plain = of_model[~of_model["own_code"]]
        if not plain.empty:
            sources[label] = plain
        if of_model["own_code"].any():
            shared = ~of_model["algorithm"].isin(list(VARIANTS))
            sources[with_own_code(label)] = of_model[of_model["own_code"] | shared]
    return sources
