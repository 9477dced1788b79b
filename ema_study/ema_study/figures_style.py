"""What all figures of the study have in common: names, colours, axes."""

from collections.abc import Iterable
from typing import Any, Final, NamedTuple

import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes

from ema_study.plan import VARIANTS
from ema_study.printed_runs import PRINTED
from ema_study.sources import ALGORITHM_NAMES as PLAIN_NAMES
from ema_study.sources import FAST_MODEL, THESIS_MODEL, with_own_code
from ema_study.stop_rules import family_of

ALGORITHM_NAMES: Final = PLAIN_NAMES | {
    variant: with_own_code(PLAIN_NAMES[name]) for name, variant in VARIANTS.items()
}
"""What the algorithms are called, the thesis's own code last."""

FAULT_NAMES: Final = {
    "friction": "friction",
    "backlash": "backlash",
    "short_circuit": "short circuit",
    "eccentricity": "eccentricity",
    "gain": "gain",
    "multiple": "multiple fault",
}

LEVEL_NAMES: Final = {
    "low": "low",
    "high": "high",
    "fast_stop": "study of speed",
    "stall_stop": "study of precision",
}

COLOURS: Final = {
    "ga": "#e69f00",
    "pso": "#0072b2",
    "de": "#009e73",
    "gwo": "#cc79a7",
    "de_thesis": "#005c43",
    "gwo_thesis": "#7d3c62",
}
"""Colours of algorithms, those of Okabe and Ito; darker for the thesis's own code."""

DASHES: Final = {
    "ga": "-",
    "pso": (0, (5, 1.5)),
    "de": (0, (3, 1, 1, 1)),
    "gwo": (0, (1, 1)),
    "de_thesis": (0, (6, 1, 1, 1, 1, 1)),
    "gwo_thesis": (0, (8, 2)),
}
"""Dashes of algorithms, to tell them apart in print."""


class Source(NamedTuple):
    """Where results come from: a model, and whether the thesis's own code searched."""

    model: str
    suffix: str
    label: str
    colour: str
    hatch: str


SOURCES: Final = (
    Source(PRINTED, "", "printed in the thesis", "#9a9a9a", ""),
    Source("thesis", "_thesis", with_own_code(THESIS_MODEL), "#d55e00", "////"),
    Source("thesis", "", THESIS_MODEL, "#d55e00", ""),
    Source("fast", "_thesis", with_own_code(FAST_MODEL), "#0072b2", "////"),
    Source("fast", "", FAST_MODEL, "#0072b2", ""),
)
"""Sources in the order in which their bars stand."""


def counted(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs that statistics are made of, with the ``family`` of their algorithm.

    Those are the thesis's tables 11 to 57 without the demonstrations of the printed stop rule.

    Parameters
    ----------
    runs
        Runs of any models; may be empty, even of columns.
    """
    needed = ("model", "table", "algorithm", "fault", "level")
    if runs.empty or not set(needed) <= set(runs.columns):
        return pd.DataFrame(columns=[*needed, "family"])
    chosen = runs.table.ge(11)
    if "rule" in runs:
        chosen &= runs.rule.ne("printed")
    kept = runs[chosen]
    return kept.assign(family=kept.algorithm.map(family_of))


def in_order(names: Iterable[Any], order: Iterable[str]) -> list[str]:
    """Return those names that occur, in a given order."""
    present = set(names)
    return [name for name in order if name in present]


def severity_colours(number: int) -> list[Any]:
    """Return colours from light to dark, told apart in grey, too."""
    ramp = colormaps["viridis_r"]
    return [ramp(0.15 + 0.8 * i / max(1, number - 1)) for i in range(number)]


def tidy(axes: Axes) -> None:
    """Leave left and bottom frame and a faint grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="0.5", alpha=0.2, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize="small")
