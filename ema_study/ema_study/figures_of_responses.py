# SPDX-License-Identifier: Apache-2.0
"""Figures of chapter 4: responses, noise, and comparison of reference and monitor."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ema_core.description import SAMPLE_PERIOD
from ema_monitor.windows.band import BAND_S, band_limited
from ema_study.cases import KIND_NAMES
from ema_study.figures_of_runs import legend_below, tidy
from ema_study.responses import (
    COMMANDS,
    COMPARED,
    NOISE_GAINS,
    SEVERITIES,
    Currents,
    chirp_currents,
    compared,
    noisy_response,
    reference_responses,
    step_currents,
    uncalibrated_currents,
)
from ema_study.sources import MODEL_LABELS

_DETAILS: Final = {"step": (0.005, 0.06), "chirp": (0.30, 0.40)}
"""Time range that the right panels enlarge [s], keyed by command."""

_START: Final = (0.009, 0.02)
"""Time range enlarged for backlash under the step [s]: backlash affects only the start."""

_MODEL_STYLES: Final[dict[str, dict[str, Any]]] = {
    "fast": {"color": "#0072b2", "lw": 1.1},
    "thesis": {"color": "#d55e00", "lw": 1.1, "ls": (0, (4, 1.5))},
}
_COMMAND: Final[dict[str, Any]] = {"color": "0.45", "lw": 1.0, "ls": (0, (2, 2))}


def figures_of_chapter_4() -> dict[str, Figure]:
    """Return the figures of chapter 4, keyed by name."""
    before, healthy = uncalibrated_currents(), chirp_currents("none")
    by_name = {
        "calibration": {"healthy, before calibration": before, "healthy, calibrated": healthy}
    }
    for fault in SEVERITIES:
        title = f"{KIND_NAMES[fault]}, {compared(fault)}"
        by_name[f"{fault}_monitor"] = {"healthy": healthy, title: chirp_currents(fault)}
    doubled = step_currents(COMPARED["friction"])
    by_name["step_monitor"] = {"nominal friction": step_currents(0), "friction doubled": doubled}
    return {
        **{
            f"{fault}_{command}": draw_responses(fault, command)
            for fault in SEVERITIES
            for command in COMMANDS
        },
        "noise": draw_noise(),
        **{name: draw_currents(currents) for name, currents in by_name.items()},
    }


def draw_responses(fault: str, command: str) -> Figure:
    """Return a figure of position, speed and current for increasing severities of a fault."""
    responses = reference_responses(fault, command)
    # From light to dark: the colours are also distinct in greyscale.
    colours = colormaps["viridis_r"](0.15 + 0.8 * np.linspace(0.0, 1.0, len(responses)))
    figure, panels = _panels(3, 7.5)
    is_chirp = command == "chirp"
    rows = {
        "position": ("user position [mrad]", 1e3) if is_chirp else ("user position [rad]", 1.0),
        "speed": ("motor speed [rad/s]", 1.0),
        "current": ("current [A]", 1.0),
    }
    commanded = np.concatenate([[0.0], COMMANDS[command].sample(SAMPLE_PERIOD)])
    for (column, (label, scale)), row in zip(rows.items(), panels, strict=True):
        for axes in row:
            # Draw the mildest severity last, so that the worst does not cover it.
            for response, colour in reversed([*zip(responses.values(), colours, strict=True)]):
                _plot(axes, scale * getattr(response, column), color=colour, lw=1.0)
        row[0].set_ylabel(label)
        _enlarge(row[1], *(_START if fault == "backlash" and not is_chirp else _DETAILS[command]))
        if column == "position" and is_chirp:
            for axes in row:
                _plot(axes, scale * commanded, **_COMMAND)
    handles = [
        Line2D([], [], color=colour, lw=2.0, label=label)
        for label, colour in zip(responses, colours, strict=True)
    ]
    if is_chirp:
        handles.append(Line2D([], [], label="command", **_COMMAND))
    figure.suptitle(f"{KIND_NAMES[fault].capitalize()}, {command}", fontsize="large")
    legend_below(figure, handles)
    return figure


def draw_noise() -> Figure:
    """Return a figure of the current under the chirp, for increasing noise on its reference."""
    figure, panels = _panels(len(NOISE_GAINS), 7.0)
    for gain, row in zip(NOISE_GAINS, panels, strict=True):
        for axes in row:
            _plot(axes, noisy_response(gain).current, color="#0072b2", lw=0.7)
        row[0].set_title(f"K = {gain:g}" if gain else "no noise", fontsize="medium", loc="left")
        row[0].set_ylabel("current [A]")
        _enlarge(row[1], *_DETAILS["chirp"])
    return figure


def draw_currents(by_title: Mapping[str, Currents]) -> Figure:
    """Return a figure of currents, with the differences between reference and monitor below.

    Each title has a panel of currents. The differences are shown without PWM ripple.
    """
    figure = Figure(figsize=(9.0, 1.0 + 3.6 * len(by_title)), layout="constrained")
    heights = [2.0, 1.0] * len(by_title)
    panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    tidy(*panels)
    lowers = panels[1::2]
    for upper, lower, (title, currents) in zip(panels[::2], lowers, by_title.items(), strict=True):
        for model, current in currents.monitor.items():
            style, label = _MODEL_STYLES[model], f"monitor, {MODEL_LABELS[model]}"
            _plot(upper, current, first=1, label=label, **style)
            difference = band_limited(currents.reference - current, SAMPLE_PERIOD)
            lower.plot(BAND_S / 2.0 * np.arange(1, len(difference) + 1), difference, **style)
        _plot(upper, currents.reference, first=1, label="reference", color="0.1", lw=0.8)
        upper.set_ylabel("current [A]")
        lower.set_ylabel("reference −\nmonitor [A]", fontsize="small")
        upper.set_title(title, fontsize="medium", loc="left")
    widest = max(0.1, *(abs(limit) for axes in lowers for limit in axes.get_ylim()))
    for axes in lowers:
        axes.set_ylim(-widest, widest)
    panels[-1].set_xlabel("time [s]")
    legend_below(figure, panels[0].get_legend_handles_labels()[0])
    return figure


def _panels(rows: int, height: float) -> tuple[Figure, Any]:
    """Return a figure with rows of two panels; the right panel shows an enlarged range."""
    figure = Figure(figsize=(9.0, height), layout="constrained")
    panels = figure.subplots(rows, 2, width_ratios=[1.6, 1.0], sharex="col")
    tidy(*panels.flat)
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    return figure, panels


def _plot(axes: Axes, values: Any, *, first: int = 0, **style: Any) -> None:
    """Plot samples over time; the first value is at sample ``first``."""
    axes.plot(SAMPLE_PERIOD * np.arange(first, first + len(values)), values, **style)


def _enlarge(axes: Axes, low: float, high: float) -> None:
    """Zoom a panel to a time range, with vertical limits fitted to its lines."""
    lines = [np.array(line.get_xydata()) for line in axes.get_lines()]
    inside = np.concatenate([xy[(xy[:, 0] >= low) & (xy[:, 0] <= high), 1] for xy in lines])
    margin = 0.05 * float(np.ptp(inside))
    axes.set_xlim(low, high)
    axes.set_ylim(inside.min() - margin, inside.max() + margin)
