"""Estimates of the faulty component, and of the phase of eccentricity by GWO."""

from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ema_study.cases import CASES, SINGLE_FAULTS
from ema_study.figures.style import FAULT_NAMES, STYLES, legend_below, tidy
from ema_study.plan import ALGORITHMS
from ema_study.run import K
from ema_study.sources import (
    NAMES_WITH_OWN_CODE,
    counted,
    present_sources,
    single_fault_runs,
)

_BINS: Final = 20


def draw_estimates(runs: pd.DataFrame) -> Figure:
    """Return the estimates of the faulty component of all single faults, a dot a run."""
    chosen = single_fault_runs(runs)
    sources = present_sources(chosen)
    figure = Figure(figsize=(9.0, 11.0), layout="constrained")
    panels = figure.subplots(len(SINGLE_FAULTS), 2, sharex=True, squeeze=False)
    single = [case for case in CASES.values() if case.fault in SINGLE_FAULTS]
    for case, axes in zip(single, panels.ravel(), strict=True):
        assert case.component is not None
        part = chosen[(chosen.fault == case.fault) & (chosen.level == case.level)]
        tidy(axes)
        axes.axhline(case.truth[case.component], color="0.1", lw=1.0, label="truth")
        for n, source in enumerate(sources):
            ours, style = part[part.source == source], STYLES[source]
            # Dots beside each other; the order of the runs has no meaning.
            spread = (ours.run - 1) % 10 / 9.0 - 0.5
            places = ours.family.map(list(ALGORITHMS).index).astype(float)
            places += (n - (len(sources) - 1) / 2.0) * 0.16 + 0.1 * spread
            axes.plot(places, ours[K[case.component]], ls="", marker="o", ms=3.2, mew=0.8,
                      color=style["color"], mfc="white" if style["hatch"] else style["color"],
                      label=source)  # fmt: skip
        axes.set_xlim(-0.5, len(ALGORITHMS) - 0.5)
        axes.set_xticks(range(len(ALGORITHMS)), [NAMES_WITH_OWN_CODE[name] for name in ALGORITHMS])
        axes.set_title(f"{FAULT_NAMES[case.fault]}, {case.level}", fontsize="medium")
        axes.set_ylabel(f"estimated {K[case.component]}")
    legend_below(figure, figure.axes[0].get_legend_handles_labels()[0])
    return figure


def draw_phases_of_gwo(runs: pd.DataFrame) -> Figure:
    """Return histograms of GWO's estimates of k7, with a bar of its own for exact zeros."""
    chosen = counted(runs)
    chosen = chosen[chosen.family == "gwo"]
    sources = present_sources(chosen)
    columns = 2 if len(sources) > 1 else 1
    rows = max(1, -(-len(sources) // columns))
    figure = Figure(figsize=(9.0, 0.9 + 2.3 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    edges = np.linspace(0.0, 1.0, _BINS + 1)
    for axes in panels[len(sources) :]:
        axes.set_axis_off()
    handles: list[object] = []
    for axes, source in zip(panels, sources, strict=False):
        tidy(axes)
        values = chosen.loc[chosen.source == source, "k7"].to_numpy()
        zeros = np.count_nonzero(values == 0.0)
        _, _, bars = axes.hist(
            values[values != 0.0], edges, edgecolor="white", lw=0.4, label=source, **STYLES[source]
        )
        at_zero = axes.bar(-0.04, zeros, 0.03, color="0.1", label="exactly 0")
        handles = [*handles[:-1], bars[0], at_zero]
        axes.set_title(f"{source}: {zeros} of {len(values)} exactly 0", fontsize="small")
        axes.set_xlabel("estimated k7", fontsize="small")
        axes.tick_params(labelbottom=True)
        axes.set_ylabel("runs")
    if handles:
        legend_below(figure, handles)
    return figure
