"""What the runs found: the faulty component, and where GWO leaves the phase of eccentricity."""

from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ema_core.faults import FAULT_NAMES as COMPONENTS
from ema_study.cases import CASES, LEVELS, SINGLE_FAULTS
from ema_study.figures_style import (
    ALGORITHM_NAMES,
    FAULT_NAMES,
    STYLES,
    present_sources,
    tidy,
    with_family,
)
from ema_study.plan import ALGORITHMS
from ema_study.sources import of_source

_PHASE: Final = "k7"
_BINS: Final = 20


def draw_estimates(runs: pd.DataFrame) -> Figure:
    """Return the estimates of the faulty component of all single faults, a dot a run.

    Parameters
    ----------
    runs
        Runs of all sources.
    """
    chosen = with_family(runs)
    chosen = chosen[chosen.fault.isin(SINGLE_FAULTS)]
    sources = present_sources(chosen)
    figure = Figure(figsize=(9.0, 11.0), layout="constrained")
    panels = figure.subplots(len(SINGLE_FAULTS), 2, sharex=True, squeeze=False)
    for fault, row in zip(SINGLE_FAULTS, panels, strict=True):
        for level, axes in zip(LEVELS, row, strict=True):
            case = CASES[" ".join((*fault.split("_"), level))]
            [component] = case.faults
            name = f"k{COMPONENTS.index(component) + 1}"
            tidy(axes)
            axes.axhline(case.faults[component], color="0.1", lw=1.0)
            part = chosen[(chosen.fault == fault) & (chosen.level == level)]
            for n, source in enumerate(sources):
                mine, style = of_source(part, source), STYLES[source.label]
                # Dots beside each other; the order of the runs says nothing.
                spread = (mine.run - 1) % 10 / 9.0 - 0.5
                places = mine.family.map(list(ALGORITHMS).index).astype(float)
                places += (n - (len(sources) - 1) / 2.0) * 0.16 + 0.1 * spread
                axes.plot(places, mine[name], ls="", marker="o", ms=3.2, color=style.colour,
                          mfc="white" if style.hatch else style.colour, mew=0.8)  # fmt: skip
            axes.set_xlim(-0.5, len(ALGORITHMS) - 0.5)
            axes.set_xticks(range(len(ALGORITHMS)), [ALGORITHM_NAMES[name] for name in ALGORITHMS])
            axes.set_title(f"{FAULT_NAMES[fault]}, {level}", fontsize="medium")
        row[0].set_ylabel("estimated k")
    handles = [
        figure.axes[0].plot([], [], ls="", marker="o", color=style.colour, label=source.label,
                            mfc="white" if style.hatch else style.colour)[0]
        for source in sources
        for style in [STYLES[source.label]]
    ]  # fmt: skip
    handles += figure.axes[0].plot([], [], color="0.1", lw=1.0, label="truth")
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def draw_phases_of_gwo(runs: pd.DataFrame) -> Figure:
    """Return histograms of GWO's estimates of k7, those that are exactly 0 apart.

    Parameters
    ----------
    runs
        Runs of all sources.
    """
    chosen = with_family(runs)
    chosen = chosen[chosen.family == "gwo"]
    sources = present_sources(chosen)
    columns = 2 if len(sources) > 1 else 1
    rows = max(1, -(-len(sources) // columns))
    figure = Figure(figsize=(9.0, 0.6 + 2.3 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    edges = np.linspace(0.0, 1.0, _BINS + 1)
    for axes in panels[len(sources) :]:
        axes.set_axis_off()
    for axes, source in zip(panels, sources, strict=False):
        tidy(axes)
        values = of_source(chosen, source)[_PHASE].to_numpy()
        zeros = np.count_nonzero(values == 0.0)
        colour = STYLES[source.label].colour
        axes.hist(values[values != 0.0], edges, color=colour, edgecolor="white", lw=0.4)
        axes.bar(-0.04, zeros, 0.03, color="0.1")
        axes.set_title(f"{source.label}: {zeros} of {len(values)} exactly 0", fontsize="small")
        axes.set_xlabel("estimated k7", fontsize="small")
        axes.tick_params(labelbottom=True)
        axes.set_ylabel("runs")
    return figure
