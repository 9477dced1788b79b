# SPDX-License-Identifier: Apache-2.0
"""Effect of sample rate, current sampling and missing columns on errors, verdicts and intervals.

    python benchmarks/sampling.py [--json FILE] [--vectors N] [--seed S]

The same random faults, half by the thesis's law and half wide, are simulated with noisy sensors and
with each acquisition of the telemetry. Each window is identified with a calibration on twelve
healthy cycles of the same acquisition. The weights and limits were tuned with seeds 1 to 4.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from cases import CURRENT_NOISE, RESOLUTIONS, wide_faults
from numpy.typing import NDArray
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_least, at_most, grid, percent
from trials import Trial, mean

from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_core.faults import SHORT_CIRCUITS, healthy_faults, random_faults
from ema_monitor.api import find_windows
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.windows.window import Window
from ema_sim import simulate

_HEALTHY: Final = 12

ACQUISITIONS: Final = {
    name: ActuatorDescription(sample_period=period, acquisition=acquisition)
    for name, period, acquisition in (
        ("10 kHz, mean", 1e-4, Acquisition()),
        ("1 kHz, mean", 1e-3, Acquisition()),
        ("500 Hz, mean", 2e-3, Acquisition()),
        ("1 kHz, filtered, 1 ms", 1e-3, Acquisition("filtered", 1e-3)),
        ("1 kHz, instantaneous", 1e-3, Acquisition("instantaneous")),
        ("500 Hz, instantaneous", 2e-3, Acquisition("instantaneous")),
        ("200 Hz, mean", 5e-3, Acquisition()),
        ("1 kHz, no speed", 1e-3, Acquisition(speed=False)),
        ("1 kHz, no current", 1e-3, Acquisition("none")),
    )
}
"""Descriptions of the built-in actuator by name of the acquisition."""


class _Recording(NamedTuple):
    """An actuator with faults, ``(8,)``, to simulate in a number of test cycles."""

    description: ActuatorDescription
    faults: NDArray[np.float64]
    cycles: int
    seed: int

    def windows(self) -> list[Window]:
        missing = self.description.acquisition.missing
        telemetry = simulate(
            self.faults,
            self.cycles,
            description=self.description,
            current_noise=0.0 if "current" in missing else CURRENT_NOISE,
            resolutions={name: size for name, size in RESOLUTIONS.items() if name not in missing},
            seed=self.seed,
        )
        windows = find_windows(telemetry, self.description)
        if len(windows) != self.cycles:
            raise RuntimeError(f"{self}: {len(windows)} windows")
        return windows


def _estimate(work: tuple[_Recording, Calibration]) -> Estimate:
    recording, calibration = work
    return identify(recording.windows()[0], recording.description, calibration)


def measure(pool: Workers, vectors: int, seed: int) -> Figures:
    """Measure the accuracy with each acquisition."""
    rng = np.random.default_rng([20_160, seed])
    truths = [(wide_faults if i % 2 else random_faults)(rng) for i in range(vectors)]
    figures, first = {}, 1000 * seed
    for name, description in ACQUISITIONS.items():
        halves = [
            _Recording(description, healthy_faults(), _HEALTHY // 2, first + i) for i in (0, 1)
        ]
        healthy = pool.map(f"{name}: healthy", _Recording.windows, halves)
        calibration = calibrate_model(
            [window for windows in healthy for window in windows], description
        )
        work = [
            (_Recording(description, faults, 1, first + 2 + i), calibration)
            for i, faults in enumerate(truths)
        ]
        estimates = pool.map(f"{name}: estimates", _estimate, work)
        trial = Trial.of(truths, estimates)
        fit = [estimate.goodness_of_fit <= estimate.goodness_limit for estimate in estimates]
        figures[name] = trial.summary() | {
            "valid": mean([estimate.valid for estimate in estimates]),
            "fit_within_limit": mean(fit),
            "separated": mean([not estimate.alternatives for estimate in estimates]),
            "covers": trial.coverage(),
            "sigma_short_circuit": float(np.nanmedian(trial.sigma[:, SHORT_CIRCUITS])),
            "sigma_friction": float(np.nanmedian(trial.sigma[:, 0])),
        }
    return figures


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    median = figures["1 kHz, mean"]["median"]
    yield at_most("telemetry of 1 kHz, mean: median error [%]", median, 0.7)
    valid = 100.0 * figures["500 Hz, mean"]["valid"]
    yield at_least("500 Hz, mean: estimates valid [%]", valid, 99.0, f"{valid:.1f}")
    covers = 100.0 * figures["1 kHz, instantaneous"]["covers"]
    what = "1 kHz, instantaneous: 90 % intervals cover [%]"
    yield at_least(what, covers, 85.0, f"{covers:.1f}")


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print below the targets."""
    shares = ("valid", "fit_within_limit", "separated", "covers")
    yield grid(
        "rate, sampling of the current, missing columns",
        (
            *("telemetry", "median [%]", "90th", "largest", "valid [%]", "fit in limit [%]"),
            *("separated [%]", "90 % covers [%]", "sigma: short [%]", "friction [%]"),
        ),
        (
            (
                name,
                *(f"{entry[key]:.2f}" for key in ("median", "p90", "max")),
                *(percent(entry[key], 1) for key in shares),
                percent(entry["sigma_short_circuit"], 2),
                percent(entry["sigma_friction"], 2),
            )
            for name, entry in figures.items()
        ),
    )


main = command(measure, "telemetry", rows, tables, width=160, vectors=100, seed=11)

if __name__ == "__main__":
    main()
