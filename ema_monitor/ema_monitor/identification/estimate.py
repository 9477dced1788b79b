"""The estimate of the faults in a window, or the refusal of one."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import N_FAULTS
from ema_monitor.identification.settings import SearchSettings


@dataclass(frozen=True, eq=False)
class Estimate:
    """What was found in a window.

    Attributes
    ----------
    start_ns, end_ns
        Stamps of the window's first and last sample [ns].
    algorithm, seed
        What it was found with.
    calibration_id
        Identity of the calibration used.
    faults
        Fault vector, ``(8,)``; NaN when none was found.
    covariance
        Its covariance, ``(8, 8)``; NaN in rows and columns of unobservable components.
    unobservable
        Components that the window says nothing useful about, ``(8,)``.
    play
        Where in its play the motor stood at the start [half-widths].
    fitness
        Cost at the estimate [A^2.s].
    goodness_of_fit
        Rms of the band-limited residual over that of a healthy actuator, the larger of current and
        speed [-]; NaN when the calibration does not tell the latter.
    goodness_limit
        Goodness of fit up to which the faults explain the window [-].
    excitation
        Travel of the command [rad].
    evaluations
        Windows of the model that were computed.
    computing_time_s
        Time from window to estimate [s].
    valid
        Whether the estimate may be used.
    reason
        Why not, or what to keep in mind.
    insignificant
        Components put back to healthy because the window does not show that they differ, ``(8,)``.
    warm_start
        Whether the search began at the faults of an earlier window.
    calibration_windows
        Number of healthy windows that the calibration rests on; 0 when there was none.
    """

    start_ns: int
    end_ns: int
    algorithm: str
    seed: int
    calibration_id: str
    faults: NDArray[np.float64]
    covariance: NDArray[np.float64]
    unobservable: NDArray[np.bool_]
    play: float
    fitness: float
    goodness_of_fit: float
    goodness_limit: float
    excitation: float
    evaluations: int
    computing_time_s: float
    valid: bool
    reason: str
    insignificant: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(N_FAULTS, dtype=bool))
    warm_start: bool = False
    calibration_windows: int = 0

    @property
    def sigma(self) -> NDArray[np.float64]:
        """Standard deviations, ``(8,)``; NaN where unobservable."""
        return np.sqrt(np.diag(self.covariance))


def refusal(
    start_ns: int,
    end_ns: int,
    settings: SearchSettings,
    calibration_id: str,
    reason: str,
    excitation: float = float("nan"),
    calibration_windows: int = 0,
) -> Estimate:
    """Return the estimate of a window that none can be made of.

    Parameters
    ----------
    start_ns, end_ns
        Stamps of the window [ns].
    settings
        What would have been used.
    calibration_id
        Identity of the calibration.
    reason
        Why there is no estimate.
    excitation
        Travel of the command [rad]; NaN where there is no window.
    calibration_windows
        Number of healthy windows that the calibration rests on.
    """
    nan = float("nan")
    return Estimate(
        start_ns,
        end_ns,
        settings.algorithm,
        settings.seed,
        calibration_id,
        faults=np.full(N_FAULTS, nan),
        covariance=np.full((N_FAULTS, N_FAULTS), nan),
        unobservable=np.ones(N_FAULTS, dtype=bool),
        play=nan,
        fitness=nan,
        goodness_of_fit=nan,
        goodness_limit=settings.goodness_limit,
        excitation=excitation,
        evaluations=0,
        computing_time_s=0.0,
        valid=False,
        reason=reason,
        calibration_windows=calibration_windows,
    )
