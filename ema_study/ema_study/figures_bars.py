"""Mean error and time by algorithm and fault, ours beside the printed (figures 7.1 and 7.2)."""

from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ema_study.cases import LEVELS, MULTIPLE, SINGLE_FAULTS
from ema_study.figures_style import (
    ALGORITHM_NAMES,
    FAULT_NAMES,
    LEVEL_NAMES,
    STYLES,
    in_order,
    present_sources,
    tidy,
    with_family,
)
from ema_study.plan import ALGORITHMS
from ema_study.sources import Source, of_source

_MULTIPLE_LEVELS: Final = ("fast_stop", "stall_stop")


class Quantity(NamedTuple):
    """A column of runs, what its axis says, and the kind of that axis."""

    column: str
    label: str
    log: bool


ERROR: Final = Quantity("error_percent", "error [%]", False)
TIME: Final = Quantity("time_s", "time [s]", True)


def draw_single_faults(runs: pd.DataFrame, quantity: Quantity) -> Figure:
    """Return bars of the mean by fault, a row an algorithm and a column a level.

    Whiskers are a standard deviation up and down, where there are several runs; on a logarithmic
    axis they are not drawn below a tenth of the mean.

    Parameters
    ----------
    runs
        Runs of all sources, the printed ones with ``model`` "printed".
    quantity
        ``ERROR`` or ``TIME``.
    """
    chosen = with_family(runs)
    chosen = chosen[chosen.fault.isin(SINGLE_FAULTS)]
    sources = present_sources(chosen)
    figure = Figure(figsize=(9.0, 10.0), layout="constrained")
    panels = figure.subplots(len(ALGORITHMS), 2, sharex=True, sharey="row", squeeze=False)
    for row, algorithm in zip(panels, ALGORITHMS, strict=True):
        for axes, level in zip(row, LEVELS, strict=True):
            part = chosen[(chosen.family == algorithm) & (chosen.level == level)]
            _draw(axes, part, "fault", SINGLE_FAULTS, sources, quantity)
            axes.set_xticks(
                range(len(SINGLE_FAULTS)),
                [FAULT_NAMES[name].replace(" ", "\n") for name in SINGLE_FAULTS],
            )
            axes.set_title(f"{ALGORITHM_NAMES[algorithm]}, {level}", fontsize="medium")
        row[0].set_ylabel(quantity.label)
    _legend(figure, sources)
    return figure


def draw_multiple_fault(runs: pd.DataFrame) -> Figure:
    """Return bars of mean error and time in the multiple fault by algorithm, a column a study.

    Parameters
    ----------
    runs
        As for `draw_single_faults`.
    """
    chosen = with_family(runs)
    chosen = chosen[chosen.fault == MULTIPLE]
    sources = present_sources(chosen)
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey="row", squeeze=False)
    for row, quantity in zip(panels, (ERROR, TIME), strict=True):
        for axes, level in zip(row, _MULTIPLE_LEVELS, strict=True):
            part = chosen[chosen.level == level]
            _draw(axes, part, "family", ALGORITHMS, sources, quantity)
            axes.set_xticks(range(len(ALGORITHMS)), [ALGORITHM_NAMES[name] for name in ALGORITHMS])
            axes.set_title(LEVEL_NAMES[level], fontsize="medium")
        row[0].set_ylabel(quantity.label)
    _legend(figure, sources)
    return figure


def _draw(
    axes: Axes,
    runs: pd.DataFrame,
    group: str,
    order: tuple[str, ...],
    sources: list[Source],
    quantity: Quantity,
) -> None:
    tidy(axes)
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.5, len(order) - 0.5)
    if quantity.log:
        axes.set_yscale("log")
    # Only what this panel has takes room.
    shown = [one for one in sources if len(of_source(runs, one))]
    if not shown:
        axes.text(0.5, 0.5, "no runs", transform=axes.transAxes, ha="center", color="0.4")
        return
    width = 0.8 / len(shown)
    for n, source in enumerate(shown):
        style = STYLES[source.label]
        part = of_source(runs, source)
        grouped = part.groupby(group, observed=True)[quantity.column].agg(["mean", "std"])
        names = in_order(grouped.index, order)
        places = np.array([order.index(name) for name in names]) + (n + 0.5) * width - 0.4
        mean = grouped["mean"].loc[names].to_numpy()
        std = grouped["std"].loc[names].to_numpy()
        axes.bar(places, mean, 0.92 * width, color=style.colour, hatch=style.hatch,
                 edgecolor="white", lw=0.3)  # fmt: skip
        down = np.minimum(std, 0.9 * mean if quantity.log else mean)
        several = np.isfinite(std)  # a single run has no deviation
        axes.errorbar(places[several], mean[several], np.array([down, std])[:, several],
                      fmt="none", ecolor="0.15", elinewidth=0.8, capsize=1.5,
                      capthick=0.8)  # fmt: skip


def _legend(figure: Figure, sources: list[Source]) -> None:
    handles = [
        Patch(
            facecolor=STYLES[one.label].colour,
            hatch=STYLES[one.label].hatch,
            edgecolor="white",
            label=one.label,
        )
        for one in sources
    ]
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
