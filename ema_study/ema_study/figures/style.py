"""Names, colours and axes that all figures of the study share."""

from collections.abc import Sequence
from typing import Any, Final

from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema_study.cases import LEVELS, MULTIPLE, SINGLE_FAULTS
from ema_study.printed import PRINTED
from ema_study.sources import SOURCES, with_own_code

FAULT_NAMES: Final = {name: name.replace("_", " ") for name in SINGLE_FAULTS} | {
    MULTIPLE: "multiple fault"
}

LEVEL_NAMES: Final = {level: level for level in LEVELS} | {
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
"""Dashes of algorithms, to distinguish them in print."""


_MODEL_COLOURS: Final = {PRINTED: "#9a9a9a", "thesis's model": "#d55e00", "fast model": "#0072b2"}

STYLES: Final[dict[str, dict[str, Any]]] = {
    label: {
        "color": _MODEL_COLOURS[label.removesuffix(with_own_code(""))],
        "hatch": "////" if label.endswith(with_own_code("")) else "",
    }
    for label in SOURCES
}
"""Colour and hatch by label of the source."""


def severity_colours(number: int) -> list[Any]:
    """Return colours from light to dark, distinct in grey, too."""
    ramp = colormaps["viridis_r"]
    return [ramp(0.15 + 0.8 * i / max(1, number - 1)) for i in range(number)]


def tidy(axes: Axes) -> None:
    """Leave left and bottom frame and a faint grid."""
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
