# SPDX-License-Identifier: Apache-2.0
"""Figures of the study agree with its runs."""

import io

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from ema_study.figures_of_responses import draw_currents
from ema_study.figures_of_runs import (
    ALGORITHM_STYLES,
    ERROR,
    STYLES,
    TIME,
    draw_convergence,
    draw_multiple_fault,
    draw_single_faults,
    median_course,
)
from ema_study.printed import printed_runs
from ema_study.responses import chirp_currents
from ema_study.sources import SOURCES

from .synthetic_runs import FLOOR, THRESHOLD, synthetic_runs

pytestmark = pytest.mark.long

EMPTY = pd.DataFrame()


@pytest.fixture(scope="module")
def ours():
    return pd.concat([synthetic_runs("fast", 3), synthetic_runs("thesis", 2)], ignore_index=True)


@pytest.fixture(scope="module")
def everything(ours):
    return pd.concat([printed_runs(), ours], ignore_index=True)


def panel(figure, title):
    [axes] = [axes for axes in figure.axes if axes.get_title() == title]
    return axes


def ys(line):
    return np.asarray(line.get_ydata(), dtype=float)


def rectangles(axes):
    return [patch for patch in axes.patches if isinstance(patch, Rectangle)]


def bars(axes, color, hatch=""):
    """Return the heights of the bars of a source from left to right."""
    patches = [
        patch
        for patch in rectangles(axes)
        if to_hex(patch.get_facecolor()) == color and (patch.get_hatch() or "") == hatch
    ]
    return [patch.get_height() for patch in sorted(patches, key=lambda patch: patch.get_x())]


@pytest.mark.parametrize("quantity", [ERROR, TIME])
def test_bars_are_the_means_over_runs(everything, quantity):
    figure = draw_single_faults(everything, quantity)
    faults = ["friction", "backlash", "short_circuit", "eccentricity", "gain"]
    for source in SOURCES:
        for algorithm, level in (("de", "low"), ("gwo", "high")):
            name = algorithm + ("_thesis" if source.endswith("thesis's code") else "")
            model = {"p": "printed", "t": "thesis", "f": "fast"}[source[0]]
            runs = everything[
                (everything.model == model)
                & (everything.algorithm == name)
                & (everything.level == level)
                & everything.table.between(11, 54)
                & (everything["rule"] != "printed")
            ]
            expected = runs.groupby("fault")[quantity.column].mean().loc[faults]
            axes = panel(figure, f"{algorithm.upper()}, {level}")
            np.testing.assert_allclose(bars(axes, **STYLES[source]), expected)


def test_convergence_plot_shows_runs_medians_and_the_band_up_to_the_threshold(ours):
    figure = draw_convergence(ours, "fast")
    figure.savefig(io.BytesIO(), dpi=20)
    axes = panel(figure, "friction, high")
    # Three runs of six algorithms and their medians.
    assert len(axes.lines) == 6 * 3 + 6
    [band] = rectangles(axes)
    assert (band.get_y(), band.get_y() + band.get_height()) == pytest.approx((FLOOR, THRESHOLD))
    mine = ours[
        (ours.model == "fast") & (ours.table == 16) & (ours.algorithm == "pso")
    ].costs.tolist()
    drawn = [line for line in axes.lines if line.get_color() == ALGORITHM_STYLES["pso"]["color"]]
    np.testing.assert_allclose(ys(drawn[-1]), median_course(mine))


def test_comparison_plots_show_two_monitors_and_their_deviations():
    figure = draw_currents({"gain": chirp_currents("gain")})
    upper, lower = figure.axes
    assert (len(upper.lines), len(lower.lines)) == (3, 2)
    assert legend(figure) == ["monitor, fast model", "monitor, thesis's model", "reference"]


def legend(figure):
    return [text.get_text() for legend_box in figure.legends for text in legend_box.get_texts()]


def test_every_mark_is_in_a_legend_of_at_most_eight_entries(everything, ours):
    sources = list(SOURCES)
    for figure in (draw_single_faults(everything, ERROR), draw_multiple_fault(everything)):
        assert legend(figure) == [*sources, "one standard deviation"]
    algorithms = ["GA", "PSO", "DE", "GWO", "DE, thesis's code", "GWO, thesis's code"]
    costs = [*algorithms, "single runs", "cost of the true faults to threshold"]
    assert legend(draw_convergence(ours, "fast")) == costs


def test_figures_without_any_runs_state_so():
    for figure in (
        draw_single_faults(EMPTY, TIME),
        draw_multiple_fault(EMPTY),
        draw_convergence(EMPTY, "fast"),
    ):
        assert all(axes.texts[0].get_text() == "no runs" for axes in figure.axes)
