"""The Cramer-Rao bound: how exact an unbiased estimate from a window can be at best.

The noise that is really there is not only that of the sensors. The ripple of the pulse-width
modulation is chaotic: to whoever models its mean, it is noise. Its spectrum is measured as the
scatter of healthy windows about their mean, and the information of a window is summed over
frequencies (Whittle's likelihood).
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, N_FAULTS, fault_vector
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.objective import Coordinates
from ema_monitor.windows.window import Window

_STEP: Final = 5e-3
_SMOOTHED_BINS: Final = 9
_PLANE = [ECCENTRICITY, ECCENTRICITY_PHASE]


class Bound(NamedTuple):
    """What no unbiased estimator of all eight components can be below.

    Attributes
    ----------
    covariance
        Covariance of the fault vector, ``(8, 8)``; that of the phase is inf at zero eccentricity.
    error_percent
        Root mean square of the error in percent of the range.
    """

    covariance: NDArray[np.float64]
    error_percent: float

    @property
    def sigma(self) -> NDArray[np.float64]:
        """Standard deviations, ``(8,)``."""
        return np.sqrt(np.diag(self.covariance))


class Spectrum:
    """Spectrum of the noise in the current of healthy windows of the same command."""

    def __init__(self, windows: list[Window]) -> None:
        currents = np.array([window.current for window in windows])
        scatter = np.fft.rfft(currents - np.mean(currents, axis=0), axis=-1)
        power = np.sum(np.abs(scatter) ** 2, axis=0) / (len(windows) - 1)
        kernel = np.ones(_SMOOTHED_BINS) / _SMOOTHED_BINS
        cover = np.convolve(np.ones(len(power)), kernel, "same")
        self._power = np.convolve(power, kernel, "same") / cover

    def information(self, jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the Fisher information, ``(d, d)``, of derivatives of the current, ``(n, d)``."""
        transformed = np.fft.rfft(jacobian, axis=0)
        # Each bin but the first, and the last of an even number, stands for two.
        twice = np.full(len(transformed), 2.0)
        twice[0] = 1.0
        if len(jacobian) % 2 == 0:
            twice[-1] = 1.0
        weighted = transformed * (twice / self._power)[:, None]
        return np.real(transformed.conj().T @ weighted)


def jacobian(
    window: Window, calibration: Calibration, faults: tuple[float, ...]
) -> NDArray[np.float64]:
    """Return the derivatives of the model's current, ``(n, 8)`` [A].

    In the places of eccentricity and phase are ``zeta cos(phi)`` and ``zeta sin(phi)``. The
    differences are central, and one-sided at the end of a range.
    """
    play = 0.0 if window.play is None else window.play
    coordinates = Coordinates(play, cartesian=True)
    point = coordinates.encode(fault_vector(faults))
    above = np.minimum(point + _STEP * np.eye(N_FAULTS), 1.0)
    below = np.maximum(point - _STEP * np.eye(N_FAULTS), 0.0)
    current, _ = calibration.model().respond(
        window, *coordinates.decode(np.concatenate([above, below]))
    )
    steps = np.sum(above - below, axis=1)
    # Two units of a point are one of zeta cos(phi) and of zeta sin(phi).
    steps[_PLANE] *= 2.0
    return (current[:N_FAULTS] - current[N_FAULTS:]).T / steps


def bound(information: NDArray[np.float64], faults: tuple[float, ...]) -> Bound:
    """Return the bound that an information means."""
    zeta = faults[ECCENTRICITY]
    phi = (2.0 * faults[ECCENTRICITY_PHASE] - 1.0) * np.pi
    turn = np.eye(N_FAULTS)
    turn[np.ix_(_PLANE, _PLANE)] = [[np.cos(phi), np.sin(phi)], [-np.sin(phi), np.cos(phi)]]
    # Across its direction, a full turn of the eccentricity is the range.
    turn[ECCENTRICITY_PHASE] /= 2.0 * np.pi
    covariance = turn @ np.linalg.inv(information) @ turn.T
    variance = np.diag(covariance).copy()
    if zeta > 0.0:
        covariance[ECCENTRICITY_PHASE] /= zeta
        covariance[:, ECCENTRICITY_PHASE] /= zeta
    else:
        # The estimated eccentricity is the distance from zero, wherever it points.
        variance[ECCENTRICITY_PHASE] *= (2.0 * np.pi) ** 2
        covariance[ECCENTRICITY, ECCENTRICITY] = np.sum(variance[_PLANE])
        covariance[ECCENTRICITY_PHASE, ECCENTRICITY_PHASE] = np.inf
    return Bound(covariance, float(100.0 * np.sqrt(np.sum(variance))))
