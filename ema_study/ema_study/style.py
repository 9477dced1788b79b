"""Names, colours and axes that all figures of the study share."""

from collections.abc import Sequence
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema_study.cases import LEVELS, MULTIPLE, SINGLE_FAULTS
from ema_study.printed import PRINTED
from ema_study.sources import MODEL_LABELS, SOURCES, with_own_code

FAULT_NAMES: Final = {name: name.replace("_", " ") for name in SINGLE_FAULTS} | {
    MULTIPLE: "multiple fault"
}
LEVEL_NAMES: Final = {level: level for level in LEVELS} | {
    "fast_stop": "study of speed",
    "stall_stop": "study of precision",
}

ALGORITHM_STYLES: Final[dict[str, dict[str, Any]]] = {
    "ga": {"color": "#e69f00", "ls": "-"},
    "pso": {"color": "#0072b2", "ls": (0, (5, 1.5))},
    "de": {"color": "#009e73", "ls": (0, (3, 1, 1, 1))},
    "gwo": {"color": "#cc79a7", "ls": (0, (1, 1))},
    "de_thesis": {"color": "#005c43", "ls": (0, (6, 1, 1, 1, 1, 1))},
    "gwo_thesis": {"color": "#7d3c62", "ls": (0, (8, 2))},
}
"""Colours of algorithms, those of Okabe and Ito, darker for the thesis's own code; dashes to
distinguish them in print."""

_MODEL_COLOURS: Final = {
    PRINTED: "#9a9a9a",
    MODEL_LABELS["thesis"]: "#d55e00",
    MODEL_LABELS["fast"]: "#0072b2",
}
STYLES: Final[dict[str, dict[str, Any]]] = {
    label: {
        "color": _MODEL_COLOURS[label.removesuffix(with_own_code(""))],
        "hatch": "////" if label.endswith(with_own_code("")) else "",
    }
    for label in SOURCES
}
"""Colour and hatch by label of the source."""


def tidy(*panels: Axes) -> None:
    """Leave left and bottom frame and a faint grid."""
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="0.5", alpha=0.2, lw=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize="small")


def legend_below(
    figure: Figure, handles: Sequence[Any], columns: int = 3, **options: float
) -> None:
    """Draw one legend for all panels."""
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, frameon=False, **options
    )


def say_no_runs(axes: Axes) -> None:
    """Write into a panel that it has no runs."""
    axes.text(0.5, 0.5, "no runs", transform=axes.transAxes, ha="center", color="0.4")
