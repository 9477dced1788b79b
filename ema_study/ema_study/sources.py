# SPDX-License-Identifier: Apache-2.0
"""Sources of runs: the printed tables, and each model with this project's or the thesis's code."""

from typing import Final

import pandas as pd

from ema_study.cases import ALGORITHMS, SINGLE_FAULTS
from ema_study.plan import VARIANTS
from ema_study.printed import PRINTED, printed_runs
from ema_study.stop_rules import family_of

PRINTED_RUNS: Final = "printed runs"
"""Label of values computed from the thesis's runs; printed values have the label ``PRINTED``."""

MODEL_LABELS: Final = {"thesis": "thesis's model", "fast": "fast model"}
"""Labels of the reproduced sources, keyed by model, in the order of the tables."""

ALGORITHM_NAMES: Final = {name: name.upper() for name in ALGORITHMS}
"""Names of the algorithms, in the order of the tables."""


def with_own_code(label: str) -> str:
    """Return the label of runs of a model for which DE and GWO are the thesis's own code."""
    return f"{label}, thesis's code"


NAMES_WITH_OWN_CODE: Final = ALGORITHM_NAMES | {
    variant: with_own_code(ALGORITHM_NAMES[name]) for name, variant in VARIANTS.items()
}
"""Names of the algorithms, the thesis's own code last."""

SOURCES: Final = (
    PRINTED,
    *(name for label in MODEL_LABELS.values() for name in (label, with_own_code(label))),
)
"""Labels of all sources, in the order of tables and figures."""


def counted(runs: pd.DataFrame, first_table: int = 11) -> pd.DataFrame:
    """Return the runs used in statistics, with columns ``source`` and ``family``.

    ``family`` is the thesis's algorithm that a run implements. The trials of GA and DE (tables 8 to
    10) and runs with the printed rule are excluded. A
    ``first_table`` of 9 includes the trials of DE. ``runs`` may be empty, without any columns.
    """
    if runs.empty:
        columns = ["model", "table", "algorithm", "fault", "level", "source", "family"]
        return pd.DataFrame(columns=columns)
    chosen = runs[runs["table"] >= first_table]
    if "rule" in chosen:
        chosen = chosen[chosen["rule"] != "printed"]
    family = chosen["algorithm"].map(family_of)
    labels = chosen["model"].map({PRINTED: PRINTED, **MODEL_LABELS})
    has_own_code = family != chosen["algorithm"]
    source = labels.mask(has_own_code, labels.map(with_own_code, na_action="ignore"))
    return chosen.assign(family=family, source=source)


def single_fault_runs(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs of tables 11 to 54 that are used in statistics."""
    runs = counted(runs)
    return runs[runs["fault"].isin(SINGLE_FAULTS)]


def present_sources(runs: pd.DataFrame) -> list[str]:
    """Return the labels of the sources of counted runs, in the order of ``SOURCES``."""
    present = set(runs["source"])
    return [label for label in SOURCES if label in present]


def by_source(runs: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the runs of tables 9 to 57, keyed by the label of their source.

    ``PRINTED`` comes first, followed by the reproduced sources with runs. Column "algorithm" is one
    of the thesis's four algorithms. Column "own_code" is True for runs of the thesis's own DE and
    GWO. A source with the thesis's own code includes the GA and PSO runs of the source without it.
    """
    ours = counted(runs, 9)
    sources = {PRINTED: printed_runs().assign(own_code=False)}
    for label in present_sources(ours):
        selected = ours[ours["source"] == label]
        model = label.removesuffix(with_own_code(""))
        if label != model:
            shared = (ours["source"] == model) & ours["algorithm"].isin(["ga", "pso"])
            selected = pd.concat([selected, ours[shared]]).sort_index()
        sources[label] = selected.assign(
            own_code=selected["algorithm"] != selected["family"], algorithm=selected["family"]
        )
    return sources
