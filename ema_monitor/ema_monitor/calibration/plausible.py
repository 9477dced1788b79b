# SPDX-License-Identifier: Apache-2.0
"""Plausibility check of a calibration against the description of its unit."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from ema_core.labels import label_of
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.model.deviations import unit_priors
from ema_monitor.windows.band import band_limited, rms
from ema_monitor.windows.window import Window

PLAUSIBLE_SIGMAS: Final = 3.5
"""Largest plausible distance of a deviation from its expected value [sigma of the prior]."""

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
    """Return the reason why a calibration is implausible; empty if it is plausible.

    Parameters
    ----------
    calibration
        Calibration of the unit.
    window
        One of the windows that the calibration was fitted to.

    Notes
    -----
    The deviations in `FAULTY` are compared with their priors. In addition, the residual of the
    uncorrected model, less the scatter between windows, is compared with the current, because the
    faults of a worn unit may not correspond to any deviation.
    """
    return "; ".join(_reasons(calibration, window))


def _reasons(calibration: Calibration, window: Window) -> Iterator[str]:
    priors = unit_priors(calibration.parameters, window.excitation, calibration.form)
    for prior in priors:
        value = getattr(calibration.unit, prior.name)
        if prior.name in FAULTY and abs(value - prior.expected) > PLAUSIBLE_SIGMAS * prior.sigma:
            label = label_of(prior.name)
            yield f"{label} is {value:+.3g}, expected {prior.expected:.2g} ± {prior.sigma:.2g}"
    share = _unexplained_share(calibration, window)
    if share > PLAUSIBLE_SHARE:
        yield (
            f"the model does not explain {100.0 * share:.0f} % of the current, expected at most "
            f"{100.0 * PLAUSIBLE_SHARE:.0f} %"
        )


def _unexplained_share(calibration: Calibration, window: Window) -> float:
    """Return the share of the current that the model does not explain; NaN if unknown."""
    if not np.any(calibration.unit_covariance) or not len(window.telemetry.current):
        return math.nan
    current = rms(band_limited(window.telemetry.current[None, 1:], window.sample_period)[0])
    scatter = np.nan_to_num(calibration.healthy_rms)
    unexplained = math.sqrt(max(0.0, calibration.model_rms**2 - scatter**2))
    return unexplained / current
