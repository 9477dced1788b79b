"""Errors of the estimator: on the thesis's faults, on random ones, off the nominal plant."""

from dataclasses import dataclass
from typing import Final

import cases
import numpy as np
from cases import Case
from numpy.typing import NDArray
from trials import ACTUATOR, Job, Variant, Workers, errors_percent

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.identification.estimate import Estimate
from ema_monitor.windows.window import Window

HEALTHY_WINDOWS: Final = 20
"""Healthy windows that the nominal unit is calibrated on when its sensors are noisy."""

HEALTHY_WINDOWS_OFF: Final = 12
"""Healthy windows that each unit off its nominal parameters is calibrated on."""


@dataclass(frozen=True)
class Sizes:
    """How many cases each set has."""

    repetitions: int = 5
    random_each: int = 100
    plants: int = 10
    plays: int = 40
    healthy: int = 1000
    steps: int = 40
    spectrum: int = 120
    timed: int = 40

    @classmethod
    def quick(cls) -> "Sizes":
        """Return about a tenth of everything."""
        return cls(1, 10, 2, 4, 100, 8, 24, 6)


@dataclass(frozen=True, eq=False)
class Trial:
    """Cases and what was found in their windows."""

    cases: list[Case]
    estimates: list[Estimate]

    @property
    def errors_percent(self) -> NDArray[np.float64]:
        """Errors in percent of the range."""
        return errors_percent(self.cases, self.estimates)

    def summary(self) -> dict[str, float]:
        """Return the figures of the errors, of the evaluations, and how many were refused."""
        return {
            **quantiles(self.errors_percent),
            "cases": len(self.cases),
            "not_valid": sum(not estimate.valid for estimate in self.estimates),
            "evaluations_median": float(np.median([e.evaluations for e in self.estimates])),
        }


@dataclass(frozen=True, eq=False)
class Healthy:
    """What healthy windows of the nominal unit give: calibrations and the scatter to measure.

    Attributes
    ----------
    windows, noisy_windows
        The same windows by ideal sensors and by noisy ones.
    shipped
        Calibration that comes with the monitor.
    noisy
        Calibration on windows of noisy sensors.
    """

    windows: list[Window]
    noisy_windows: list[Window]
    shipped: Calibration
    noisy: Calibration


def healthy_unit(workers: Workers, sizes: Sizes) -> Healthy:
    """Record healthy windows of the nominal unit and calibrate on some of them."""
    pairs = workers.map("healthy windows", _pair, cases.healthy(sizes.spectrum, "calibration"))
    clean, noisy = (list(windows) for windows in zip(*pairs, strict=True))
    return Healthy(
        clean, noisy, Calibration.builtin(), calibrate_model(noisy[:HEALTHY_WINDOWS], ACTUATOR)
    )


def measure(workers: Workers, healthy: Healthy, sizes: Sizes) -> dict[str, Trial]:
    """Return the trials by name; those of the thesis's faults begin with "first" or "thesis"."""
    clean, noisy = Variant(healthy.shipped), Variant(healthy.noisy, noisy=True)
    trials = {}
    first = cases.first_cycles()
    found = workers.estimates("first cycles", [Job(case, [clean]) for case in first.values()])
    for (name, case), estimates in zip(first.items(), found, strict=True):
        trials[f"first {name}"] = Trial([case], estimates)
    repeated = cases.thesis_faults(sizes.repetitions)
    found = workers.estimates(
        "the thesis's faults", [Job(case, [clean]) for row in repeated.values() for case in row]
    )
    for number, (name, row) in enumerate(repeated.items()):
        part = found[number * len(row) : (number + 1) * len(row)]
        trials[f"thesis {name}"] = Trial(row, [estimate for [estimate] in part])

    drawn = {"law": cases.by_the_law(sizes.random_each), "wide": cases.wide(sizes.random_each)}
    for name, row in drawn.items():
        found = workers.estimates(f"random faults, {name}", [Job(c, [clean, noisy]) for c in row])
        by_variant = zip(*found, strict=True)
        for kind, estimates in zip(("", " noisy"), by_variant, strict=True):
            trials[f"{name}{kind}"] = Trial(row, list(estimates))

    plants = cases.plants(drawn["law"] + drawn["wide"], sizes.plants, HEALTHY_WINDOWS_OFF)
    calibrations = workers.map("plants, healthy", calibration_on, [p.healthy for p in plants])
    jobs = [
        Job(case, [Variant(calibration, noisy=True)])
        for plant, calibration in zip(plants, calibrations, strict=True)
        for case in plant.faulty
    ]
    found = workers.estimates("plants, faulty", jobs)
    trials["plants"] = Trial([job.case for job in jobs], [estimate for [estimate] in found])

    row = cases.without_approach(sizes.plays)
    found = workers.estimates("unknown play", [Job(case, [noisy]) for case in row])
    trials["play"] = Trial(row, [estimate for [estimate] in found])
    return trials


def quantiles(errors_percent: NDArray[np.float64]) -> dict[str, float]:
    """Return mean, median, 90th percentile and largest of errors."""
    return {
        "mean": float(np.mean(errors_percent)),
        "median": float(np.median(errors_percent)),
        "p90": float(np.quantile(errors_percent, 0.9)),
        "max": float(np.max(errors_percent)),
    }


def pooled(*trials: Trial) -> Trial:
    """Return several trials as one."""
    return Trial(
        [case for trial in trials for case in trial.cases],
        [estimate for trial in trials for estimate in trial.estimates],
    )


def noisy_window(case: Case) -> Window:
    """Return the window of a case by noisy sensors."""
    return case.window(case.telemetry(), noisy=True)


def calibration_on(healthy: list[Case]) -> Calibration:
    """Return the calibration of a unit on its healthy cases, by noisy sensors."""
    return calibrate_model([noisy_window(case) for case in healthy], ACTUATOR)


def _pair(case: Case) -> tuple[Window, Window]:
    telemetry = case.telemetry()
    return case.window(telemetry, noisy=False), case.window(telemetry, noisy=True)
