# SPDX-License-Identifier: Apache-2.0
"""Picture of a history: true and estimated faults over test cycles."""

from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ema_cli.bags.diagnoses import DiagnosisLog, has_latency
from ema_core.faults import FAULTS, INDICES, N_FAULTS
from ema_core.levels import LEVEL_NAMES
from ema_core.wording import counted
from ema_monitor.plot.style import (
    BLUE,
    BROWN,
    ESTIMATES,
    GREEN,
    GREY,
    INK,
    LEVEL_COLOURS,
    LIMIT,
    ORANGE,
    PURPLE,
    SKY,
    TRUTH,
    draw_estimates,
    draw_legend,
    stacked_panels,
)

_MOVES: Final = 0.03
_LEAST_ERROR: Final = 0.01
_SHADE: Final = 0.22
# The true faults of a simulated actuator change in steps from test to test.
_TRUTH: Final = {**TRUTH, "ls": "-", "drawstyle": "steps-mid"}
_MEDIAN: Final = {"color": INK, "ls": ":", "lw": 1.2}
_OTHERS: Final = tuple(zip((BLUE, GREEN, PURPLE, ORANGE, GREY, BROWN, SKY), "os^DvPX", strict=True))


class _Tests(NamedTuple):
    """Tests to draw: positions on the axis, ``(n,)``; faults, sigma and truth, ``(n, 8)``."""

    place: NDArray[np.float64]
    good: NDArray[np.bool_]
    faults: NDArray[np.float64]
    sigma: NDArray[np.float64]
    truth: NDArray[np.float64]

    def moves(self, i: int) -> bool:
        """Return whether the true fault ``i``, or its estimate if unknown, departs from healthy."""
        healthy, least = FAULTS[i].healthy, 3.0 * self.sigma[self.good, i]
        estimated = np.abs(self.faults[self.good, i] - healthy) > np.fmax(least, _MOVES)
        true = np.abs(self.truth[:, i] - healthy) > _MOVES
        return bool(np.any(true if np.isfinite(self.truth).any() else estimated))


def draw_history(history: DiagnosisLog) -> Figure:
    """Return a figure with panels for each changed fault, all other faults, and latency."""
    diagnoses = history.diagnoses()
    has_truth = all(window.cycle is not None for window in diagnoses)
    unknown = np.full(N_FAULTS, np.nan)
    tests = _Tests(
        np.array(
            [window.cycle if has_truth else window.window for window in diagnoses], dtype=float
        ),
        np.array([window.valid for window in diagnoses]),
        np.array([window.faults for window in diagnoses]),
        np.array([window.sigma for window in diagnoses]),
        np.array([unknown if window.truth is None else window.truth for window in diagnoses]),
    )
    moving = [i for i in INDICES if tests.moves(i)] or INDICES
    resting = [i for i in INDICES if i not in moving]
    timed = has_latency(diagnoses)

    heights = [2.0] * len(moving) + [1.5] * bool(resting) + [1.0] * timed
    figure, panels = stacked_panels(heights, 1.05)
    for axes, i in zip(panels, moving, strict=False):
        _draw_fault(axes, tests, i, history.limits.get(FAULTS[i].name))
    if resting:
        _draw_errors(panels[len(moving)], tests, resting)
    if timed:
        latencies = [window.latency_s for window in diagnoses]
        panels[-1].bar(tests.place, latencies, width=0.6, color="0.55")
        median = float(np.median(latencies))
        panels[-1].axhline(median, label=f"median latency, {median:.2f} s", **_MEDIAN)
        panels[-1].set_ylim(0.0, 1.25 * max(latencies))
        panels[-1].set_ylabel("latency [s]")
    levels = [window.level for window in diagnoses]
    for axes in panels:
        for place, level in zip(tests.place, levels, strict=True):
            if level is not None and level in LEVEL_COLOURS:
                colour, label = LEVEL_COLOURS[level], LEVEL_NAMES[level]
                axes.axvspan(
                    place - 0.5, place + 0.5, color=colour, alpha=_SHADE, lw=0, label=label
                )
    panels[-1].set_xlabel("test cycle" if has_truth else "window")
    panels[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    panels[-1].set_xlim(tests.place.min() - 0.5, tests.place.max() + 0.5)
    figure.align_ylabels(panels)
    lines = [
        f"{history.actuator_id} ({history.serial_number}): {tests.good.sum()} of "
        f"{counted(len(diagnoses), 'window')} with a valid estimate"
    ]
    for level in filter(levels.__contains__, LEVEL_COLOURS):
        first = levels.index(level)
        what = f"{'cycle' if has_truth else 'window'} {tests.place[first]:.0f}"
        lines.append(f"{LEVEL_NAMES[level]} first in {what}: {diagnoses[first].cause}")
    panels[0].set_title("\n".join(lines), loc="left", fontsize="medium")
    draw_legend(figure, [*panels[: len(moving)], *panels[-1:] * timed])
    return figure


def _draw_fault(axes: Axes, tests: _Tests, i: int, limit: float | None) -> None:
    place, good = tests.place, tests.good
    if np.isfinite(tests.truth).any():
        axes.plot(place, tests.truth[:, i], **_TRUTH)
    value, sigma = tests.faults[good, i], tests.sigma[good, i]
    draw_estimates(axes, place[good], value, sigma, color=BLUE, capsize=2.5, **ESTIMATES)
    bottom = axes.get_ylim()[0]
    if not good.all():
        low = np.full(int((~good).sum()), bottom)
        axes.plot(place[~good], low, "x", color="0.4", ms=6, label="no valid estimate")
    if limit is not None:
        axes.axhline(limit, **LIMIT)
    axes.set_ylabel(FAULTS[i].label)


def _draw_errors(axes: Axes, tests: _Tests, resting: list[int]) -> None:
    good = tests.good
    for i, (colour, marker) in zip(resting, _OTHERS, strict=False):
        truth = np.where(np.isnan(tests.truth[:, i]), FAULTS[i].healthy, tests.truth[:, i])
        error = tests.faults[good, i] - truth[good]
        style = {"marker": marker, "ms": 4.5, "mfc": "none", "lw": 0.8}
        axes.plot(tests.place[good], error, color=colour, label=FAULTS[i].label, **style)
    widest = max(_LEAST_ERROR, *(abs(value) for value in axes.get_ylim()))
    # Leave space for the legend at the top.
    axes.set_ylim(-1.05 * widest, 1.6 * widest)
    axes.set_ylabel("error of\nthe others")
    axes.legend(loc="upper left", ncols=len(resting), fontsize="small", frameon=False)
