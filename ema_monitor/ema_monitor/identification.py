"""Identification: from a window of telemetry to the faults that explain it."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
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
from ema_monitor.estimate import Estimate, Settings, refusal
from ema_monitor.fitness import WEIGHTS
from ema_monitor.model import MonitorModel
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import minimise
from ema_monitor.residual import band_limited, rms
from ema_monitor.uncertainty import CORRELATION_S, sandwich_covariance, uncertainty_of_faults
from ema_monitor.window import Window

POOR_FIT: Final = 5.0
"""Goodness of fit beyond which an estimate says that something else may be wrong [-]."""

UNEXPLAINED: Final = 15.0
"""Goodness of fit beyond which an estimate is not valid: something else is wrong [-]."""

_DIFFERENCE = 5e-3


@dataclass(frozen=True, eq=False)
class Generation:
    """Where an identification stands after a generation."""

    generation: int
    evaluations: int
    fitness: float
    faults: NDArray[np.float64]


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
        self._shift = 0
        self.estimate: Estimate | None = None

    def __iter__(self) -> Iterator[Generation]:
        """Yield the progress after each generation."""
        started = time.perf_counter()
        refused, caveats = self._objections()
        if refused:
            self.estimate = self._refuse(refused)
            return
        self._shift = self._calibration.alignment(self._window)
        optimizer_class = ALGORITHMS[self._settings.algorithm]
        coordinates = Coordinates(self._window.play, cartesian=optimizer_class.uses_residuals)
        start = coordinates.encode(healthy_faults())
        optimizer = optimizer_class(start, np.random.default_rng(self._settings.seed))
        progress = None
        for progress in minimise(
            lambda points: self._residuals(*coordinates.decode(points)) * self._weights,
            optimizer,
            self._settings.termination,
            reserve=_conclusion_evaluations(start),
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
        return self._window.current - self._calibration.apply(modelled, self._shift)

    def _refuse(self, reason: str) -> Estimate:
        return refusal(
            self._window.start_ns,
            self._window.end_ns,
            self._settings,
            self._calibration.calibration_id,
            reason,
            self._window.excitation,
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
        explained = not goodness > UNEXPLAINED
        if goodness > POOR_FIT:
            verdict = "may not be all that is wrong" if explained else "do not explain it"
            caveats = [
                *caveats,
                f"the residual is {goodness:.1f} times that of a healthy actuator: the eight "
                f"faults {verdict}",
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
            excitation=self._window.excitation,
            evaluations=evaluations + _conclusion_evaluations(point),
            computing_time_s=time.perf_counter() - started,
            valid=explained,
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


def _conclusion_evaluations(point: NDArray[np.float64]) -> int:
    """Return how many evaluations the central differences about a point and itself take."""
    return 2 * len(point) + 1


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
