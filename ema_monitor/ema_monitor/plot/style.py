# SPDX-License-Identifier: Apache-2.0
"""Colours, markers and panels shared by all figures."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ema_core.levels import ERROR, STALE, WARN
from ema_monitor.health import ONE_SIDED_95

BLUE: Final = "#0072b2"
ORANGE: Final = "#e69f00"
VERMILION: Final = "#d55e00"
GREEN: Final = "#009e73"
PURPLE: Final = "#cc79a7"
SKY: Final = "#56b4e9"
BROWN: Final = "#8c510a"
GREY: Final = "#7f7f7f"
"""Colours of the palette of Okabe and Ito, which the colour-blind can distinguish, plus brown and
grey. Lines also differ in style, marker or place."""

INK: Final = "#1a1a1a"
"""Colour of true values and of text."""

LEVEL_COLOURS: Final[Mapping[int, str]] = MappingProxyType(
    {WARN: ORANGE, ERROR: VERMILION, STALE: GREY}
)
"""Colour of each level of health except OK, which is not marked."""

TRUTH: Final[Mapping[str, Any]] = MappingProxyType(
    {"color": INK, "lw": 1.5, "ls": (0, (6, 2)), "label": "truth"}
)
LIMIT: Final[Mapping[str, Any]] = MappingProxyType(
    {"color": VERMILION, "lw": 1.2, "ls": (0, (4, 3)), "label": "limit"}
)
ESTIMATES: Final[Mapping[str, Any]] = MappingProxyType(
    {"fmt": "o", "ms": 3.5, "elinewidth": 1.0, "zorder": 3, "label": "estimate, 90 % interval"}
)
"""Plot styles shared by several figures."""


def stacked_panels(heights: list[float], height_scale: float) -> tuple[Figure, list[Axes]]:
    """Return a figure and its panels, stacked with a common horizontal axis.

    Parameters
    ----------
    heights
        Relative heights of the panels.
    height_scale
        Figure height per unit of ``heights`` [inch].
    """
    figure = Figure(figsize=(10.5, 1.2 + height_scale * sum(heights)), layout="constrained")
    grid = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)
    panels = list(grid[:, 0])
    for axes in panels:
        tidy(axes)
    return figure, panels


def draw_legend(
    figure: Figure, panels: list[Axes], bands: Mapping[str, tuple[str, str]] = MappingProxyType({})
) -> None:
    """Draw a figure's legend: each label of the lines in its panels once.

    Parameters
    ----------
    figure, panels
        The figure, and its panels.
    bands
        For the label of a line: the label of the band around it, and a common label for both.
    """
    handles: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    for line, (band, both) in bands.items():
        if line in handles and band in handles:
            handles[both] = (handles.pop(band), handles.pop(line))
    location: Any = "outside upper center"
    figure.legend(list(handles.values()), list(handles), loc=location, ncols=4, frameon=False)


def tidy(axes: Axes, direction: Any = "both") -> None:
    """Draw a faint grid, and only the left and bottom spines."""
    axes.grid(axis=direction, color="0.5", alpha=0.2)
    axes.spines[["top", "right"]].set_visible(False)


def draw_estimates(
    axes: Axes, place: ArrayLike, value: ArrayLike, sigma: ArrayLike, **style: Any
) -> ErrorbarContainer:
    """Draw estimates with error bars of their 90 % intervals, and return the drawn container.

    The intervals lie between the one-sided 95 % bounds. ``style`` is passed to ``Axes.errorbar``.

    Parameters
    ----------
    axes
        The panel.
    place
        Abscissae of the estimates.
    value, sigma
        Estimates and their standard deviations; NaN draws no interval.
    """
    return axes.errorbar(place, value, ONE_SIDED_95 * np.nan_to_num(sigma), **style)
