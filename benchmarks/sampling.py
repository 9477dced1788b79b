"""What rate, sampling of the current and missing columns cost: errors, verdicts and intervals.

    python benchmarks/sampling.py [--json FILE] [--vectors N] [--seed S]

The same random faults, half by the thesis's law and half wide, are simulated with each acquisition
of the telemetry and noisy sensors, windows are found in it, and each is identified with a
calibration on twelve healthy cycles that were acquired alike. The weights and
limits were set with seeds 1 to 4.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from cases import CURRENT_NOISE, RESOLUTIONS, wide_faults
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from tables import target_table
from targets import Row, at_least, at_most
from trials import Workers, command, difference, workers

from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_core.faults import estimation_error, healthy_faults, random_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim import simulate

_HEALTHY: Final = 12
_HALF_WIDTH: Final = 1.96

ACQUISITIONS: Final = {
    "10 kHz, mean": ActuatorDescription(),
    "1 kHz, mean": ActuatorDescription(sample_period=1e-3),
    "500 Hz, mean": ActuatorDescription(sample_period=2e-3),
    "1 kHz, filtered, 1 ms": ActuatorDescription(
        sample_period=1e-3, acquisition=Acquisition("filtered", 1e-3)
    ),
    "1 kHz, instantaneous": ActuatorDescription(
        sample_period=1e-3, acquisition=Acquisition("instantaneous")
    ),
    "500 Hz, instantaneous": ActuatorDescription(
        sample_period=2e-3, acquisition=Acquisition("instantaneous")
    ),
    "200 Hz, mean": ActuatorDescription(sample_period=5e-3),
    "1 kHz, no speed": ActuatorDescription(
        sample_period=1e-3, acquisition=Acquisition(speed=False)
    ),
    "1 kHz, no current": ActuatorDescription(sample_period=1e-3, acquisition=Acquisition("none")),
}
"""Acquisitions by name, each of the built-in actuator."""


class _Recording(NamedTuple):
    """What is simulated: an actuator with faults, ``(8,)``, in some test cycles."""

    description: ActuatorDescription
    faults: NDArray[np.float64]
    cycles: int
    seed: int


class _Task(NamedTuple):
    """A window to be identified."""

    window: Window
    description: ActuatorDescription
    calibration: Calibration


def _record(recording: _Recording) -> list[Window]:
    description = recording.description
    missing = description.acquisition.missing
    telemetry = simulate(
        recording.faults,
        recording.cycles,
        description=description,
        current_noise=0.0 if "current" in missing else CURRENT_NOISE,
        resolutions={name: size for name, size in RESOLUTIONS.items() if name not in missing},
        seed=recording.seed,
    )
    found = WindowFinder(TriggerSettings(), description).feed(telemetry)
    windows = [one.window for one in found if isinstance(one, Segment)]
    usable = [window for window in windows if isinstance(window, Window)]
    if len(usable) != recording.cycles:
        raise RuntimeError(f"{recording}: {len(usable)} windows")
    return usable


def _identify(task: _Task) -> Estimate:
    return identify(*task)


def measure(progress: Progress, vectors: int, seed: int) -> dict[str, Any]:
    """Print the figures of each acquisition, of so many faults."""
    rng = np.random.default_rng([20_160, seed])
    truths = [(wide_faults if i % 2 else random_faults)(rng) for i in range(vectors)]
    with workers(progress) as pool:
        return {name: _figures(pool, name, truths, seed) for name in ACQUISITIONS}


def _figures(
    pool: Workers, name: str, truths: list[NDArray[np.float64]], seed: int
) -> dict[str, Any]:
    description = ACQUISITIONS[name]
    first = 1000 * seed
    halves = [_Recording(description, healthy_faults(), _HEALTHY // 2, first + i) for i in (0, 1)]
    healthy = pool.map(f"{name}: healthy", _record, halves)
    calibration = calibrate_model([one for windows in healthy for one in windows], description)
    recordings = [
        _Recording(description, faults, 1, first + 2 + i) for i, faults in enumerate(truths)
    ]
    windows = [one for [one] in pool.map(f"{name}: windows", _record, recordings)]
    tasks = [_Task(window, description, calibration) for window in windows]
    estimates = pool.map(f"{name}: estimates", _identify, tasks)
    errors = [estimation_error(one.faults, k) for one, k in zip(estimates, truths, strict=True)]
    sigmas = np.array([one.sigma for one in estimates])
    distances = np.abs(
        [difference(one.faults, k) for one, k in zip(estimates, truths, strict=True)]
    )
    shown = np.isfinite(sigmas)
    return {
        "median_percent": float(np.median(errors)),
        "p90_percent": float(np.quantile(errors, 0.9)),
        "largest_percent": float(np.max(errors)),
        "valid": float(np.mean([one.valid for one in estimates])),
        "fit_within_limit": float(
            np.mean([one.goodness_of_fit <= one.goodness_limit for one in estimates])
        ),
        "told_apart": float(np.mean([not one.alternatives for one in estimates])),
        "covers": float(np.mean(distances[shown] <= _HALF_WIDTH * sigmas[shown])),
        "sigma_short_circuit_percent": float(100.0 * np.nanmedian(sigmas[:, 2:5])),
        "sigma_friction_percent": float(100.0 * np.nanmedian(sigmas[:, 0])),
        "scatter_A": calibration.healthy_rms,
        "scatter_rad_s": calibration.healthy_speed_rms,
    }


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the table."""
    table = Table(
        *("telemetry", "median [%]", "90th", "largest", "valid [%]", "fit in limit [%]"),
        *("told apart [%]", "95 % covers [%]", "sigma: short [%]", "friction [%]"),
        title="rate, sampling of the current, missing columns",
    )
    for name in ACQUISITIONS:
        one = figures[name]
        table.add_row(
            name,
            *(f"{one[f'{key}_percent']:.2f}" for key in ("median", "p90", "largest")),
            *(
                f"{100.0 * one[key]:.1f}"
                for key in ("valid", "fit_within_limit", "told_apart", "covers")
            ),
            *(f"{one[f'sigma_{key}_percent']:.2f}" for key in ("short_circuit", "friction")),
        )
    console.print(table)
    console.print(target_table("targets", rows(figures), ""))


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows of the targets."""
    median = figures["1 kHz, mean"]["median_percent"]
    valid = 100.0 * figures["500 Hz, mean"]["valid"]
    covers = 100.0 * figures["1 kHz, instantaneous"]["covers"]
    return [
        at_most("telemetry of 1 kHz, mean: median error [%]", median, 0.7),
        at_least("500 Hz, mean: estimates valid [%]", valid, 99.0, f"{valid:.1f}"),
        at_least("1 kHz, instantaneous: 95 % intervals cover [%]", covers, 85.0, f"{covers:.1f}"),
    ]


main = command(measure, show, 160, vectors=100, seed=11)

if __name__ == "__main__":
    main()
