"""From the optimum of a search to the estimate: significance, uncertainty, goodness of fit."""

import math
import time
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import (
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    FAULTS,
    N_FAULTS,
    SHORT_CIRCUITS,
    FaultVector,
    healthy_faults,
)
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.objective import Linearisation, Objective
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.uncertainty import (
    CORRELATION_S,
    MISMATCH_SIGMA,
    refitted,
    sandwich_covariance,
    significant_components,
    uncertainty_of_faults,
)
from ema_monitor.model.monitor_model import Response
from ema_monitor.windows.band import band_limited, rms
from ema_monitor.windows.window import Window

_STRONG_CORRELATION = 0.95
_MOST_LOSS = 1.1


class Inference:
    """Makes the estimate from the optimum that a search of a window found.

    Parameters
    ----------
    window
        The window.
    calibration
        Calibration of the model.
    settings
        How it was identified.
    """

    def __init__(self, window: Window, calibration: Calibration, settings: SearchSettings) -> None:
        self._window = window
        self._calibration = calibration
        self._settings = settings
        self._objective = Objective(window, calibration, settings.fitness, cartesian=True)
        self._lags = max(1, round(CORRELATION_S / self._objective.spacing))
        # Two units of a point are one of zeta cos(phi), zeta sin(phi) and of the play.
        self._span = np.ones(len(self._objective.healthy))
        self._span[[ECCENTRICITY, ECCENTRICITY_PHASE]] = 2.0
        self._span[N_FAULTS:] = 2.0

    @property
    def most_evaluations(self) -> int:
        """Largest number of model evaluations that an estimate needs."""
        return 3 * self._objective.linearisation_evaluations + 1

    def estimate(
        self,
        faults: NDArray[np.float64],
        play: float,
        evaluations: int,
        caveats: list[str],
        started: float,
        *,
        warm_start: bool,
    ) -> Estimate:
        """Return the estimate.

        Parameters
        ----------
        faults, play
            The optimum, ``(8,)``, and the motor's place in its play there [half-widths].
        evaluations
            Number of model evaluations of the search.
        caveats
            Reservations about the estimate so far.
        started
            When the identification began, by ``time.perf_counter`` [s].
        warm_start
            Whether the search began at earlier faults.

        Raises
        ------
        numpy.linalg.LinAlgError
            When the covariance cannot be computed.
        """
        objective, window = self._objective, self._window
        at, kept, rounds = self._without_insignificant(objective.encode(faults, play))
        optimum, plays = objective.decode(at.point[None])
        faults = optimum[0]
        covariance = sandwich_covariance(at.jacobian / self._span, at.residuals, self._lags)
        goodness = self._goodness_of_fit(objective.expect(optimum, plays))
        covariance, unobservable = uncertainty_of_faults(faults, covariance, goodness)
        phase_unknown = unobservable & (np.arange(N_FAULTS) == ECCENTRICITY_PHASE)
        caveats = [*caveats, *_correlated(covariance)]
        if np.isnan(goodness):
            caveats.append(
                "the fit cannot be judged: the healthy windows of the calibration "
                f"({self._calibration.windows}) do not give their scatter"
            )
        limit = goodness_limit(faults, self._settings.goodness_limit)
        defects = []
        if goodness > limit:
            defects.append(
                f"none of the eight faults explains the window: the residual is {goodness:.1f} "
                f"times that of a healthy actuator, at most {limit:.1f} is expected"
            )
        if np.all(unobservable | (np.arange(N_FAULTS) == ECCENTRICITY_PHASE)):
            defects.append("no excitation: the window determines no fault better than its range")
        return Estimate(
            window.start_ns,
            window.end_ns,
            self._settings.algorithm,
            self._settings.seed,
            self._calibration.calibration_id,
            faults=FaultVector.of(np.where(phase_unknown, healthy_faults(), faults)),
            covariance=covariance,
            unobservable=unobservable,
            play=float(plays[0]),
            fitness=at.cost,
            goodness_of_fit=goodness,
            goodness_limit=limit,
            excitation=window.excitation,
            evaluations=evaluations + rounds * objective.linearisation_evaluations + 1,
            computing_time_s=time.perf_counter() - started,
            valid=not defects,
            reason="; ".join([*caveats, *defects]),
            insignificant=~kept[:N_FAULTS],
            warm_start=warm_start,
            calibration_windows=self._calibration.windows,
        )

    def _goodness_of_fit(self, expected: Response) -> float:
        """Return how many times larger than when healthy the residual of current or speed is."""
        window, calibration = self._window, self._calibration
        missed = np.array(
            [window.current - expected.current[0], window.telemetry.speed[1:] - expected.speed[0]]
        )
        current, speed = band_limited(missed, window.sample_period)
        # Where one scatter is unknown, the other judges.
        return float(
            np.fmax(
                rms(current) / calibration.healthy_rms,
                rms(speed) / calibration.healthy_speed_rms,
            )
        )

    def _without_insignificant(
        self, point: NDArray[np.float64]
    ) -> tuple[Linearisation, NDArray[np.bool_], int]:
        """Set insignificant components to healthy and fit the others anew.

        Return the linearisation there, the components kept, and the number of linearisations.
        """
        objective = self._objective
        at = objective.linearise(point)
        if not self._settings.parsimonious:
            return at, np.ones(len(point), dtype=bool), 1
        floor = np.zeros(len(point))
        floor[:N_FAULTS] = MISMATCH_SIGMA
        kept, point = significant_components(
            at.point,
            objective.healthy,
            at.residuals,
            at.jacobian,
            self._lags,
            floor / self._span,
        )
        if np.all(kept):
            return at, kept, 1
        optimum, at = at, objective.linearise(point)
        if at.cost > _MOST_LOSS * optimum.cost:
            return optimum, np.ones(len(point), dtype=bool), 2
        point = refitted(at.point, objective.healthy, at.residuals, at.jacobian, kept)
        again = objective.linearise(point)
        return (again if again.cost < at.cost else at), kept, 3


def _correlated(covariance: NDArray[np.float64]) -> list[str]:
    """Return in words which components of an estimate are strongly correlated."""
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    return [
        f"{FAULTS[i].label} and {FAULTS[j].label} are strongly correlated ({correlation[i, j]:.2f})"
        for i, j in combinations(range(N_FAULTS), 2)
        if abs(correlation[i, j]) > _STRONG_CORRELATION
    ]


def goodness_limit(faults: NDArray[np.float64], limit: float) -> float:
    """Return the goodness of fit up to which faults, ``(8,)``, explain a window.

    The fewer turns a phase has left, the less inductance holds its ripple, which no model of the
    mean current can match.

    Parameters
    ----------
    faults
        Estimate.
    limit
        That of a motor without short circuit.
    """
    most_shorted = float(np.max(faults[SHORT_CIRCUITS]))
    return limit / math.sqrt(1.0 - most_shorted)
