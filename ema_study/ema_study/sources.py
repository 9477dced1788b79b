"""Sources of runs: the thesis, or our models, each with and without the thesis's own code."""

from typing import Final

import pandas as pd

from ema_study.cases import ALGORITHMS, SINGLE_FAULTS
from ema_study.plan import VARIANTS
from ema_study.printed import PRINTED, printed_runs
from ema_study.stop_rules import family_of

PRINTED_RUNS: Final = "printed runs"
"""Label of figures computed from the thesis's runs; ``PRINTED`` is that of figures it prints."""

MODEL_LABELS: Final = {"thesis": "thesis's model", "fast": "fast model"}
"""Labels of our sources by name of the model, in the order of the tables."""

ALGORITHM_NAMES: Final = {name: name.upper() for name in ALGORITHMS}
"""Names of the algorithms, in the order of the tables."""


def with_own_code(label: str) -> str:
    """Return the label of a model whose DE and GWO are the thesis's own code."""
    return f"{label}, thesis's code"


NAMES_WITH_OWN_CODE: Final = ALGORITHM_NAMES | {
    variant: with_own_code(ALGORITHM_NAMES[name]) for name, variant in VARIANTS.items()
}
"""Names of the algorithms, the thesis's own code last."""

SOURCES: Final = (
    PRINTED,
    *(one for label in MODEL_LABELS.values() for one in (label, with_own_code(label))),
)
"""Labels of all sources, in the order of tables and figures."""


def counted(runs: pd.DataFrame, first_table: int = 11) -> pd.DataFrame:
    """Return the runs that statistics are made of, with their ``source`` and ``family``.

    The trials of GA and DE (tables 8 to 10) and the runs under the printed rule are left out; a
    ``first_table`` of 9 includes the trials of DE. There may be no runs, and no columns.
    """
    if runs.empty:
        columns = ["model", "table", "algorithm", "fault", "level", "source", "family"]
        return pd.DataFrame(columns=columns)
    chosen = runs[runs["table"] >= first_table]
    if "rule" in chosen:
        chosen = chosen[chosen["rule"] != "printed"]
    family = chosen["algorithm"].map(family_of)
    labels = chosen["model"].map({PRINTED: PRINTED, **MODEL_LABELS})
    own = family != chosen["algorithm"]
    source = labels.mask(own, labels.map(with_own_code, na_action="ignore"))
    return chosen.assign(family=family, source=source)


def single_fault_runs(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs of tables 11 to 54 that statistics are made of."""
    runs = counted(runs)
    return runs[runs["fault"].isin(SINGLE_FAULTS)]


def present_sources(runs: pd.DataFrame) -> list[str]:
    """Return the labels of the sources that counted runs come from, in order."""
    present = set(runs["source"])
    return [label for label in SOURCES if label in present]


def by_source(runs: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the runs of tables 9 to 57 by label of their source, the thesis's first.

    ``PRINTED`` is followed by our sources that have runs. "algorithm" is one of the thesis's four;
    a source with the thesis's own code of DE and GWO shares GA and PSO with that without, and
    "own_code" is True for the former only.
    """
    ours = counted(runs, 9)
    sources = {PRINTED: printed_runs().assign(own_code=False)}
    for label in present_sources(ours):
        found = ours[ours["source"] == label]
        model = label.removesuffix(with_own_code(""))
        if label != model:
            shared = (ours["source"] == model) & ours["algorithm"].isin(["ga", "pso"])
            found = pd.concat([found, ours[shared]]).sort_index()
        sources[label] = found.assign(
            own_code=found["algorithm"] != found["family"], algorithm=found["family"]
        )
    return sources
