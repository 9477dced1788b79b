"""Figures and marks that the pictures of the commands have in common."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ema_monitor.health import ONE_SIDED_95

BLUE: Final = "#0072b2"
ORANGE: Final = "#e69f00"
VERMILION: Final = "#d55e00"
"""Of the palette of Okabe and Ito, which is distinct for the colour-blind."""


def stacked_panels(heights: list[float], height_scale: float) -> tuple[Figure, list[Axes]]:
    """Return a figure and its panels, one below the other with a common abscissa.

    Parameters
    ----------
    height_scale
        Height of the figure for each unit of these [inch].
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
    """Draw a legend of what is labelled in panels, each label once.

    Parameters
    ----------
    bands
        By the label of a line: that of the band around it, and that of the two together.
    """
    marks: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            marks.setdefault(label, handle)
    for line, (band, both) in bands.items():
        if line in marks and band in marks:
            marks[both] = (marks.pop(band), marks.pop(line))
    place: Any = "outside upper center"
    figure.legend(list(marks.values()), list(marks), loc=place, ncols=4, frameon=False)


def tidy(axes: Axes, direction: Any = "both") -> None:
    """Draw a faint grid, and the frame on the left and at the bottom only."""
    axes.grid(axis=direction, color="0.5", alpha=0.2)
    axes.spines[["top", "right"]].set_visible(False)


def draw_estimates(
    axes: Axes, place: ArrayLike, value: ArrayLike, sigma: ArrayLike, **style: Any
) -> None:
    """Draw estimates with their 90 % intervals, which end at the one-sided 95 % bounds.

    Parameters
    ----------
    value, sigma
        Estimates and their standard deviations; where sigma is NaN, there is no interval.
    """
    axes.errorbar(place, value, ONE_SIDED_95 * np.nan_to_num(sigma), **style)
