# SPDX-License-Identifier: Apache-2.0
"""Accuracy with field-oriented control of a sinusoidal motor, compared with six-step commutation.

    python benchmarks/field_oriented.py [--json FILE] [--quick]

Both drives have the same faults, motion, mechanics and sensors: the thesis's cases, faults drawn by
its law, and faults in all components, with ideal and with noisy sensors. Each drive is calibrated
on healthy windows of noisy sensors. Prints a table and writes JSON.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import cases
import numpy as np
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_least, at_most, grid
from trials import HEALTHY_WINDOWS, Trial, Variant, noisy_window, trials

from ema_core.description import ActuatorDescription
from ema_core.faults import healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.fit import calibrate_model

_K_T: Final = math.sqrt(3.0) / 2.0 * ActuatorParameters().k_e
DESCRIPTIONS: Final = {
    "six_step": ActuatorDescription(),
    "field_oriented": ActuatorDescription(
        serial_number="SIM-F",
        drive="field_oriented",
        parameters=ActuatorParameters(k_t=_K_T, T_max=_K_T * ActuatorParameters().I_max),
    ),
}
_MEDIAN_TARGET_PERCENT: Final = 0.5


def measure(pool: Workers, each: int, repetitions: int) -> Figures:
    """Measure the accuracy by drive, set of cases and sensors."""
    sets = {
        **cases.thesis_faults(repetitions),
        "law": cases.by_the_law(each),
        "wide": cases.wide(each),
        "healthy": cases.healthy(each),
    }
    figures: Figures = {}
    for drive, description in DESCRIPTIONS.items():
        changes = {"drive": drive, "plant": description.parameters}
        healthy = cases.healthy(HEALTHY_WINDOWS, "calibration")
        healthy = [replace(case, **changes) for case in healthy]
        windows = pool.map(f"{drive}, healthy", noisy_window, healthy)
        calibration = calibrate_model(windows, description)
        variants = [Variant(calibration, noisy, description=description) for noisy in (False, True)]
        for name, chosen in sets.items():
            results = trials(
                pool, f"{drive}, {name}", [replace(case, **changes) for case in chosen], variants
            )
            by_drive = figures.setdefault(name, {})
            by_drive[drive] = dict(zip(("ideal", "noisy"), map(_summary, results), strict=True))
    return figures


def _summary(trial: Trial) -> Figures:
    # The estimator resets insignificant faults to healthy.
    claimed = np.any(trial.faults != healthy_faults(), axis=1)
    return trial.summary() | {"covered": trial.coverage(), "claimed": int(np.sum(claimed))}


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the targets of the field-oriented drive, compared with six-step commutation."""
    for name, sensors in (("law", "ideal"), ("law", "noisy"), ("wide", "ideal"), ("wide", "noisy")):
        errors, six_step = (
            figures[name][drive][sensors] for drive in ("field_oriented", "six_step")
        )
        what = f"field-oriented, {name}, {sensors} sensors: median error [%]"
        measured = f"{errors['median']:.2f} (six-step {six_step['median']:.2f})"
        yield at_most(what, errors["median"], _MEDIAN_TARGET_PERCENT, measured)
    covered = figures["wide"]["field_oriented"]["noisy"]["covered"]
    yield at_least("  90 % intervals cover, wide, noisy sensors", covered, 0.85)
    alarms = figures["healthy"]["field_oriented"]["noisy"]
    share = alarms["claimed"] / alarms["cases"]
    yield at_most("  healthy, a fault is claimed", share, 0.05, f"{share:.3f}")


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print below the targets."""
    ways = [(drive, sensors) for drive in DESCRIPTIONS for sensors in ("ideal", "noisy")]
    yield grid(
        "errors [% of the range]; share of 90 % intervals that cover, and of degraded estimates",
        (
            "faults",
            *(
                f"{drive[:9]}\n{sensors}: {what}"
                for drive, sensors in ways
                for what in ("median", "worst", "covers", "degraded")
            ),
        ),
        (
            (
                name,
                *(
                    f"{value:.2f}"
                    for drive, sensors in ways
                    for entry in [by_drive[drive][sensors]]
                    for value in (
                        *(entry["median"], entry["max"], entry["covered"]),
                        entry["verdicts"]["degraded"] / entry["cases"],
                    )
                ),
            )
            for name, by_drive in figures.items()
        ),
    )


main = command(
    measure,
    "field-oriented drive",
    rows,
    tables,
    width=180,
    quick={"each": 10, "repetitions": 1},
    each=100,
    repetitions=5,
)

if __name__ == "__main__":
    main()
