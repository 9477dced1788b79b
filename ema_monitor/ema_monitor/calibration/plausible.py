"""Whether a calibration is plausible for the description of its unit."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.model.deviations import unit_priors
from ema_monitor.windows.band import band_limited, rms
from ema_monitor.windows.window import Window

PLAUSIBLE_SIGMAS: Final = 3.5
"""Standard deviations of a deviation, as expected of a unit, up to which it is plausible."""

PLAUSIBLE_SHARE: Final = 0.1
"""Share of the current that the model of a plausible unit may miss: 1 to 4 % of healthy ones."""


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
        Of the unit.
    window
        A window of the calibration.

    Notes
    -----
    Deviations that a fault is taken for are compared with those expected of a unit. What the model
    misses, without the correction and the scatter between windows, is compared with the current: a
    worn unit may need faults that are no deviation, such as play.
    """
    return "; ".join(_reasons(calibration, window))


def _reasons(calibration: Calibration, window: Window) -> Iterator[str]:
    priors = unit_priors(calibration.parameters, window.excitation, calibration.form)
    for one in priors:
        value = getattr(calibration.unit, one.name)
        if one.name in FAULTY and abs(value - one.expected) > PLAUSIBLE_SIGMAS * one.sigma:
            name = one.name.replace("_", " ")
            yield f"{name} is {value:+.3g}, expected {one.expected:.2g} ± {one.sigma:.2g}"
    share = _missed_share(calibration, window)
    if share > PLAUSIBLE_SHARE:
        yield (
            f"the model misses {100.0 * share:.0f} % of the current, at most "
            f"{100.0 * PLAUSIBLE_SHARE:.0f} % is expected"
        )


def _missed_share(calibration: Calibration, window: Window) -> float:
    """Return the share of the current that the model misses in all windows; NaN if unknown."""
    if not np.any(calibration.unit_covariance) or not len(window.telemetry.current):
        return math.nan
    current = rms(band_limited(window.telemetry.current[None, 1:], window.sample_period)[0])
    scatter = np.nan_to_num(calibration.healthy_rms)
    missed = math.sqrt(max(0.0, calibration.model_rms**2 - scatter**2))
    return missed / current
