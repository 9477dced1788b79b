"""Mean error and time by algorithm and fault, ours beside the printed (figures 7.1 and 7.2)."""

from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ema_study.cases import LEVELS, MULTIPLE, SINGLE_FAULTS
from ema_study.figures.style import (
    FAULT_NAMES,
    LEVEL_NAMES,
    STYLES,
    legend_below,
    say_no_runs,
    tidy,
)
from ema_study.plan import ALGORITHMS
from ema_study.sources import (
    NAMES_WITH_OWN_CODE,
    counted,
    present_sources,
    single_fault_runs,
)

_WHISKERS: Final = {"fmt": "none", "ecolor": "0.15", "elinewidth": 0.8, "capsize": 1.5,
                    "capthick": 0.8}  # fmt: skip


class Quantity(NamedTuple):
    """A column of runs, the label of its axis, and the kind of that axis."""

    column: str
    label: str
    log: bool


ERROR: Final = Quantity("error_percent", "error [%]", False)
TIME: Final = Quantity("time_s", "time [s]", True)


def draw_single_faults(runs: pd.DataFrame, quantity: Quantity) -> Figure:
    """Return bars of the mean by fault, a row an algorithm and a column a level.

    Whiskers are a standard deviation up and down, where there are several runs; on a logarithmic
    axis they are not drawn below a tenth of the mean. ``quantity`` is ``ERROR`` or ``TIME``, the
    runs are those of all sources.
    """
    chosen = single_fault_runs(runs)
    figure = Figure(figsize=(9.0, 10.0), layout="constrained")
    panels = figure.subplots(len(ALGORITHMS), 2, sharex=True, sharey="row", squeeze=False)
    labels = {name: FAULT_NAMES[name].replace(" ", "\n") for name in SINGLE_FAULTS}
    for row, algorithm in zip(panels, ALGORITHMS, strict=True):
        for axes, level in zip(row, LEVELS, strict=True):
            part = chosen[(chosen.family == algorithm) & (chosen.level == level)]
            _draw(axes, part, "fault", labels, quantity)
            axes.set_title(f"{NAMES_WITH_OWN_CODE[algorithm]}, {level}", fontsize="medium")
        row[0].set_ylabel(quantity.label)
    _legend(figure, chosen)
    return figure


def draw_multiple_fault(runs: pd.DataFrame) -> Figure:
    """Return bars of mean error and time in the multiple fault by algorithm, a column a study."""
    chosen = counted(runs)
    chosen = chosen[chosen.fault == MULTIPLE]
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey="row", squeeze=False)
    labels = {name: NAMES_WITH_OWN_CODE[name] for name in ALGORITHMS}
    for row, quantity in zip(panels, (ERROR, TIME), strict=True):
        for axes, level in zip(row, ("fast_stop", "stall_stop"), strict=True):
            _draw(axes, chosen[chosen.level == level], "family", labels, quantity)
            axes.set_title(LEVEL_NAMES[level], fontsize="medium")
        row[0].set_ylabel(quantity.label)
    _legend(figure, chosen)
    return figure


def _draw(
    axes: Axes, runs: pd.DataFrame, group: str, labels: dict[str, str], quantity: Quantity
) -> None:
    """Draw the means of the groups in ``labels``; a panel shows its own sources only."""
    tidy(axes)
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.5, len(labels) - 0.5)
    axes.set_xticks(range(len(labels)), list(labels.values()))
    if quantity.log:
        axes.set_yscale("log")
    sources = present_sources(runs)
    if not sources:
        say_no_runs(axes)
        return
    width = 0.8 / len(sources)
    for n, source in enumerate(sources):
        values = runs[runs.source == source].groupby(group)[quantity.column].agg(["mean", "std"])
        values = values.reindex(list(labels))
        places = np.arange(len(labels)) + (n + 0.5) * width - 0.4
        axes.bar(places, values["mean"], 0.92 * width, edgecolor="white", lw=0.3, **STYLES[source])
        mean, std = values[values["std"].notna()].to_numpy().T
        down = np.minimum(std, 0.9 * mean if quantity.log else mean)
        axes.errorbar(places[values["std"].notna()], mean, [down, std], **_WHISKERS)


def _legend(figure: Figure, runs: pd.DataFrame) -> None:
    handles: list[object] = [
        Patch(
            facecolor=STYLES[source]["color"],
            hatch=STYLES[source]["hatch"],
            edgecolor="white",
            label=source,
        )
        for source in present_sources(runs)
    ]
    if not handles:
        return
    if runs.groupby(["model", "algorithm", "table"]).size().max() > 1:
        handles.append(
            figure.axes[0].errorbar([], [], [], label="one standard deviation", **_WHISKERS)
        )
    legend_below(figure, handles)
