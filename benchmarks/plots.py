"""Pictures of the estimator's accuracy, from the figures that accuracy.py wrote.

    python benchmarks/plots.py [--json FILE] [--output FOLDER]

Error of each fault beside the thesis's, error against evaluations, estimates and covariances of
repeated windows, and residuals before and after.
"""

import json
from pathlib import Path
from typing import Any, Final

import bounds
import cases
import click
import numpy as np
import thesis
from bounds import Spectrum
from exactness import HEALTHY_WINDOWS, noisy_window
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from rich.console import Console
from rich.progress import Progress
from timing import AllGenerations
from trials import ACTUATOR, Job, Variant, workers

from ema_core.faults import FAULTS, estimation_error, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate
from ema_monitor.identification.objective import Objective
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identifying import Identification, identify
from ema_monitor.windows.band import band_limited, band_samples
from ema_monitor.windows.window import Window

HERE: Final = Path(__file__).parent

REPEATED: Final = 40
"""Windows of the one case whose estimates are shown beside their covariance."""

CURVES: Final = 12
"""Random cases that the error against evaluations is shown for."""

PAIRS: Final = ((0, 1), (2, 3), (3, 4), (5, 6), (7, 0), (7, 5))
"""Pairs of components that are shown against each other."""

_CHI2_90 = 4.605
_OURS, _OTHERS = "#1a5fb4", ("#9a9996", "#c0bfbc", "#77767b", "#deddda")
_SWARM, _BOUND = "#c64600", "#2d7d46"


def errors_figure(figures: dict[str, Any]) -> Figure:
    """Draw the mean error of each of the thesis's cases, ours beside its four algorithms'."""
    published = thesis.results()
    found = figures["thesis_cases"]
    figure = Figure((11.0, 4.5), layout="constrained")
    axes = figure.add_subplot()
    place = np.arange(len(found))
    width = 0.16
    for i, (algorithm, colour) in enumerate(zip(thesis.ALGORITHMS, _OTHERS, strict=True)):
        errors = [published[name][algorithm].error_percent for name in found]
        label = f"thesis, {algorithm.upper()}"
        axes.bar(place + (i - 2) * width, errors, width, color=colour, label=label)
    errors = [one["thesis"] for one in found.values()]
    axes.bar(place + 2 * width, errors, width, color=_OURS, label="this monitor")
    limits = [one["bound_current_percent"] for one in found.values()]
    axes.plot(place + 2 * width, limits, "_", color=_BOUND, ms=12, mew=2, label="Cramér-Rao bound")
    axes.set(yscale="log", ylabel="mean error [% of range]", title="Error of each fault")
    axes.set_xticks(place, [name.replace(" ", "\n", name.count(" ")) for name in found], size=9)
    axes.set_ylim(bottom=0.01)
    axes.grid(axis="y", alpha=0.3)
    figure.legend(loc="outside lower center", ncols=6, frameon=False)
    return figure


def convergence_figure(
    drawn: list[cases.Case], windows: list[Window], calibration: Calibration
) -> Figure:
    """Draw the median error of the best point so far against the evaluations spent."""
    figure = Figure((7.0, 4.5), layout="constrained")
    axes = figure.add_subplot()
    grid = np.geomspace(50.0, 1e4, 200)
    runs = {
        "least_squares": (SearchSettings(), "least squares (default)", _OURS),
        "pso": (
            SearchSettings(algorithm="pso", stop_rule=AllGenerations()),
            "particle swarm",
            _SWARM,
        ),
    }
    for settings, label, colour in runs.values():
        curves, longest = [], 0
        for window, case in zip(windows, drawn, strict=True):
            run = Identification(window, ACTUATOR, calibration, settings)
            steps = [(g.evaluations, estimation_error(g.faults, case.faults)) for g in run]
            if run.estimate is not None:
                found = run.estimate
                error = estimation_error(found.faults, case.faults)
                steps.append((found.evaluations, error))
            evaluations, errors = np.array(steps).T
            longest = max(longest, evaluations[-1])
            before = np.searchsorted(evaluations, grid, "right") - 1
            curves.append(np.where(before >= 0, errors[before], np.nan))
        known = np.all(np.isfinite(curves), axis=0)
        # Beyond the last evaluation of the longest run there is nothing to show.
        known &= grid <= longest
        low, middle, high = np.quantile(np.array(curves)[:, known], (0.25, 0.5, 0.75), axis=0)
        axes.plot(grid[known], middle, color=colour, label=label)
        axes.plot(grid[known][-1], middle[-1], "o", color=colour)
        axes.fill_between(grid[known], low, high, color=colour, alpha=0.2, lw=0)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="evaluations of the model",
        ylabel="error [% of range]",
        title=f"Error against evaluations, {len(drawn)} random faults, noisy sensors",
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right", title="median and quartiles", frameon=False)
    return figure


def ellipses_figure(
    faults: tuple[float, ...],
    found: np.ndarray,
    covariance: np.ndarray,
    bound_covariance: np.ndarray,
) -> Figure:
    """Draw the estimates of repeated windows over the covariance that they report.

    Parameters
    ----------
    faults
        The truth, eight values.
    found
        Estimates, ``(m, 8)``.
    covariance
        Their mean covariance, ``(8, 8)``.
    bound_covariance
        The Cramer-Rao bound, ``(8, 8)``.
    """
    figure = Figure((10.0, 6.5), layout="constrained")
    handles: list[Any] = []
    for number, (i, j) in enumerate(PAIRS):
        axes = figure.add_subplot(2, 3, number + 1)
        [dots] = axes.plot(*found[:, (i, j)].T, ".", color=_OURS, ms=5, alpha=0.7)
        centre = (faults[i], faults[j])
        reported = _ellipse(axes, centre, covariance[np.ix_((i, j), (i, j))], _OURS)
        best = _ellipse(axes, centre, bound_covariance[np.ix_((i, j), (i, j))], _BOUND)
        [truth] = axes.plot(*centre, "+", color="black", ms=12, mew=1.5)
        axes.set(xlabel=f"k, {FAULTS[i].label}", ylabel=f"k, {FAULTS[j].label}")
        axes.autoscale_view()
        axes.margins(0.1)
        axes.grid(alpha=0.3)
        handles = [dots, reported, best, truth]
    labels = ("estimates", "90 % region reported", "90 % region of the bound", "truth")
    figure.suptitle(f"Estimates of {len(found)} noisy windows of the same wide fault")
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure


def residual_figure(window: Window, calibration: Calibration) -> Figure:
    """Draw the current and its residual, as of a healthy actuator and with the faults found."""
    estimate = identify(window, ACTUATOR, calibration)
    objective = Objective(window, calibration)
    points = [
        objective.encode(np.array(k), estimate.play) for k in (healthy_faults(), estimate.faults)
    ]
    healthy, fitted = objective.expect(np.array(points)).current
    h = window.sample_period
    times_ms = 1e3 * h * np.arange(1, len(window) + 1)
    figure = Figure((10.0, 6.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(times_ms, window.current, color="#c0bfbc", lw=4.0, label="measured")
    above.plot(times_ms, healthy, color=_SWARM, lw=1.0, label="healthy model")
    above.plot(times_ms, fitted, color=_OURS, lw=1.0, label="model with the faults found")
    above.set(ylabel="current [A]", title="Fit of a noisy window of a wide fault")
    for modelled, colour, label in (
        (healthy, _SWARM, "before: healthy model"),
        (fitted, _OURS, "after: faults found"),
    ):
        row = band_limited(window.current - modelled, h)
        middle_ms = 1e3 * h * band_samples(len(window), h) * np.arange(1, len(row) + 1)
        below.plot(middle_ms, row, color=colour, lw=1.0, label=label)
    scatter = calibration.healthy_rms
    below.axhspan(-2 * scatter, 2 * scatter, color=_BOUND, alpha=0.25, lw=0, label="healthy, ±2 σ")
    below.set_yscale("symlog", linthresh=0.1)
    below.set(xlabel="time in the window [ms]", ylabel="band-limited residual [A]")
    below.set_ylim(-100.0, 30.0)
    figure.align_ylabels()
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.legend(loc="lower left")
        axes.set_xlim(0.0, times_ms[-1])
    return figure


def _ellipse(
    axes: Axes, centre: tuple[float, float], covariance: np.ndarray, colour: str
) -> Ellipse:
    values, vectors = np.linalg.eigh(covariance)
    minor, major = 2.0 * np.sqrt(_CHI2_90 * values)
    angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
    ellipse = Ellipse(centre, major, minor, angle=angle, fill=False, color=colour, lw=1.5)
    axes.add_patch(ellipse)
    return ellipse


@click.command()
@click.option("--json", "source", type=click.Path(path_type=Path, exists=True))
@click.option("--output", type=click.Path(path_type=Path, file_okay=False))
def main(source: Path | None, output: Path | None) -> None:
    """Write the pictures."""
    folder = output or HERE / "report"
    folder.mkdir(parents=True, exist_ok=True)
    figures = json.loads((source or HERE / "accuracy.json").read_text())
    [wide] = cases.wide(1)
    with Progress(console=Console(stderr=True)) as progress, workers(progress) as pool:
        calibrating = cases.healthy(3 * HEALTHY_WINDOWS, "calibration")
        healthy = pool.map("healthy windows", noisy_window, calibrating)
        calibration = calibrate(healthy[:HEALTHY_WINDOWS], ACTUATOR)
        drawn = cases.by_the_law(CURVES // 2) + cases.wide(CURVES // 2)
        windows = pool.map("windows", noisy_window, drawn)
        repeated = [cases.Case(wide.faults, (*wide.seed, i)) for i in range(REPEATED)]
        jobs = [Job(case, [Variant(calibration, noisy=True)]) for case in repeated]
        estimates = [one for [one] in pool.estimates("repeated windows", jobs)]
    window = noisy_window(wide)
    information = Spectrum(healthy).information(bounds.jacobian(window, calibration, wide.faults))
    pictures = {
        "errors": errors_figure(figures),
        "convergence": convergence_figure(drawn, windows, calibration),
        "ellipses": ellipses_figure(
            wide.faults,
            np.array([estimate.faults for estimate in estimates]),
            np.mean([estimate.covariance for estimate in estimates], axis=0),
            bounds.bound(information, wide.faults).covariance,
        ),
        "residual": residual_figure(window, calibration),
    }
    for name, figure in pictures.items():
        figure.savefig(folder / f"{name}.png", dpi=120)
        click.echo(folder / f"{name}.png")


if __name__ == "__main__":
    main()
