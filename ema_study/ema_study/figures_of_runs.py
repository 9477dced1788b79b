# SPDX-License-Identifier: Apache-2.0
"""Figures of runs: mean errors and times, convergence, and estimates."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from ema_study.cases import ALGORITHMS, KIND_NAMES, LEVEL_NAMES, LEVELS, MULTIPLE, SINGLE_FAULTS
from ema_study.printed import PRINTED
from ema_study.sources import (
    MODEL_LABELS,
    NAMES_WITH_OWN_CODE,
    SOURCES,
    counted,
    present_sources,
    single_fault_runs,
    with_own_code,
)

ALGORITHM_STYLES: Final[dict[str, dict[str, Any]]] = {
    "ga": {"color": "#e69f00", "ls": "-"},
    "pso": {"color": "#0072b2", "ls": (0, (5, 1.5))},
    "de": {"color": "#009e73", "ls": (0, (3, 1, 1, 1))},
    "gwo": {"color": "#cc79a7", "ls": (0, (1, 1))},
    "de_thesis": {"color": "#005c43", "ls": (0, (6, 1, 1, 1, 1, 1))},
    "gwo_thesis": {"color": "#7d3c62", "ls": (0, (8, 2))},
}
"""Colours of Okabe and Ito, darker for the thesis's own code; dashes distinguish them in print."""

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
"""Colour and hatch, keyed by the label of the source."""

_WHISKERS: Final[dict[str, Any]] = {"fmt": "none", "ecolor": "0.15", "lw": 0.8, "capsize": 1.5}
_RUN: Final[dict[str, Any]] = {"lw": 0.6, "alpha": 0.4}
_THRESHOLD: Final[dict[str, Any]] = {"color": "0.6", "lw": 0.8, "alpha": 0.7}
_GENERATIONS: Final = (0, 5, 10, 20, 50, 100, 200)


class PlottedColumn(NamedTuple):
    """A column of the runs to plot, and the label of its axis."""

    column: str
    label: str


ERROR: Final = PlottedColumn("error_percent", "error [%]")
TIME: Final = PlottedColumn("time_s", "time [s]")


def figures_of_runs(runs: pd.DataFrame) -> dict[str, Figure]:
    """Return all figures of runs, keyed by name."""
    models = set(counted(runs)["model"])
    return {
        "errors": draw_single_faults(runs, ERROR),
        "times": draw_single_faults(runs, TIME),
        "multiple_fault": draw_multiple_fault(runs),
        **{
            f"costs_{model}": draw_convergence(runs, model)
            for model in MODEL_LABELS
            if model in models
        },
    }


def draw_single_faults(runs: pd.DataFrame, quantity: PlottedColumn) -> Figure:
    """Return a figure of the mean of each fault as bars, with a row per algorithm.

    The two columns are the levels.

    Whiskers show one standard deviation if there are several runs. On the logarithmic axis of
    ``TIME`` they end at a tenth of the mean. ``runs`` has the runs of all sources.
    """
    chosen = single_fault_runs(runs)
    figure = Figure(figsize=(9.0, 10.0), layout="constrained")
    panels = figure.subplots(len(ALGORITHMS), 2, sharex=True, sharey="row", squeeze=False)
    labels = {name: KIND_NAMES[name].replace(" ", "\n") for name in SINGLE_FAULTS}
    for row, algorithm in zip(panels, ALGORITHMS, strict=True):
        for axes, level in zip(row, LEVELS, strict=True):
            part = chosen[(chosen.family == algorithm) & (chosen.level == level)]
            _draw_bars(axes, part, "fault", labels, quantity)
            axes.set_title(f"{NAMES_WITH_OWN_CODE[algorithm]}, {level}", fontsize="medium")
        row[0].set_ylabel(quantity.label)
    _legend_of_bars(figure, chosen)
    return figure


def draw_multiple_fault(runs: pd.DataFrame) -> Figure:
    """Return a figure of mean error and time for the multiple fault, with one column per study."""
    chosen = counted(runs)
    chosen = chosen[chosen.fault == MULTIPLE]
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey="row", squeeze=False)
    labels = {name: NAMES_WITH_OWN_CODE[name] for name in ALGORITHMS}
    for row, quantity in zip(panels, (ERROR, TIME), strict=True):
        for axes, level in zip(row, ("fast_stop", "stall_stop"), strict=True):
            _draw_bars(axes, chosen[chosen.level == level], "family", labels, quantity)
            axes.set_title(LEVEL_NAMES[level], fontsize="medium")
        row[0].set_ylabel(quantity.label)
    _legend_of_bars(figure, chosen)
    return figure


def _draw_bars(
    axes: Axes, runs: pd.DataFrame, group: str, labels: dict[str, str], quantity: PlottedColumn
) -> None:
    """Draw the means of the groups in ``labels``; sources without runs in the panel are omitted."""
    tidy(axes)
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.5, len(labels) - 0.5)
    axes.set_xticks(range(len(labels)), list(labels.values()))
    if quantity is TIME:
        axes.set_yscale("log")
    sources = present_sources(runs)
    if not sources:
        note_no_runs(axes)
    for n, source in enumerate(sources):
        width = 0.8 / len(sources)
        values = runs[runs.source == source].groupby(group)[quantity.column].agg(["mean", "std"])
        values = values.reindex(list(labels))
        places = np.arange(len(labels)) + (n + 0.5) * width - 0.4
        axes.bar(places, values["mean"], 0.92 * width, edgecolor="white", lw=0.3, **STYLES[source])
        mean, std = values[values["std"].notna()].to_numpy().T
        down = np.minimum(std, 0.9 * mean if quantity is TIME else mean)
        axes.errorbar(places[values["std"].notna()], mean, [down, std], **_WHISKERS)


def _legend_of_bars(figure: Figure, runs: pd.DataFrame) -> None:
    sources = present_sources(runs)
    patches = [
        Patch(fc=STYLES[source]["color"], hatch=STYLES[source]["hatch"], ec="white", label=source)
        for source in sources
    ]
    if sources:
        whisker = figure.axes[0].errorbar([], [], [], label="one standard deviation", **_WHISKERS)
        legend_below(figure, [*patches, whisker])


def draw_convergence(runs: pd.DataFrame, model: str) -> Figure:
    """Return a figure of the lowest cost over the generations: runs as thin lines, and medians.

    Only the runs of ``model`` are drawn. There is one median per algorithm; stopped runs keep their
    last value. A band extends from the cost at the true faults to the threshold.
    """
    chosen = counted(runs)
    chosen = chosen[chosen.model == model]
    faults = (*SINGLE_FAULTS, MULTIPLE)
    figure = Figure(figsize=(9.0, 1.0 + 2.3 * len(faults)), layout="constrained")
    panels = figure.subplots(len(faults), 2, sharex=True, squeeze=False)
    for fault, row in zip(faults, panels, strict=True):
        levels = ("fast_stop", "stall_stop") if fault == MULTIPLE else LEVELS
        for axes, level in zip(row, levels, strict=True):
            _draw_courses(axes, chosen[(chosen.fault == fault) & (chosen.level == level)])
            axes.set_title(f"{KIND_NAMES[fault]}, {LEVEL_NAMES[level]}", fontsize="medium")
        row[0].set_ylabel("lowest cost [A$^2$ s]", fontsize="small")
    for axes in panels[-1]:
        axes.set_xlabel("generation")
    handles: list[object] = [
        Line2D([], [], lw=1.8, label=label, **ALGORITHM_STYLES[name])
        for name, label in NAMES_WITH_OWN_CODE.items()
        if name in set(chosen.algorithm)
    ]
    handles.append(Line2D([], [], color="0.3", label="single runs", **_RUN))
    handles.append(Patch(label="cost of the true faults to threshold", **_THRESHOLD))
    legend_below(figure, handles, columns=4, handlelength=3.5)
    return figure


def median_course(courses: list[list[float]]) -> NDArray[np.float64]:
    """Return the median cost over runs after each generation, ``(n,)``.

    ``courses`` has the lowest costs of each run; stopped runs keep their last value.
    """
    return pd.concat(map(pd.Series, courses), axis=1).ffill().median(axis=1).to_numpy()


def _draw_courses(axes: Axes, runs: pd.DataFrame) -> None:
    tidy(axes)
    axes.set_yscale("log")
    # Most of the decrease happens within 20 generations: linear up to 20, logarithmic above.
    axes.set_xscale("symlog", linthresh=20)
    axes.set_xticks(_GENERATIONS, [str(number) for number in _GENERATIONS])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlim(0, _GENERATIONS[-1])
    if runs.empty:
        note_no_runs(axes)
        return
    for algorithm, style in ALGORITHM_STYLES.items():
        rows = runs.loc[runs.algorithm == algorithm, "costs"].tolist()
        for row in rows if len(rows) > 1 else ():
            axes.plot(row, color=style["color"], **_RUN)
        if rows:
            axes.plot(median_course(rows), lw=1.8, zorder=3, **style)
    at_truth, threshold = runs.cost_at_truth.median(), runs.threshold.astype(float).median()
    axes.axhspan(at_truth, at_truth if np.isnan(threshold) else threshold, **_THRESHOLD)


def tidy(*panels: Axes) -> None:
    """Remove the top and right spines of panels, and add a faint grid."""
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="0.5", alpha=0.2, lw=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize="small")


def legend_below(
    figure: Figure, handles: Sequence[Any], columns: int = 3, **options: float
) -> None:
    """Draw a common legend below all panels."""
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, frameon=False, **options
    )


def note_no_runs(axes: Axes) -> None:
    """Write "no runs" into a panel."""
    axes.text(0.5, 0.5, "no runs", transform=axes.transAxes, ha="center", color="0.4")
