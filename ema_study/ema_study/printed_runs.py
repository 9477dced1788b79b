"""The thesis's 500 runs, as it prints them in its tables 9 to 57."""

from functools import cache
from importlib.resources import files
from typing import Final

import pandas as pd

from ema_study.plan import GENERATIONS, POPULATION
from ema_study.stop_rules import uncounted_populations

PRINTED: Final = "printed"
"""Name of the thesis in place of a model's name."""


@cache
def _read() -> pd.DataFrame:
    with (files("ema_study") / "thesis_runs.csv").open(encoding="utf-8") as file:
        runs = pd.read_csv(file)
    uncounted = runs["algorithm"].map(uncounted_populations)
    return runs.assign(
        note=runs["note"].fillna(""),
        model=PRINTED,
        population=POPULATION,
        max_generations=GENERATIONS,
        evaluations=POPULATION * (runs["generations"] + uncounted),
    )


def printed_runs() -> pd.DataFrame:
    """Return the thesis's runs as a table, one a row.

    The columns are those of ``ema_study.result.as_frame``, as far as the thesis prints them, with
    ``model`` "printed", and ``note``. ``evaluations`` follow: populations of 50, that of the start
    included, which GWO alone counts as a generation.

    Notes
    -----
    The true backlash is 0.747 as printed; its errors follow from 0.7474 (docs/errata.md).
    """
    return _read().copy()
