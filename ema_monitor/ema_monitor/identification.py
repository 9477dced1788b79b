"""Identification: from a window of telemetry to the faults that explain it."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.faults import (
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    N_FAULTS,
    healthy_faults,
)
from ema_monitor.calibration import Calibration
from ema_monitor.coordinates import Coordinates
from ema_monitor.fitness import WEIGHTS
from ema_monitor.model import MonitorModel
from ema_monitor.optimizers import ALGORITHMS, DEFAULT_ALGORITHM
from ema_monitor.optimizers.driver import Termination, minimise
from ema_monitor.residual import band_limited, rms
from ema_monitor.uncertainty import CORRELATION_S, sandwich_covariance, uncertainty_of_faults
from ema_monitor.window import Window

POOR_FIT: Final = 5.0
"""Goodness of fit beyond which an estimate says that something else may be wrong [-]."""

_DIFFERENCE = 5e-3


@dataclass(frozen=True)
class Settings:
    """How to identify.

    Attributes
    ----------
    algorithm
        Registered name.
    fitness
        "total_least_squares" or "least_squares".
    termination
        When to stop.
    seed
        Seed of the algorithm's random numbers.

    Raises
    ------
    ValueError
        When a name is unknown or the seed negative.
    """

    algorithm: str = DEFAULT_ALGORITHM
    fitness: str = "total_least_squares"
    termination: Termination = field(default_factory=Termination)
    seed: int = 0

    def __post_init__(self) -> None:
        if self.algorithm not in ALGORITHMS:
            raise ValueError(
                f"algorithm {self.algorithm!r} is unknown; known: {', '.join(ALGORITHMS)}"
            )
        if self.fitness not in WEIGHTS:
            raise ValueError(f"fitness {self.fitness!r} is unknown; known: {', '.join(WEIGHTS)}")
        if self.seed < 0:
            raise ValueError(f"seed = {self.seed}: expected a whole number of at least 0")


@dataclass(frozen=True)
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
        Rms of the band-limited residual over that of a healthy actuator [-]; NaN when the
        calibration does not tell the latter.
    evaluations
        Windows of the model that were computed.
    computing_time_s
        Time from window to estimate [s].
    valid
        Whether the estimate may be used.
    reason
        Why not, or what to keep in mind.
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
    evaluations: int
    computing_time_s: float
    valid: bool
    reason: str

    @property
    def sigma(self) -> NDArray[np.float64]:
        """Standard deviations, ``(8,)``; NaN where unobservable."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class Generation:
    """Where an identification stands after a generation."""

    generation: int
    evaluations: int
    fitness: float
    faults: NDArray[np.float64]


def refusal(
    start_ns: int, end_ns: int, settings: Settings, calibration_id: str, reason: str
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
        evaluations=0,
        computing_time_s=0.0,
        valid=False,
        reason=reason,
    )


class Identification:
    """One identification: iterate over its generations, then read ``estimate``.

    Parameters
    ----------
    window
        The window to be diagnosed.
    description
        The actuator it was taken from.
    calibration
        Calibration of the model. If it does not belong to that actuator or to the window's
        command, the estimate is refused.
    settings
        How to identify.
    force
        Make an estimate all the same; it says so in its reason.
    """

    def __init__(
        self,
        window: Window,
        description: ActuatorDescription,
        calibration: Calibration,
        settings: Settings,
        *,
        force: bool = False,
    ) -> None:
        self._window = window
        self._description = description
        self._force = force
        self._calibration = calibration
        self._settings = settings
        self._model: MonitorModel = calibration.model()
        self._weights = WEIGHTS[settings.fitness](window.current, window.sample_period)
        self.estimate: Estimate | None = None

    def __iter__(self) -> Iterator[Generation]:
        """Yield the progress after each generation."""
        started = time.perf_counter()
        refused, caveats = self._objections()
        if refused:
            self.estimate = self._refuse(refused)
            return
        optimizer_class = ALGORITHMS[self._settings.algorithm]
        coordinates = Coordinates(self._window.play, cartesian=optimizer_class.uses_residuals)
        optimizer = optimizer_class(
            coordinates.encode(healthy_faults()), np.random.default_rng(self._settings.seed)
        )
        progress = None
        for progress in minimise(
            lambda points: self._residuals(*coordinates.decode(points)) * self._weights,
            optimizer,
            self._settings.termination,
        ):
            faults, play = coordinates.decode(progress.point[None])
            yield Generation(progress.generation, progress.evaluations, progress.cost, faults[0])
        if progress is None or not np.isfinite(progress.cost):
            self.estimate = self._refuse("no fault vector gave a finite cost")
            return
        faults, play = coordinates.decode(progress.point[None])
        self.estimate = self._conclude(
            faults[0], float(play[0]), progress.cost, progress.evaluations, caveats, started
        )

    def _objections(self) -> tuple[str, list[str]]:
        """Return why no estimate can be made, and what an estimate must be read with."""
        calibration, window = self._calibration, self._window
        if reason := calibration.shape_mismatch(window) or window.excitation_defect():
            return reason, []
        doubts = [
            calibration.unit_mismatch(self._description),
            calibration.command_mismatch(window),
        ]
        doubts = [doubt for doubt in doubts if doubt]
        if doubts and not self._force:
            return "the calibration does not fit: " + "; ".join(doubts), []
        return "", [f"forced although {doubt}" for doubt in doubts]

    def _residuals(
        self, faults: NDArray[np.float64], play: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return measured less modelled and corrected current, ``(m, n)`` [A]."""
        modelled = self._model.current(self._window, faults, play)
        return self._window.current - self._calibration.apply(modelled)

    def _refuse(self, reason: str) -> Estimate:
        return refusal(
            self._window.start_ns,
            self._window.end_ns,
            self._settings,
            self._calibration.calibration_id,
            reason,
        )

    def _conclude(
        self,
        faults: NDArray[np.float64],
        play: float,
        fitness: float,
        evaluations: int,
        caveats: list[str],
        started: float,
    ) -> Estimate:
        coordinates = Coordinates(self._window.play, cartesian=True)
        point = coordinates.encode(faults, play)
        jacobian, at_point = self._jacobian(coordinates, point)
        # Two units of a point are one of zeta cos(phi), zeta sin(phi) and of the play.
        span = np.ones(len(point))
        span[[ECCENTRICITY, ECCENTRICITY_PHASE]] = 2.0
        span[N_FAULTS:] = 2.0
        h = self._window.sample_period
        covariance = sandwich_covariance(
            jacobian / span * self._weights[:, None],
            at_point * self._weights,
            round(CORRELATION_S / h),
        )
        covariance, unobservable = uncertainty_of_faults(faults, covariance)
        faults = np.where(unobservable & (np.arange(N_FAULTS) == ECCENTRICITY_PHASE), 0.5, faults)
        goodness = rms(band_limited(at_point, h)) / self._calibration.healthy_rms
        if goodness > POOR_FIT:
            caveats = [
                *caveats,
                f"the residual is {goodness:.1f} times that of a healthy actuator: the eight "
                "faults may not be all that is wrong",
            ]
        return Estimate(
            self._window.start_ns,
            self._window.end_ns,
            self._settings.algorithm,
            self._settings.seed,
            self._calibration.calibration_id,
            faults=faults,
            covariance=covariance,
            unobservable=unobservable,
            play=play,
            fitness=fitness,
            goodness_of_fit=goodness,
            evaluations=evaluations + 2 * len(point) + 1,
            computing_time_s=time.perf_counter() - started,
            valid=True,
            reason="; ".join(caveats),
        )

    def _jacobian(
        self, coordinates: Coordinates, point: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return derivatives, ``(n, d)``, and values, ``(n,)``, of the residuals at a point."""
        below = np.maximum(point - _DIFFERENCE * np.eye(len(point)), 0.0)
        above = np.minimum(point + _DIFFERENCE * np.eye(len(point)), 1.0)
        residuals = self._residuals(
            *coordinates.decode(np.concatenate([point[None], below, above]))
        )
        at_point, at_below, at_above = np.split(residuals, [1, 1 + len(point)])
        steps = np.sum(above - below, axis=1)
        return (at_above - at_below).T / steps, at_point[0]


def identify(
    window: Window,
    description: ActuatorDescription,
    calibration: Calibration,
    settings: Settings | None = None,
    *,
    force: bool = False,
) -> Estimate:
    """Identify the faults in a window, without progress.

    Parameters
    ----------
    window, description, calibration, settings, force
        As of ``Identification``.
    """
    identification = Identification(
        window, description, calibration, settings or Settings(), force=force
    )
    for _ in identification:
        pass
    if identification.estimate is None:
        raise RuntimeError("the identification ended without an estimate")
    return identification.estimate
