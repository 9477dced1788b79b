"""Figures and marks that the pictures of the commands have in common."""

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
    heights
        Heights of the panels, in proportion.
    height_scale
        Height of the figure for each unit of these [inch].
    """
    figure = Figure(figsize=(10.5, 1.2 + height_scale * sum(heights)), layout="constrained")
    grid = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)
    panels = list(grid[:, 0])
    for axes in panels:
        tidy(axes)
    return figure, panels


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
    axes
        Panel to draw in.
    place
        Abscissae, ``(n,)`` or a single one.
    value, sigma
        Estimates and their standard deviations; where sigma is NaN, there is no interval.
    style
        Further arguments of ``Axes.errorbar``.
    """
    axes.errorbar(place, value, ONE_SIDED_95 * np.nan_to_num(sigma), **style)
