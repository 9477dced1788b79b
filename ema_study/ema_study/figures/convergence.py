"""How cost and error fall over the generations, by algorithm and fault."""

from itertools import zip_longest
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from ema_study.cases import LEVELS, MULTIPLE, SINGLE_FAULTS
from ema_study.figures.style import (
    COLOURS,
    DASHES,
    FAULT_NAMES,
    LEVEL_NAMES,
    legend_below,
    say_no_runs,
    tidy,
)
from ema_study.sources import NAMES_WITH_OWN_CODE, counted

_RUN: Final[dict[str, Any]] = {"lw": 0.6, "alpha": 0.4}
_THRESHOLD: Final = {"color": "0.6", "lw": 0.8, "alpha": 0.7}
_GENERATIONS: Final = (0, 5, 10, 20, 50, 100, 200)
_LINEAR_GENERATIONS: Final = 20
"""Most of the fall is over by then: the axis is linear up to here and logarithmic beyond."""


class PlottedColumn(NamedTuple):
    """A column with a value a generation, and the label of its axis."""

    column: str
    label: str


COSTS: Final = PlottedColumn("costs", "lowest cost [A$^2$ s]")
ERRORS: Final = PlottedColumn("errors_percent", "error of the best [%]")


def draw_convergence(runs: pd.DataFrame, model: str, course: PlottedColumn) -> Figure:
    """Return the courses of all runs with a model, thin, and their median by algorithm.

    A run that has stopped keeps its last value. Of ``course``, ``COSTS`` has a band from the cost
    at the truth to the threshold, ``ERRORS`` has none.
    """
    chosen = counted(runs)
    chosen = chosen[chosen.model == model]
    faults = [fault for fault in (*SINGLE_FAULTS, MULTIPLE) if fault in set(chosen.fault)]
    figure = Figure(figsize=(9.0, 1.0 + 2.3 * max(1, len(faults))), layout="constrained")
    panels = figure.subplots(max(1, len(faults)), 2, sharex=True, squeeze=False)
    for fault, row in zip_longest(faults, panels):
        levels = ("fast_stop", "stall_stop") if fault == MULTIPLE else LEVELS
        for axes, level in zip(row, levels, strict=True):
            _draw(axes, chosen[(chosen.fault == fault) & (chosen.level == level)], course)
            if fault:
                axes.set_title(f"{FAULT_NAMES[fault]}, {LEVEL_NAMES[level]}", fontsize="medium")
        row[0].set_ylabel(course.label, fontsize="small")
    for axes in panels[-1]:
        axes.set_xlabel("generation")
    if faults:
        _legend(figure, chosen, course)
    return figure


def median_course(courses: list[list[float]]) -> NDArray[np.float64]:
    """Return the median over runs after each generation; stopped runs keep their last value."""
    longest = max(len(course) for course in courses)
    rows = [np.pad(course, (0, longest - len(course)), mode="edge") for course in courses]
    return np.median(rows, axis=0)


def _draw(axes: Axes, runs: pd.DataFrame, course: PlottedColumn) -> None:
    tidy(axes)
    axes.set_yscale("log")
    axes.set_xscale("symlog", linthresh=_LINEAR_GENERATIONS)
    axes.set_xticks(_GENERATIONS, [str(number) for number in _GENERATIONS])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlim(0, _GENERATIONS[-1])
    if runs.empty:
        say_no_runs(axes)
        return
    for algorithm, colour in COLOURS.items():
        rows = runs.loc[runs.algorithm == algorithm, course.column].tolist()
        if len(rows) > 1:
            for row in rows:
                axes.plot(row, color=colour, **_RUN)
        if rows:
            axes.plot(median_course(rows), color=colour, lw=1.8, ls=DASHES[algorithm], zorder=3)
    if course is COSTS:
        at_truth, threshold = runs.cost_at_truth.median(), runs.threshold.astype(float).median()
        axes.axhspan(at_truth, at_truth if np.isnan(threshold) else threshold, **_THRESHOLD)


def _legend(figure: Figure, runs: pd.DataFrame, course: PlottedColumn) -> None:
    handles: list[object] = [
        Line2D([], [], color=COLOURS[name], ls=DASHES[name], lw=1.8, label=label)
        for name, label in NAMES_WITH_OWN_CODE.items()
        if name in set(runs.algorithm)
    ]
    if runs.groupby(["algorithm", "table"]).size().max() > 1:
        handles.append(Line2D([], [], color="0.3", label="single runs", **_RUN))
    if course is COSTS:
        handles.append(Patch(label="cost of the true faults to threshold", **_THRESHOLD))
    legend_below(figure, handles, columns=4, handlelength=3.5)
