"""Picture of a history: true and estimated faults over test cycles."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ema_cli.bags.diagnoses import DiagnosedWindow, DiagnosisLog, has_latency
from ema_core.faults import FAULTS
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
_SHADE: Final = 0.22
# From test to test the true faults of a simulated actuator jump.
_TRUTH: Final = {**TRUTH, "ls": "-", "drawstyle": "steps-mid"}
_MEDIAN: Final = {"color": INK, "ls": ":", "lw": 1.2}
_OTHERS: Final = (BLUE, GREEN, PURPLE, ORANGE, GREY, BROWN, SKY)


def draw_history(history: DiagnosisLog) -> Figure:
    """Return a figure: a panel for each fault that moves, one for the others, and latency."""
    diagnoses = history.diagnoses()
    numbers = [i for i, fault in enumerate(FAULTS) if fault.limit is not None]
    moving = [i for i in numbers if _moves(diagnoses, i)] or numbers
    resting = [i for i in numbers if i not in moving]
    timed = has_latency(diagnoses)

    heights = [2.0] * len(moving) + [1.5] * bool(resting) + [1.0] * timed
    figure, panels = stacked_panels(heights, 1.05)
    for axes, i in zip(panels, moving, strict=False):
        _draw_fault(axes, diagnoses, i, history.limits.get(FAULTS[i].name))
    if resting:
        _draw_errors(panels[len(moving)], diagnoses, resting)
    if timed:
        _draw_latency(panels[-1], diagnoses)
    for axes in panels:
        _shade(axes, diagnoses)
    known = all(one.cycle is not None for one in diagnoses)
    panels[-1].set_xlabel("test cycle" if known else "window")
    panels[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    panels[-1].set_xlim(_place(diagnoses).min() - 0.5, _place(diagnoses).max() + 0.5)
    figure.align_ylabels(panels)
    valid = sum(one.valid for one in diagnoses)
    lines = [
        f"{history.actuator_id} ({history.serial_number}): {valid} of "
        f"{counted(len(diagnoses), 'window')} with a valid estimate",
        *_changes_of_level(diagnoses, "cycle" if known else "window"),
    ]
    panels[0].set_title("\n".join(lines), loc="left", fontsize="medium")
    draw_legend(figure, [*panels[: len(moving)], *panels[-1:] * timed])
    return figure


def _changes_of_level(diagnoses: list[DiagnosedWindow], place_name: str) -> list[str]:
    """Return when each level came first, and why, a line each."""
    levels = [one.level for one in diagnoses]
    lines = []
    for level in LEVEL_COLOURS:
        if level in levels:
            first = levels.index(level)
            place, cause = _place(diagnoses)[first], diagnoses[first].cause
            lines.append(f"{LEVEL_NAMES[level]} first in {place_name} {place:.0f}: {cause}")
    return lines


def _moves(diagnoses: list[DiagnosedWindow], i: int) -> bool:
    healthy = FAULTS[i].healthy
    if any(one.truth is not None for one in diagnoses):
        return any(
            one.truth is not None and abs(one.truth[i] - healthy) > _MOVES for one in diagnoses
        )
    return any(
        one.valid and abs(one.faults[i] - healthy) > max(_MOVES, 3.0 * one.sigma[i])
        for one in diagnoses
    )


def _place(diagnoses: list[DiagnosedWindow]) -> NDArray[np.float64]:
    """Return the test cycles, or windows where there is one whose cycle is not known."""
    cycles = [one.cycle for one in diagnoses if one.cycle is not None]
    if len(cycles) < len(diagnoses):
        return np.array([one.window for one in diagnoses], dtype=float)
    return np.array(cycles, dtype=float)


def _shade(axes: Axes, diagnoses: list[DiagnosedWindow]) -> None:
    for place, one in zip(_place(diagnoses), diagnoses, strict=True):
        if one.level is not None and one.level in LEVEL_COLOURS:
            colour, label = LEVEL_COLOURS[one.level], LEVEL_NAMES[one.level]
            axes.axvspan(place - 0.5, place + 0.5, color=colour, alpha=_SHADE, lw=0, label=label)


def _draw_fault(axes: Axes, diagnoses: list[DiagnosedWindow], i: int, limit: float | None) -> None:
    place = _place(diagnoses)
    if any(one.truth is not None for one in diagnoses):
        truth = [np.nan if one.truth is None else one.truth[i] for one in diagnoses]
        axes.plot(place, truth, **_TRUTH)
    good = np.array([one.valid for one in diagnoses])
    value = np.array([one.faults[i] for one in diagnoses])
    sigma = np.array([one.sigma[i] for one in diagnoses])
    draw_estimates(
        axes,
        place[good],
        value[good],
        sigma[good],
        color=BLUE,
        capsize=2.5,
        **ESTIMATES,
    )
    bottom = axes.get_ylim()[0]
    if not good.all():
        low = np.full(int((~good).sum()), bottom)
        axes.plot(place[~good], low, "x", color="0.4", ms=6, label="no valid estimate")
    if limit is not None:
        axes.axhline(limit, **LIMIT)
    axes.set_ylabel(FAULTS[i].label)


def _draw_errors(axes: Axes, diagnoses: list[DiagnosedWindow], resting: list[int]) -> None:
    place = _place(diagnoses)
    good = np.array([one.valid for one in diagnoses])
    for i, colour in zip(resting, _OTHERS, strict=False):
        error = np.array(
            [one.faults[i] - (FAULTS[i].healthy if one.truth is None else one.truth[i])
             for one in diagnoses]
        )  # fmt: skip
        axes.plot(place[good], error[good], ".-", color=colour, lw=0.8, label=FAULTS[i].label)
    widest = max(0.03, *(abs(value) for value in axes.get_ylim()))
    axes.set_ylim(-1.05 * widest, 1.05 * widest)
    axes.set_ylabel("error of\nthe others")
    axes.legend(loc="upper left", ncols=len(resting), fontsize="small", frameon=False)


def _draw_latency(axes: Axes, diagnoses: list[DiagnosedWindow]) -> None:
    latencies = np.array([one.latency_s for one in diagnoses])
    axes.bar(_place(diagnoses), latencies, width=0.6, color="0.55")
    median = float(np.median(latencies))
    axes.axhline(median, label=f"median latency, {median:.2f} s", **_MEDIAN)
    axes.set_ylim(0.0, 1.25 * float(latencies.max()))
    axes.set_ylabel("latency [s]")
