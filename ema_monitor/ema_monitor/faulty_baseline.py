# SPDX-License-Identifier: Apache-2.0
"""Detection of calibration windows that a fault explains as well as a healthy unit does."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from ema_core.description import ActuatorDescription
from ema_core.faults import FAULT_BY_NAME
from ema_core.levels import ERROR
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.health import HealthLimits, assess
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.search import ModelIdentification
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.model.deviations import Deviations
from ema_monitor.windows.window import Window

WORST_RATIO: Final = 2.0
"""Largest cost ratio at which a fault explains a window as well as a healthy unit does [-].

The ratio is the cost of a unit with the fault, divided by the cost of a healthy unit with
deviations.

Measured ratios are 0.4 to 1.5 for a phase shorted by 45 to 60 %, and 1.0 to 5 for 18 healthy units,
which show no fault beyond its limit."""

_WINDOWS: Final = 2


def fault_instead(
    calibration: Calibration, windows: Sequence[Window], description: ActuatorDescription
) -> str:
    """Return a phrase naming a fault that would explain calibration windows; "" if none would.

    The deviations of a calibration may have absorbed a fault. The described unit with faults is
    therefore compared with the fitted healthy unit. A fault counts if, in each compared window, it
    exceeds its limit and the cost ratio is at most ``WORST_RATIO``.

    Parameters
    ----------
    calibration
        Calibration that was fitted to the windows.
    windows
        Windows of the calibration, at least one; the first two are compared.
    description
        Description of the unit.
    """
    fitted = calibration.of_any_motion()
    nominal = replace(fitted, unit=Deviations())
    faulty: list[tuple[Estimate, str]] = []
    for window in windows[:_WINDOWS]:
        healthy = _estimate(window, description, fitted)
        estimate = _estimate(window, description, nominal)
        if not estimate.valid or estimate.fitness > WORST_RATIO * healthy.fitness:
            return ""
        health = assess(estimate, HealthLimits())
        if health.level != ERROR:
            return ""
        faulty.append((estimate, health.dominant_fault))
    estimate, name = faulty[0]
    if name not in FAULT_BY_NAME:
        return ""
    label, value = FAULT_BY_NAME[name].label, getattr(estimate.faults, name)
    return f"{label} {value:.2g} would explain them as well"


def _estimate(
    window: Window, description: ActuatorDescription, calibration: Calibration
) -> Estimate:
    return ModelIdentification(
        window, description, calibration, SearchSettings(), False, None
    ).estimate()
