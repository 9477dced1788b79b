"""What each step towards fidelity is worth: the estimator without it, on a validation set."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, NamedTuple

import cases
import numpy as np
from exactness import HEALTHY_WINDOWS, HEALTHY_WINDOWS_OFF, Sizes, noisy_window, quantiles
from trials import ACTUATOR, Job, Variant, Workers, errors_percent

from ema_core.faults import healthy_faults
from ema_monitor.calibration.alignment import moved, shift_between
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.model.deviations import NAMES
from ema_monitor.windows.window import Window


class Step(NamedTuple):
    """A step that can be left out: how, in the calibration and in the settings."""

    name: str
    calibrated: Callable[[Calibration, list[Window]], Calibration]
    settings: SearchSettings = SearchSettings()


def _as_it_is(calibration: Calibration, windows: list[Window]) -> Calibration:
    return calibration


def _without_rows(calibration: Calibration, windows: list[Window]) -> Calibration:
    nothing = np.zeros_like(calibration.correction)
    return replace(calibration, correction=nothing, speed_correction=nothing)


def _with_structure(**structure: float) -> Callable[[Calibration, list[Window]], Calibration]:
    """Return a calibration with some structural figures given and its rows taken anew."""

    def calibrated(calibration: Calibration, windows: list[Window]) -> Calibration:
        changed = replace(calibration, unit=calibration.unit._replace(**structure))
        model, missed = changed.model(), []
        for window in windows:
            response = model.respond(window, healthy_faults(), window.play or 0.0)
            shift = shift_between(window.command, changed.command, window.telemetry.sample_period)
            measured = (window.current, window.telemetry.speed[1:])
            missed.append(
                [moved(row - one[0], -shift) for row, one in zip(measured, response, strict=True)]
            )
        correction, speed_correction = np.mean(missed, axis=0)
        return replace(changed, correction=correction, speed_correction=speed_correction)

    return calibrated


STEPS: Final = (
    Step("all steps", _as_it_is),
    Step("without the lift of the idle phase", _with_structure(lift=0.0)),
    Step(
        "without the unit's own friction and inertia",
        _with_structure(friction=0.0, inertia=0.0),
    ),
    Step("without the correction rows", _without_rows),
    Step(
        "correction rows only (the thesis's calibration)",
        _with_structure(**dict.fromkeys(NAMES, 0.0)),
    ),
    Step("fitness: total least squares", _as_it_is, SearchSettings(fitness="total_least_squares")),
    Step("fitness: least squares", _as_it_is, SearchSettings(fitness="least_squares")),
    Step(
        "without putting insignificant faults back", _as_it_is, SearchSettings(parsimonious=False)
    ),
)
"""The method, and the method without one step each."""


def measure(workers: Workers, sizes: Sizes) -> dict[str, dict[str, Any]]:
    """Return median, 90th percentile and largest error of each step's absence, by set of cases.

    The nominal unit and units off their nominal parameters; all sensors are noisy.
    """
    faulty = cases.validation(sizes.ablation_each)
    plants = cases.plants(faulty, sizes.plants, HEALTHY_WINDOWS_OFF)
    nominal = cases.Plant(cases.healthy(HEALTHY_WINDOWS, "calibration"), faulty)
    units = {"nominal": [nominal], "plants": plants}
    results: dict[str, dict[str, Any]] = {step.name: {} for step in STEPS}
    for name, members in units.items():
        variants = workers.map(f"ablation, calibrations: {name}", _variants, members)
        jobs = [
            Job(case, by_step)
            for unit, by_step in zip(members, variants, strict=True)
            for case in unit.faulty
        ]
        found = workers.estimates(f"ablation: {name}", jobs)
        for step, estimates in zip(STEPS, zip(*found, strict=True), strict=True):
            errors = errors_percent([job.case for job in jobs], estimates)
            results[step.name][name] = quantiles(errors)
    return results


def _variants(unit: cases.Plant) -> list[Variant]:
    windows = [noisy_window(case) for case in unit.healthy]
    calibration = calibrate(windows, ACTUATOR)
    return [Variant(step.calibrated(calibration, windows), True, step.settings) for step in STEPS]
