"""Sources of runs: the thesis, or our models, each with and without the thesis's own code."""

from typing import Final, NamedTuple

import pandas as pd

from ema_study.cases import SINGLE_FAULTS
from ema_study.plan import ALGORITHMS, VARIANTS
from ema_study.printed_runs import PRINTED, printed_runs
from ema_study.stop_rules import family_of

PRINTED_RUNS: Final = "printed runs"
"""Label of figures computed from the thesis's runs; ``PRINTED`` is that of figures it prints."""

THESIS_MODEL: Final = "thesis's model"
FAST_MODEL: Final = "fast model"

MODEL_LABELS: Final = {"thesis": THESIS_MODEL, "fast": FAST_MODEL}
"""Labels of our sources by name of the model, in the order of the tables."""

ALGORITHM_NAMES: Final = {name: name.upper() for name in ALGORITHMS}
"""Names of the algorithms, in the order of the tables."""

_FIRST_TABLE_OF_RUNS: Final = 9
_FIRST_COMPARISON: Final = 11
_COLUMNS: Final = ["model", "table", "algorithm", "fault", "level"]


def with_own_code(label: str) -> str:
    """Return the label of a model whose DE and GWO are the thesis's own code."""
    return f"{label}, thesis's code"


NAMES_WITH_OWN_CODE: Final = ALGORITHM_NAMES | {
    variant: with_own_code(ALGORITHM_NAMES[name]) for name, variant in VARIANTS.items()
}
"""Names of the algorithms, the thesis's own code last."""


class Source(NamedTuple):
    """The thesis or a model, and whether the thesis's own code of DE and GWO was used."""

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

    The trials of GA and DE (tables 8 to 10) and the runs under the printed rule are left out.

    Parameters
    ----------
    runs
        Runs of any models; may be empty, even of columns.
    first_table
        Another first table, e.g. 9 to include the trials of DE.
    """
    if runs.empty:
        return pd.DataFrame(columns=_COLUMNS)
    chosen = runs["table"] >= first_table
    if "rule" in runs:
        chosen &= runs["rule"] != "printed"
    return runs[chosen]


def single_fault_runs(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs of tables 11 to 54 that statistics are made of."""
    runs = counted(runs)
    return runs[runs["fault"].isin(SINGLE_FAULTS)]


def of_source(runs: pd.DataFrame, source: Source) -> pd.DataFrame:
    """Return the runs of a source."""
    own_code = runs["algorithm"] != runs["algorithm"].map(family_of)
    return runs[(runs["model"] == source.model) & (own_code == source.own_code)]


def by_source(runs: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the runs of tables 9 to 57 by label of their source, the thesis's first.

    Parameters
    ----------
    runs
        Our runs, as of ``ema_study.result.as_frame``; may be empty.

    Returns
    -------
    dict
        ``PRINTED`` and then our sources that have runs. "algorithm" is one of the thesis's four; a
        source with the thesis's own code of DE and GWO shares GA and PSO with that without, and
        "own_code" is True for the former only.
    """
    ours = counted(runs, _FIRST_TABLE_OF_RUNS)
    sources = {PRINTED: printed_runs().assign(own_code=False)}
    for source in SOURCES[1:]:
        found = of_source(ours, source)
        if found.empty:
            continue
        if source.own_code:
            shared = (ours["model"] == source.model) & ours["algorithm"].isin(["ga", "pso"])
            found = pd.concat([found, ours[shared]]).sort_index()
        family = found["algorithm"].map(family_of)
        sources[source.label] = found.assign(
            algorithm=family, own_code=found["algorithm"] != family
        )
    return sources
