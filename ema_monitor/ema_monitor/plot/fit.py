# SPDX-License-Identifier: Apache-2.0
"""Figure of an estimate: measured and modelled signals, and the faults."""

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from ema_core.arrays import Array
from ema_core.faults import FAULTS, healthy_faults
from ema_core.wording import counted
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.window_fit import expected_signals
from ema_monitor.model.monitor_model import Response
from ema_monitor.plot.style import BLUE, GREY, INK, VERMILION, draw_estimates, draw_legend, tidy
from ema_monitor.windows.band import band_limited, band_samples
from ema_monitor.windows.window import Window

_HEIGHTS: Final = (3.0, 1.3, 2.0, 1.3, 2.2)
_MEASURED: Final[dict[str, Any]] = {"color": GREY, "alpha": 0.6, "lw": 2.0, "label": "measured"}
_HEALTHY: Final[dict[str, Any]] = {"color": BLUE, "ls": "--", "lw": 0.9, "label": "model, healthy"}
_FITTED: Final[dict[str, Any]] = {"color": VERMILION, "lw": 0.9, "label": "model, estimated faults"}
_RESIDUAL: Final[dict[str, Any]] = {
    "color": GREY,
    "alpha": 0.6,
    "lw": 0.5,
    "label": "measured − model",
}
_SMOOTH: Final[dict[str, Any]] = {
    "color": INK,
    "lw": 1.0,
    "label": "measured − model, band-limited",
}
_BAR: Final = "estimate, 90 % interval"


def plot_fit(
    window: Window,
    estimate: Estimate,
    calibration: Calibration | None = None,
    *,
    since_ns: int | None = None,
) -> Figure:
    """Return a figure with measured and modelled current and speed, and the estimated faults.

    Parameters
    ----------
    window
        The window.
    estimate
        A valid estimate of the window.
    calibration
        Calibration of the estimate; None for the built-in actuator.
    since_ns
        Stamp at the zero of the time axis [ns]; None for the start of the window.

    Raises
    ------
    ValueError
        If the estimate is not valid.
    """
    if not estimate.valid:
        raise ValueError(f"cannot plot an estimate that is not valid: {estimate.reason}")
    calibration = calibration or Calibration.builtin()
    start_s = 0.0 if since_ns is None else (window.start_ns - since_ns) * 1e-9
    t = start_s + window.sample_period * np.arange(1, len(window) + 1)
    modelled = expected_signals(window, estimate, calibration)
    figure = Figure(figsize=(10.5, 11.0), layout="constrained")
    subfigures: Any = figure.subfigures(2, 1, height_ratios=(sum(_HEIGHTS[:-1]), _HEIGHTS[-1]))
    signals, bars = subfigures
    panels = list(signals.subplots(4, 1, sharex=True, height_ratios=_HEIGHTS[:-1]))
    measured = Response(window.current, window.speed(calibration.parameters.tau))
    for number, unit in enumerate(("A", "rad/s")):
        pair = panels[2 * number : 2 * number + 2]
        _draw_signal(pair, t, window.sample_period, measured[number], modelled[number])
        column = Response._fields[number]
        if column in window.telemetry.missing:
            remark = {"current": "not measured", "speed": "derived from the position"}[column]
            pair[0].set_title(remark, loc="right", fontsize="small")
        for axes, quantity in zip(pair, (column, "residual"), strict=True):
            axes.set_ylabel(f"{quantity} [{unit}]")
    panels[-1].set_xlabel(
        "time since the " + ("start [s]" if since_ns is None else "first sample [s]")
    )
    signals.align_ylabels(panels)
    draw_legend(signals, panels)
    _draw_faults(bars.subplots(), estimate)
    goodness = f"{estimate.goodness_of_fit:.2f} (limit {estimate.goodness_limit:.2f})"
    panels[0].set_title(
        f"{calibration.actuator_id}: {estimate.algorithm}, "
        f"{counted(estimate.evaluations, 'evaluation')}, goodness of fit {goodness}",
        loc="left",
        fontsize="medium",
    )
    return figure


def _draw_signal(
    panels: list[Axes], t: NDArray[np.floating], period: float, measured: Array, modelled: Array
) -> None:
    """Draw the measured and modelled signal, and below it the residual, if measured."""
    signal_axes, residual_axes = panels
    if len(measured):
        signal_axes.plot(t, measured, **_MEASURED)
        residual = measured - modelled[0]
        residual_axes.plot(t, residual, **_RESIDUAL)
        smooth, half = band_limited(residual, period), band_samples(len(t), period)
        t_smooth = t if len(smooth) == len(t) else t[half::half][: len(smooth)]
        residual_axes.plot(t_smooth, smooth, **_SMOOTH)
    signal_axes.plot(t, modelled[1], **_HEALTHY)
    signal_axes.plot(t, modelled[0], **_FITTED)
    for axes in panels:
        tidy(axes)


def _draw_faults(axes: Axes, estimate: Estimate) -> None:
    """Draw each fault from its healthy value to its estimate."""
    positions, healthy = np.arange(len(FAULTS)), healthy_faults()
    handles: dict[str, Any] = {}
    for is_unknown, colour, name in ((False, VERMILION, _BAR), (True, GREY, "unobservable")):
        chosen = estimate.unobservable == is_unknown
        if chosen.any():
            heights = np.array(estimate.faults)[chosen] - healthy[chosen]
            axes.bar(positions[chosen], heights, bottom=healthy[chosen], color=colour)
            handles[name] = Patch(color=colour)
    interval = draw_estimates(
        axes, positions, estimate.faults, estimate.sigma, fmt="none", ecolor=INK, capsize=4
    )
    if _BAR in handles:
        handles[_BAR] = (handles[_BAR], interval)
    [handles["healthy"]] = axes.plot(positions, healthy, "_", color=BLUE, ms=28, mew=2)
    axes.set_xticks(positions, [fault.label for fault in FAULTS], rotation=15)
    axes.set_ylim(-0.02, 1.05)
    axes.set_ylabel("normalised fault")
    tidy(axes, "y")
    axes.legend(
        list(handles.values()),
        list(handles),
        loc="upper left",
        ncols=3,
        fontsize="small",
        markerscale=0.5,
        frameon=False,
    )
