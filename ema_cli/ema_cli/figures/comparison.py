"""Picture of a comparison of algorithms: how they converged."""

from itertools import cycle
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ema_cli.comparison import AlgorithmComparison, ComparedRun
from ema_monitor.plot.style import BLUE, BROWN, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION

_LEAST_RATIO: Final = 10.0
_TRUTH: Final[dict[str, Any]] = {"color": INK, "lw": 1.4}
_CONCLUSION: Final[dict[str, Any]] = {"color": "0.3", "lw": 1.0, "ls": (0, (4, 2))}
# Markers distinguish them without colour.
_STYLES: Final = (
    (BLUE, "o"),
    (VERMILION, "s"),
    (GREEN, "^"),
    (PURPLE, "D"),
    (ORANGE, "v"),
    (SKY, "P"),
    (BROWN, "X"),
    (GREY, "*"),
)


def draw_comparison(comparison: AlgorithmComparison, title: str) -> Figure:
    """Return a figure of cost against evaluations by algorithm; the table has the faults."""
    figure = Figure(figsize=(10.5, 5.0), layout="constrained")
    runs: dict[ComparedRun, dict[str, Any]] = {
        run: {"color": colour, "marker": marker, "ms": 6.0}
        | ({} if run.estimate.valid else {"mfc": "white"})
        for run, (colour, marker) in zip(comparison.runs, cycle(_STYLES), strict=False)
        if np.isfinite(run.estimate.fitness)
    }
    convergence = figure.add_subplot()
    _draw_convergence(convergence, comparison, runs)
    convergence.legend(handles=_marks(comparison, runs), loc="upper right", fontsize="small")
    figure.suptitle(title, ha="left", x=0.01)
    algorithms = [
        Line2D([], [], lw=1.3, label=run.estimate.algorithm, **style) for run, style in runs.items()
    ]
    figure.legend(handles=algorithms, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _draw_convergence(
    axes: Axes, comparison: AlgorithmComparison, runs: dict[ComparedRun, dict[str, Any]]
) -> None:
    for run, style in runs.items():
        costs = np.where(np.isfinite(run.costs), run.costs, np.nan)
        axes.plot(run.evaluations, costs, color=style["color"], lw=1.3)
        axes.plot(
            [run.evaluations[-1], run.estimate.evaluations],
            [costs[-1], run.estimate.fitness],
            **_CONCLUSION | {"color": style["color"]},
        )
        axes.plot(run.estimate.evaluations, run.estimate.fitness, ls="", zorder=3, **style)
    if comparison.fitness_at_truth is not None:
        axes.axhline(comparison.fitness_at_truth, **_TRUTH)
    axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    margin = max(1.0, np.sqrt(_LEAST_RATIO * low / high))
    axes.set_ylim(low / margin, high * margin)
    axes.set_xlabel("evaluations of the model")
    axes.set_ylabel("best fitness [A$^2$ s]")
    axes.grid(which="both", color="0.5", alpha=0.15)
    axes.spines[["top", "right"]].set_visible(False)


def _marks(
    comparison: AlgorithmComparison, runs: dict[ComparedRun, dict[str, Any]]
) -> list[Line2D]:
    """Return the marks that are the same for all algorithms."""
    handles = [Line2D([], [], label="end of search to estimate", **_CONCLUSION)]
    if comparison.truth is not None:
        handles.append(Line2D([], [], label="truth", **_TRUTH))
    if not all(run.estimate.valid for run in runs):
        handles.append(
            Line2D([], [], color="0.3", marker="o", mfc="white", ls="", label="hollow: not valid")
        )
    return handles
