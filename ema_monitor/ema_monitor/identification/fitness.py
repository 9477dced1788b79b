# SPDX-License-Identifier: Apache-2.0
"""Distance measures between modelled and measured response, as rows of residuals.

The cost is the sum of squares of a row. Therefore a row serves both algorithms that minimise a cost
and algorithms that use residuals.
"""

from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.model.monitor_model import Response
from ema_monitor.windows.band import BAND_CORRELATION, band_limited, band_samples, rms, speed_weight
from ema_monitor.windows.window import Window

_SLOW_SHARE = 0.5
_ROBUST_SCALE = 2.0
_UNKNOWN_SCATTER = 0.05
# Scatter of 1 ms means with a noisy current sensor, relative to the hysteresis half-band.
_MEAN_SCATTER = 0.08
_GOOD_COST = 3.0

Scatter = tuple[float, float]


class LeastSquares:
    """Difference of measured and modelled current (eq. 6.3 of the thesis, times the period).

    All other distance measures derive from this class and have the same parameters.

    Parameters
    ----------
    window
        The window to explain.
    calibration
        Calibration of the actuator, with the acquisition of its telemetry.
    scatter
        Rms residuals of current and speed in a healthy window [A, rad/s].

    Attributes
    ----------
    spacing
        Time between two residuals [s].
    weights
        Weights of the values of a row [-].
    good_cost
        Highest cost at which an optimum is accepted as global [A^2.s]; 0 if unknown.
    noise
        Cost of the noise of a healthy window per effective residual [A^2.s]; 0 if unknown.
    effective
        Number of effective residuals: cost of a healthy window over ``noise``; 0 if unknown.
    """

    good_cost = 0.0
    noise = 0.0
    effective = 0.0

    def __init__(self, window: Window, calibration: Calibration, scatter: Scatter) -> None:
        self.spacing = window.sample_period
        self._measured = window.current
        self.weights = np.full(len(window), np.sqrt(self.spacing))

    def residuals(self, expected: Response) -> Array:
        """Return the residuals of expected responses, ``(m, r)`` [A.s^(1/2)]."""
        return (self._measured - expected.current) * self.weights


class TotalLeastSquares(LeastSquares):
    """Distance between currents perpendicular to the measured curve, sample by sample.

    Notes
    -----
    Eq. 6.6 of the thesis, with the slope divided by its root mean square.
    """

    def __init__(self, window: Window, calibration: Calibration, scatter: Scatter) -> None:
        super().__init__(window, calibration, scatter)
        h = self.spacing
        slope = np.gradient(self._measured, h)
        typical = rms(slope)
        relative = slope / typical if typical > 0.0 else slope
        self.weights = np.sqrt(h / np.sqrt(relative**2 + 1.0))


class BandLimited(LeastSquares):
    """Band-limited difference of current and speed, robust against outliers.

    The method is described in ``docs/identification.md``, M15.

    The residuals of current and speed are low-pass filtered at about 1 kHz. The residual of the
    speed is converted to half the current that the speed loop derives from it, or less if the speed
    of a healthy actuator scatters more than its current. Each value has the weight
    ``|omega| / hypot(|omega|, omega_slow)``, where ``omega_slow`` is half the rms speed: the model
    of the mean current is least accurate when the motor is slow. Residuals beyond twice the healthy
    scatter have a lower weight (pseudo-Huber), because the mismatch of the model has heavy tails.

    A current that is not measured is ignored. An instantaneous current mostly consists of PWM
    ripple. It has at most the weight of a mean current, so that the speed dominates the cost.
    """

    def __init__(self, window: Window, calibration: Calibration, scatter: Scatter) -> None:
        parameters, sampling = calibration.parameters, calibration.acquisition.current
        self._h = h = window.sample_period
        of_current, of_speed = scatter
        stiffness = speed_weight(parameters)
        self._current_weight = 1.0
        if sampling == "none":
            # The row of the current is 0; the scatter of the speed sets the scale.
            self._current_weight, of_current = 0.0, stiffness * of_speed
        if not np.isfinite(of_current):
            of_current = _UNKNOWN_SCATTER * parameters.h_b
        if sampling == "instantaneous":
            self._current_weight = min(1.0, _MEAN_SCATTER * parameters.h_b / of_current)
            of_current *= self._current_weight
        zeros = np.zeros(len(window))
        measured = window.missed(zeros, zeros, parameters.tau)
        speed = measured[1]
        self._measured = band_limited(measured, h)
        self._scale = _ROBUST_SCALE * of_current
        excess = stiffness * of_speed / of_current
        self._stiffness = stiffness / max(1.0, excess) if np.isfinite(excess) else stiffness
        magnitude = np.abs(self._measured[1])
        slow = _SLOW_SHARE * rms(speed)
        self.weights = magnitude / np.hypot(magnitude, slow)
        self.spacing = h * band_samples(len(window), h)
        self.good_cost = _GOOD_COST * of_current**2 * h * len(window)
        self.noise = BAND_CORRELATION * self.spacing * of_current**2
        excess = self._stiffness * of_speed / of_current
        measures_current = float(self._current_weight > 0.0)
        both = measures_current + (excess**2 if np.isfinite(excess) else 1.0)
        self.effective = both * float(np.sum(self.weights**2)) / BAND_CORRELATION

    def residuals(self, expected: Response) -> Array:
        """Return the residuals of expected responses, ``(m, r)`` [A.s^(1/2)]."""
        from ema_monitor.identification.pseudo_huber import pseudo_huber  # with the compiler

        current, speed = self._measured
        distance = np.concatenate(
            [
                (current - band_limited(expected.current, self._h))
                * (self._current_weight * self.weights),
                (speed - band_limited(expected.speed, self._h)) * self.weights * self._stiffness,
            ],
            axis=-1,
        )
        return np.sqrt(self.spacing) * pseudo_huber(distance, self._scale)


DEFAULT_FITNESS: Final = "band_limited"

FITNESS: Final[dict[str, type[LeastSquares]]] = {
    "band_limited": BandLimited,
    "total_least_squares": TotalLeastSquares,
    "least_squares": LeastSquares,
}
"""Distance measures by the name used on the command line, in parameters and in messages."""
