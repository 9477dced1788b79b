"""Where runs come from: the thesis, or our models, each with and without the thesis's own code."""

from typing import Final, NamedTuple

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

_FIRST_TABLE_OF_RUNS: Final = 9
_FIRST_COMPARISON: Final = 11
_NEEDED: Final = ("model", "table", "algorithm", "fault", "level")
_BY_VARIANT: Final = {variant: algorithm for algorithm, variant in VARIANTS.items()}


def with_own_code(label: str) -> str:
    """Return the label of a model whose DE and GWO are the thesis's own code."""
    return f"{label}, thesis's code"


class Source(NamedTuple):
    """Where runs come from: the thesis or a model, and whether the thesis's own code searched."""

    model: str
    own_code: bool
    label: str


SOURCES: Final = (
    Source(PRINTED, False, PRINTED),
    *(
        Source(model, own_code, with_own_code(label) if own_code else label)
        for model, label in MODEL_LABELS.items()
        for own_code in (False, True)
    ),
)
"""All sources, in the order of tables and figures."""


def counted(runs: pd.DataFrame, first_table: int = _FIRST_COMPARISON) -> pd.DataFrame:
    """Return the runs that statistics are made of: those of tables 11 to 57.

    The trials of table 8 are none of them, nor are those of DE (tables 9 and 10), nor the runs
    that show that the printed threshold is never met.

    Parameters
    ----------
    runs
        Runs of any models; may be empty, even of columns.
    first_table
        Another table to begin with, e.g. 9 where DE's trials are to be shown.
    """
    if runs.empty or not set(_NEEDED) <= set(runs.columns):
        return pd.DataFrame(columns=list(_NEEDED))
    chosen = runs["table"] >= first_table
    if "rule" in runs:
        chosen &= runs["rule"] != "printed"
    return runs[chosen]


def of_source(runs: pd.DataFrame, source: Source) -> pd.DataFrame:
    """Return the runs of a model whose search was, or was not, the thesis's own code."""
    own_code = runs["algorithm"].isin(list(_BY_VARIANT))
    return runs[(runs["model"] == source.model) & (own_code == source.own_code)]


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
    ours = counted(runs, _FIRST_TABLE_OF_RUNS)
    ours = ours[ours["algorithm"].isin([*ALGORITHMS, *_BY_VARIANT])]
    sources = {PRINTED: printed_runs().assign(own_code=False)}
    for source in SOURCES[1:]:
        found = of_source(ours, source)
        if found.empty:
            continue
        if source.own_code:
            shared = (ours["model"] == source.model) & ~ours["algorithm"].isin(
                [*VARIANTS, *_BY_VARIANT]
            )
            found = pd.concat([found, ours[shared]]).sort_index()
        sources[source.label] = found.assign(
            algorithm=found["algorithm"].replace(_BY_VARIANT),
            own_code=found["algorithm"].isin(list(_BY_VARIANT)),
        )
    return sources
