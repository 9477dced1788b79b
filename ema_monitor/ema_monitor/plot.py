"""Pictures of an identification. They need matplotlib (``pip install ema_monitor[plot]``)."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema_core.faults import FAULTS, healthy_faults
from ema_core.wording import counted
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.health import ONE_SIDED_95
from ema_monitor.identification.estimate import Estimate
from ema_monitor.model.deviations import COLUMNS
from ema_monitor.model.readings import read
from ema_monitor.windows.band import band_limited, band_samples
from ema_monitor.windows.window import Window


def plot_fit(
    window: Window,
    estimate: Estimate,
    calibration: Calibration | None = None,
    *,
    since_ns: int | None = None,
) -> Figure:
    """Return a figure of a window's current, that of the model, and the faults.

    Parameters
    ----------
    window
        The window.
    estimate
        The valid estimate in it.
    calibration
        Calibration that it was made with; that of the built-in actuator when None.
    since_ns
        Stamp from which the time axis counts [ns]; the start of the window when None.

    Raises
    ------
    ValueError
        When the estimate is not valid.
    """
    if not estimate.valid:
        raise ValueError(f"no picture without a valid estimate: {estimate.reason}")
    calibration = calibration or Calibration.builtin()
    start_s = 0.0 if since_ns is None else (window.start_ns - since_ns) * 1e-9
    faults = np.array([estimate.faults, healthy_faults()])
    columns = np.zeros((2, len(COLUMNS)))
    # What was measured holds for the healthy actuator as well; what the window shows, holds more.
    for row, causes in ((0, (*estimate.measured, *estimate.causes)), (1, estimate.measured)):
        for one in causes:
            columns[row, COLUMNS.index(one.name)] = one.value
    deviations, position = read(columns, window)
    response = calibration.model().respond(
        window, faults, estimate.play, deviations=deviations, position=position
    )
    modelled = calibration.expect(response, window).current
    residual = window.current - modelled[0]
    t = start_s + window.sample_period * np.arange(1, len(window) + 1)

    figure = Figure(figsize=(11, 9), layout="constrained")
    fit, rest, bars = figure.subplots(3, 1, height_ratios=(3, 1.5, 2))
    fit.plot(t, window.current, "0.6", lw=0.8, label="measured")
    fit.plot(t, modelled[1], "C0--", lw=0.9, label="model, healthy")
    fit.plot(t, modelled[0], "C3", lw=0.9, label="model, estimated faults")
    label(fit, "current [A]")
    fit.legend(loc="lower left", ncols=3, fontsize="small")
    rest.plot(t, residual, "0.75", lw=0.5, label="residual")
    smooth = band_limited(residual, window.sample_period)
    half = band_samples(len(window), window.sample_period)
    rest.plot(t[half::half][: len(smooth)], smooth, "C3", lw=1, label="band-limited")
    label(rest, "residual [A]")
    rest.legend(loc="lower left", ncols=3, fontsize="small")
    rest.set_xlabel("time since the " + ("start [s]" if since_ns is None else "first sample [s]"))

    sigma = ONE_SIDED_95 * np.nan_to_num(estimate.sigma)
    place = np.arange(len(FAULTS))
    for bad, colour, name in ((False, "C3", "estimate"), (True, "0.7", "unobservable")):
        chosen = estimate.unobservable == bad
        if chosen.any():
            healthy = healthy_faults()[chosen]
            above = np.array(estimate.faults)[chosen] - healthy
            bars.bar(place[chosen], above, bottom=healthy, color=colour, label=name)
    bars.errorbar(
        place, estimate.faults, sigma, fmt="none", ecolor="k", capsize=4, label="90 % interval"
    )
    bars.plot(place, healthy_faults(), "C0_", ms=28, mew=2, label="healthy")
    bars.set_xticks(place, [fault.label for fault in FAULTS], rotation=15)
    bars.set_ylim(-0.02, 1.05)
    label(bars, "normalised fault")
    bars.legend(loc="upper left", ncols=4, fontsize="small", markerscale=0.5)
    fit_quality = f"{estimate.goodness_of_fit:.2f} (limit {estimate.goodness_limit:.2f})"
    figure.suptitle(
        f"{calibration.actuator_id}: {estimate.algorithm}, "
        f"{counted(estimate.evaluations, 'evaluation')}, goodness of fit {fit_quality}"
    )
    return figure


def label(axes: Axes, quantity: str) -> None:
    """Name the quantity of the vertical axis, and draw a grid."""
    axes.set_ylabel(quantity)
    axes.grid(alpha=0.3)
