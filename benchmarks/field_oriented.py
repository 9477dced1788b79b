"""Accuracy with a sinusoidal motor under field-oriented control, beside six-step commutation.

    python benchmarks/field_oriented.py [--json FILE] [--quick]

The same faults, motion, mechanics and sensors in both drives: the thesis's cases, its law, and
faults in all components at once, by ideal and by noisy sensors. Each drive is calibrated on 20
healthy windows of noisy sensors. Prints a table and writes JSON.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import cases
import numpy as np
from cases import Case
from exactness import HEALTHY_WINDOWS, Trial, noisy_window, quantiles
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from tables import target_table
from targets import Row, at_least, at_most
from trials import Workers, command, difference, workers

from ema_core.description import ActuatorDescription
from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate

_K_T: Final = math.sqrt(3.0) / 2.0 * ActuatorParameters().k_e
DESCRIPTIONS: Final = {
    "six_step": ActuatorDescription(),
    "field_oriented": ActuatorDescription(
        serial_number="SIM-F",
        drive="field_oriented",
        parameters=ActuatorParameters(k_t=_K_T, T_max=_K_T * ActuatorParameters().I_max),
    ),
}
_Z: Final = 1.645
_SMALLEST_ZETA: Final = 0.05
_MEDIAN_TARGET_PERCENT: Final = 0.5


@dataclass(frozen=True, eq=False)
class Task:
    """A case, and with which calibration to look at its window."""

    case: Case
    calibration: Calibration
    noisy: bool


def of_drive(case: Case, drive: str) -> Case:
    """Return a case with another drive."""
    return replace(case, drive=drive, plant=DESCRIPTIONS[drive].parameters)


def estimate(task: Task) -> Estimate:
    """Simulate and identify."""
    window = task.case.window(task.case.telemetry(), noisy=task.noisy)
    return identify(window, DESCRIPTIONS[task.case.drive], task.calibration)


def measure(progress: Progress, each: int, repetitions: int) -> dict[str, Any]:
    """Print the figures by drive, set and sensors, with so many cases of each set."""
    sets = {
        **cases.thesis_faults(repetitions),
        "law": cases.by_the_law(each),
        "wide": cases.wide(each),
        "healthy": cases.healthy(each),
    }
    figures: dict[str, Any] = {}
    with workers(progress) as pool:
        for drive, description in DESCRIPTIONS.items():
            healthy = [of_drive(c, drive) for c in cases.healthy(HEALTHY_WINDOWS, "calibration")]
            windows = pool.map(f"{drive}, healthy", noisy_window, healthy)
            calibration = calibrate_model(windows, description)
            for noisy in (False, True):
                sensors = "noisy" if noisy else "ideal"
                for name, some in sets.items():
                    trial = _trial(pool, f"{drive}, {name}", some, drive, calibration, noisy)
                    figures.setdefault(name, {}).setdefault(drive, {})[sensors] = _summary(trial)
    return figures


def _trial(
    pool: Workers, what: str, some: list[Case], drive: str, calibration: Calibration, noisy: bool
) -> Trial:
    tasks = [Task(of_drive(case, drive), calibration, noisy) for case in some]
    return Trial(some, pool.map(what, estimate, tasks))


def _summary(trial: Trial) -> dict[str, float]:
    """Return errors, share of intervals that cover, refusals and false alarms."""
    truth = np.array([case.faults for case in trial.cases])
    sigma = np.array([one.sigma for one in trial.estimates])
    pairs = zip(trial.estimates, trial.cases, strict=True)
    away = np.array([difference(one.faults, case.faults) for one, case in pairs])
    known = np.isfinite(sigma)
    known[:, ECCENTRICITY_PHASE] &= truth[:, ECCENTRICITY] > _SMALLEST_ZETA
    # What is not significant is put back to healthy.
    claimed = sum(not np.array_equal(one.faults, healthy_faults()) for one in trial.estimates)
    return {
        **quantiles(trial.errors_percent),
        "covered": float(np.mean((np.abs(away) <= _Z * sigma)[known])),
        "refused": sum(one.verdict == "refused" for one in trial.estimates),
        "degraded": sum(one.verdict == "degraded" for one in trial.estimates),
        "claimed": claimed,
        "cases": len(trial.cases),
    }


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return the targets of the field-oriented drive beside the same of six-step commutation."""
    found = []
    for name, sensors in (("law", "ideal"), ("law", "noisy"), ("wide", "ideal"), ("wide", "noisy")):
        mine, other = (figures[name][drive][sensors] for drive in ("field_oriented", "six_step"))
        what = f"field-oriented, {name}, {sensors} sensors: median error [%]"
        measured = f"{mine['median']:.2f} (six-step {other['median']:.2f})"
        found.append(at_most(what, mine["median"], _MEDIAN_TARGET_PERCENT, measured))
    covered = figures["wide"]["field_oriented"]["noisy"]["covered"]
    alarms = figures["healthy"]["field_oriented"]["noisy"]
    share = alarms["claimed"] / alarms["cases"]
    found += [
        at_least("  90 % intervals cover, wide, noisy sensors", covered, 0.85),
        at_most("  healthy, a fault is claimed", share, 0.05, f"{share:.3f}"),
    ]
    return found


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the tables."""
    console.print(target_table("field-oriented drive", rows(figures)))
    table = Table(
        "faults",
        *(
            f"{drive}\n{sensors}: {what}"
            for drive in ("six-step", "field-or.")
            for sensors in ("ideal", "noisy")
            for what in ("median", "worst")
        ),
        *(
            f"{what}\n{drive}"
            for what in ("covers", "degraded")
            for drive in ("six-st.", "field-o.")
        ),
        title="errors [% of the range]; share of 90 % intervals that cover, and of degraded "
        "estimates, noisy sensors",
    )
    for name, by_drive in figures.items():
        if name == "duration_s":
            continue
        values = [
            f"{by_drive[drive][sensors][what]:.2f}"
            for drive in DESCRIPTIONS
            for sensors in ("ideal", "noisy")
            for what in ("median", "max")
        ]
        noisy = [by_drive[drive]["noisy"] for drive in DESCRIPTIONS]
        covers = [f"{one['covered']:.2f}" for one in noisy]
        degraded = [f"{one['degraded'] / one['cases']:.2f}" for one in noisy]
        table.add_row(name, *values, *covers, *degraded)
    console.print(table)


main = command(measure, show, 160, quick={"each": 10, "repetitions": 1}, each=100, repetitions=5)

if __name__ == "__main__":
    main()
