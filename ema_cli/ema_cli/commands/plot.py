"""``ema plot``: telemetry, fit and faults of a bag as a picture."""

from pathlib import Path
from typing import Final

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ema_cli.bags.history import read_history
from ema_cli.bags.outline import Outline
from ema_cli.bags.source_options import USE_OPTIONS, Source, source_options
from ema_cli.bags.windows import BagWindows, read_windows
from ema_cli.commands.estimate import estimate_windows
from ema_cli.errors import one_clear_line
from ema_cli.identification_options import IdentificationOptions, identification_options
from ema_cli.show.history_figure import draw_history
from ema_cli.show.picture_path import require_drawable, save_picture
from ema_cli.show.style import draw_estimates
from ema_core.faults import FAULTS, healthy_faults
from ema_core.wording import counted
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.windows.band import band_limited, band_samples
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_SHADE: Final = 0.12


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@source_options(USE_OPTIONS)
@identification_options
@click.option("--window", "number", type=click.IntRange(0), help="Show the fit of this window.")
@click.option(
    "--history",
    "as_history",
    is_flag=True,
    help="Draw the recorded estimates over test cycles, beside the truth where that is recorded.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture to write (.png, .svg, .pdf); by default beside the bag.",
)
def plot(
    bag: Path,
    source: Source,
    options: IdentificationOptions,
    number: int | None,
    as_history: bool,
    output: Path | None,
) -> None:
    """Draw the telemetry of BAG with its windows; with --window, also its fit and faults."""
    if as_history and number is not None:
        raise click.UsageError("--history and --window exclude each other")
    with one_clear_line():
        output = output or bag.with_suffix(".png")
        require_drawable(output)
        if as_history:
            save_picture(draw_history(read_history(bag, source.actuator_id)), output)
            click.echo(f"{output}")
            return
        outline = Outline()
        found = read_windows(bag, source, outline.add)
        for remark in found.remarks:
            click.echo(f"{bag}: {remark}", err=True)
        if number is None:
            figure = draw_telemetry(found, outline)
        else:
            window = _window(found, number)
            calibration = options.calibration()
            # With those before it, in which a warm search begins.
            before = found.windows[: number + 1]
            one = estimate_windows(before, calibration, options, force=source.force)[-1]
            if not one.valid:
                raise ValueError(f"window {number} has no estimate: {one.reason}")
            figure = draw_fit(found, window, calibration, one)
        save_picture(figure, output)
    click.echo(f"{output}")


def _window(found: BagWindows, number: int) -> Window:
    if number >= len(found.windows):
        windows = counted(len(found.windows), "window")
        raise ValueError(f"--window {number}: the bag has {windows}, numbered from 0")
    window = found.windows[number].window
    if not isinstance(window, Window):
        raise ValueError(f"window {number} cannot be used: {window.reason}")
    return window


def draw_telemetry(found: BagWindows, outline: Outline) -> Figure:
    """Return a figure of the whole telemetry, windows shaded.

    Parameters
    ----------
    found
        What is in the bag.
    outline
        Its telemetry.
    """
    figure = Figure(figsize=(11, 8), layout="constrained")
    angle, current, speed = figure.subplots(3, 1, sharex=True)
    for axes, name, factor, colour, width in (
        (angle, "command", 1e3, "C0", 1.0),
        (angle, "position", 1e3, "C1", 1.0),
        (current, "current", 1.0, "C2", 0.6),
        (speed, "speed", 1.0, "C3", 0.8),
    ):
        t, values = outline.lines(name, found.first_ns)
        axes.plot(t, factor * values, colour, lw=width, label=name)
    for axes in (angle, current, speed):
        for window in found.windows:
            colour = "C3" if isinstance(window.place, Refusal) else "C0"
            start, end = found.seconds(window.start_ns), found.seconds(window.end_ns)
            axes.axvspan(start, end, color=colour, alpha=_SHADE, lw=0)
    _label(angle, "user shaft [mrad]")
    _label(current, "current [A]")
    _label(speed, "motor [rad/s]")
    speed.set_xlabel("time since the first sample [s]")
    unit = found.description
    figure.suptitle(f"{unit.actuator_id} ({unit.serial_number})", ha="left", x=0.01)
    handles = [line for axes in (angle, current, speed) for line in axes.lines]
    refused = [isinstance(window.place, Refusal) for window in found.windows]
    if not all(refused):
        handles.append(Patch(color="C0", alpha=_SHADE, lw=0, label="window"))
    if any(refused):
        handles.append(Patch(color="C3", alpha=_SHADE, lw=0, label="window that cannot be used"))
    figure.legend(handles=handles, loc="outside upper center", ncols=6, frameon=False)
    return figure


def draw_fit(found: BagWindows, window: Window, calibration: Calibration, one: Estimate) -> Figure:
    """Return a figure of a window's current, what the model makes of it, and the faults.

    Parameters
    ----------
    found
        What is in the bag.
    window
        The window.
    calibration
        Calibration that was used.
    one
        The estimate in the window.
    """
    faults = np.array([one.faults, healthy_faults()])
    response = calibration.model().respond(window, faults, one.play)
    modelled = calibration.expect(response, calibration.alignment(window)).current
    residual = window.current - modelled[0]
    t = found.seconds(window.start_ns) + window.sample_period * np.arange(1, len(window) + 1)

    figure = Figure(figsize=(11, 9), layout="constrained")
    fit, rest, bars = figure.subplots(3, 1, height_ratios=(3, 1.5, 2))
    fit.plot(t, window.current, "0.6", lw=0.8, label="measured")
    fit.plot(t, modelled[1], "C0--", lw=0.9, label="model, healthy")
    fit.plot(t, modelled[0], "C3", lw=0.9, label="model, estimated faults")
    _label(fit, "current [A]")
    fit.legend(loc="lower left", ncols=3, fontsize="small")
    rest.plot(t, residual, "0.75", lw=0.5, label="residual")
    smooth = band_limited(residual, window.sample_period)
    half = band_samples(len(window), window.sample_period)
    rest.plot(t[half::half][: len(smooth)], smooth, "C3", lw=1, label="band-limited")
    _label(rest, "residual [A]")
    rest.legend(loc="lower left", ncols=3, fontsize="small")
    rest.set_xlabel("time since the first sample [s]")

    place = np.arange(len(FAULTS))
    for bad, colour, name in ((False, "C3", "estimate"), (True, "0.7", "unobservable")):
        chosen = one.unobservable == bad
        if chosen.any():
            healthy = healthy_faults()[chosen]
            above = one.faults[chosen] - healthy
            bars.bar(place[chosen], above, bottom=healthy, color=colour, label=name)
    interval = {"fmt": "none", "ecolor": "k", "capsize": 4, "label": "90 % interval"}
    draw_estimates(bars, place, one.faults, one.sigma, **interval)
    bars.plot(place, healthy_faults(), "C0_", ms=28, mew=2, label="healthy")
    bars.set_xticks(place, [fault.label for fault in FAULTS], rotation=15)
    bars.set_ylim(-0.02, 1.05)
    _label(bars, "normalised fault")
    bars.legend(loc="upper left", ncols=4, fontsize="small", markerscale=0.5)
    figure.suptitle(
        f"{found.description.actuator_id}: {one.algorithm}, "
        f"{counted(one.evaluations, 'evaluation')}, goodness of fit {one.goodness_of_fit:.2f} "
        f"(limit {one.goodness_limit:.2f})"
    )
    return figure


def _label(axes: Axes, quantity: str) -> None:
    axes.set_ylabel(quantity)
    axes.grid(alpha=0.3)
