"""Plausibility of a calibration, given the description of its unit."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.model.deviations import unit_priors
from ema_monitor.windows.band import band_limited, rms
from ema_monitor.windows.window import Window

PLAUSIBLE_SIGMAS: Final = 3.5
"""Largest plausible distance of a deviation from its expected value [prior sigma]."""

PLAUSIBLE_SHARE: Final = 0.1
"""Largest plausible share of the current that the model does not explain [-].

Healthy units have 0.01 to 0.04."""


FAULTY: Final = (
    "friction",
    "backlash",
    "loop_gain",
    "turns_a",
    "turns_b",
    "turns_c",
    "eccentricity_cos",
    "eccentricity_sin",
)
"""Deviations that can be mistaken for a fault."""


def implausible(calibration: Calibration, window: Window) -> str:
    """Return why a calibration is implausible for its description; "" if it is plausible.

    Parameters
    ----------
    calibration
        Calibration of the unit.
    window
        One of the windows that the calibration was fitted to.

    Notes
    -----
    The function compares the deviations in `FAULTY` with their priors. It also compares the
    residual of the uncorrected model, without the scatter between windows, with the current: the
    faults of a worn unit may not correspond to any deviation.
    """
    return "; ".join(_reasons(calibration, window))


def _reasons(calibration: Calibration, window: Window) -> Iterator[str]:
    priors = unit_priors(calibration.parameters, window.excitation, calibration.form)
    for prior in priors:
        value = getattr(calibration.unit, prior.name)
        if prior.name in FAULTY and abs(value - prior.expected) > PLAUSIBLE_SIGMAS * prior.sigma:
            name = prior.name.replace("_", " ")
            yield f"{name} is {value:+.3g}, expected {prior.expected:.2g} ± {prior.sigma:.2g}"
    share = _missed_share(calibration, window)
    if share > PLAUSIBLE_SHARE:
        yield (
            f"the model misses {100.0 * share:.0f} % of the current, at most "
            f"{100.0 * PLAUSIBLE_SHARE:.0f} % is expected"
        )


def _missed_share(calibration: Calibration, window: Window) -> float:
    """Return the unexplained share of the current over all windows; NaN if unknown."""
    if not np.any(calibration.unit_covariance) or not len(window.telemetry.current):
        return math.nan
    current = rms(band_limited(window.telemetry.current[None, 1:], window.sample_period)[0])
    scatter = np.nan_to_num(calibration.healthy_rms)
    missed = math.sqrt(max(0.0, calibration.model_rms**2 - scatter**2))
    return missed / current
