"""How cost and error fall over the generations, by algorithm and fault."""

from itertools import zip_longest
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from ema_study.cases import LEVELS, MULTIPLE, SINGLE_FAULTS
from ema_study.figures_style import (
    ALGORITHM_NAMES,
    COLOURS,
    DASHES,
    FAULT_NAMES,
    LEVEL_NAMES,
    in_order,
    tidy,
)
from ema_study.sources import counted

_AT_TRUTH: Final = {"color": "0.1", "lw": 1.0, "ls": "-"}
_THRESHOLD: Final = {"color": "0.1", "lw": 1.0, "ls": ":"}
_GENERATIONS: Final = (0, 5, 10, 20, 50, 100, 200)
_LINEAR_GENERATIONS: Final = 20
"""Most is done by then: the axis is linear up to here and logarithmic beyond."""


class Course(NamedTuple):
    """A column with a value a generation, and what its axis says."""

    column: str
    label: str


COSTS: Final = Course("costs", "lowest cost [A$^2$ s]")
ERRORS: Final = Course("errors_percent", "error of the best [%]")


def draw_convergence(runs: pd.DataFrame, model: str, course: Course) -> Figure:
    """Return the courses of all runs with a model, thin, and their median by algorithm.

    A run that has stopped keeps its last value.

    Parameters
    ----------
    runs
        Our runs.
    model
        Name of the model.
    course
        ``COSTS``, with the cost at the truth and the threshold, or ``ERRORS``.
    """
    chosen = counted(runs)
    chosen = chosen[chosen.model == model]
    faults = in_order(chosen.fault, (*SINGLE_FAULTS, MULTIPLE))
    figure = Figure(figsize=(9.0, 1.0 + 2.3 * max(1, len(faults))), layout="constrained")
    panels = figure.subplots(max(1, len(faults)), 2, sharex=True, squeeze=False)
    for fault, row in zip_longest(faults, panels):
        levels = ("fast_stop", "stall_stop") if fault == MULTIPLE else LEVELS
        for axes, level in zip(row, levels, strict=True):
            part = chosen[(chosen.fault == fault) & (chosen.level == level)]
            _draw(axes, part, course)
            if fault:
                axes.set_title(f"{FAULT_NAMES[fault]}, {LEVEL_NAMES[level]}", fontsize="medium")
        row[0].set_ylabel(course.label, fontsize="small")
    for axes in panels[-1]:
        axes.set_xlabel("generation")
    _legend(figure, chosen, course)
    return figure


def median_course(courses: list[list[float]]) -> NDArray[np.float64]:
    """Return the median over runs after each generation; stopped runs keep their last value.

    Parameters
    ----------
    courses
        Values of each run, from the start on; at least one run, none of them empty.
    """
    longest = max(len(course) for course in courses)
    rows = [np.pad(course, (0, longest - len(course)), mode="edge") for course in courses]
    return np.median(rows, axis=0)


def _draw(axes: Axes, runs: pd.DataFrame, course: Course) -> None:
    tidy(axes)
    axes.set_yscale("log")
    axes.set_xscale("symlog", linthresh=_LINEAR_GENERATIONS)
    axes.set_xticks(_GENERATIONS, [str(number) for number in _GENERATIONS])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlim(0, _GENERATIONS[-1])
    courses = {
        algorithm: [values for values in
                    runs.loc[runs.algorithm == algorithm, course.column] if len(values)]
        for algorithm in in_order(runs.algorithm, ALGORITHM_NAMES)
    }  # fmt: skip
    courses = {algorithm: rows for algorithm, rows in courses.items() if rows}
    if not courses:
        axes.text(0.5, 0.5, "no runs", transform=axes.transAxes, ha="center", color="0.4")
        return
    for algorithm, rows in courses.items():
        for row in rows:
            axes.plot(row, color=COLOURS[algorithm], lw=0.6, alpha=0.4)
    for algorithm, rows in courses.items():
        axes.plot(
            median_course(rows), color=COLOURS[algorithm], lw=1.8, ls=DASHES[algorithm], zorder=3
        )
    if course is COSTS:
        axes.axhline(runs.cost_at_truth.median(), **_AT_TRUTH)
        if runs.threshold.notna().any():
            axes.axhline(runs.threshold.median(), **_THRESHOLD)


def _legend(figure: Figure, runs: pd.DataFrame, course: Course) -> None:
    handles = [
        Line2D([], [], color=COLOURS[name], ls=DASHES[name], lw=1.8, label=ALGORITHM_NAMES[name])
        for name in in_order(runs.algorithm, ALGORITHM_NAMES)
    ]
    if course is COSTS and handles:
        handles.append(Line2D([], [], label="cost of the true faults", **_AT_TRUTH))
        if runs.threshold.notna().any():
            handles.append(Line2D([], [], label="threshold of the stop rule", **_THRESHOLD))
    if handles:
        figure.legend(
            handles=handles, loc="outside lower center", ncols=4, frameon=False, handlelength=3.5
        )
