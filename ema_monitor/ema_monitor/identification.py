"""Identification: from a window of telemetry to the faults that explain it."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.description import ActuatorDescription
from ema_core.faults import (
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    FAULTS,
    N_FAULTS,
    SHORT_CIRCUITS,
    fault_vector,
    healthy_faults,
)
from ema_monitor.calibration import Calibration
from ema_monitor.estimate import Estimate, Settings, refusal
from ema_monitor.model import Response
from ema_monitor.objective import Linearisation, Objective
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import minimise
from ema_monitor.residual import band_limited, rms
from ema_monitor.significance import refitted, significant_components
from ema_monitor.uncertainty import CORRELATION_S, sandwich_covariance, uncertainty_of_faults
from ema_monitor.window import Window

_TRADED = 0.95
_MOST_LOSS = 1.1


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
    previous
        Faults found in an earlier window, ``(8,)``: the search begins there.
    """

    def __init__(
        self,
        window: Window,
        description: ActuatorDescription,
        calibration: Calibration,
        settings: Settings,
        *,
        force: bool = False,
        previous: ArrayLike | None = None,
    ) -> None:
        self._window = window
        self._description = description
        self._force = force
        self._calibration = calibration
        self._settings = settings
        self._previous = None if previous is None else fault_vector(previous)
        self.estimate: Estimate | None = None

    def __iter__(self) -> Iterator[Generation]:
        """Yield the progress after each generation."""
        started = time.perf_counter()
        refused, caveats = self._objections()
        if refused:
            self.estimate = self._refuse(refused)
            return
        settings = self._settings
        optimizer_class = ALGORITHMS[settings.algorithm]
        objective = Objective(
            self._window,
            self._calibration,
            settings.fitness,
            cartesian=optimizer_class.uses_residuals,
        )
        warm = self._previous is not None
        start = objective.healthy if self._previous is None else objective.encode(self._previous)
        hints = {"good_cost": objective.good_cost}
        optimizer = optimizer_class(
            start,
            np.random.default_rng(settings.seed),
            **(hints if optimizer_class.uses_residuals else {}),
        )
        conclusion = _Conclusion(self._window, self._calibration, settings)
        progress = None
        for progress in minimise(
            objective.residuals,
            optimizer,
            settings.termination,
            reserve=conclusion.most_evaluations,
        ):
            faults, _ = objective.decode(progress.point[None])
            yield Generation(progress.generation, progress.evaluations, progress.cost, faults[0])
        if progress is None or not np.isfinite(progress.cost):
            self.estimate = self._refuse("no fault vector gave a finite cost")
            return
        faults, play = objective.decode(progress.point[None])
        if optimizer_class.uses_residuals and not optimizer.converged:
            caveats.append("the search was stopped before it converged")
        try:
            self.estimate = conclusion.draw(
                faults[0], float(play[0]), progress.evaluations, caveats, started, warm_start=warm
            )
        except np.linalg.LinAlgError as error:
            self.estimate = self._refuse(f"the uncertainty cannot be computed: {error}")

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

    def _refuse(self, reason: str) -> Estimate:
        return refusal(
            self._window.start_ns,
            self._window.end_ns,
            self._settings,
            self._calibration.calibration_id,
            reason,
            self._window.excitation,
            self._calibration.windows,
        )


class _Conclusion:
    """From where a search ended to the estimate: what is significant, how sure, how good a fit."""

    def __init__(self, window: Window, calibration: Calibration, settings: Settings) -> None:
        self._window = window
        self._calibration = calibration
        self._settings = settings
        self._objective = Objective(window, calibration, settings.fitness, cartesian=True)
        self._lags = max(1, round(CORRELATION_S / self._objective.spacing))

    @property
    def most_evaluations(self) -> int:
        """Largest number of evaluations that it takes."""
        return 3 * self._objective.linearisation_evaluations + 1

    def draw(
        self,
        faults: NDArray[np.float64],
        play: float,
        evaluations: int,
        caveats: list[str],
        started: float,
        *,
        warm_start: bool,
    ) -> Estimate:
        """Return the estimate."""
        objective, window = self._objective, self._window
        at, shown, rounds = self._settle(objective.encode(faults, play))
        found, plays = objective.decode(at.point[None])
        # Two units of a point are one of zeta cos(phi), zeta sin(phi) and of the play.
        span = np.ones(len(at.point))
        span[[ECCENTRICITY, ECCENTRICITY_PHASE]] = 2.0
        span[N_FAULTS:] = 2.0
        covariance = sandwich_covariance(at.jacobian / span, at.residuals, self._lags)
        goodness = self._goodness_of_fit(objective.expect(found, plays))
        covariance, unobservable = uncertainty_of_faults(found[0], covariance, goodness)
        phase_unknown = unobservable & (np.arange(N_FAULTS) == ECCENTRICITY_PHASE)
        caveats = [*caveats, *_traded(covariance)]
        if np.isnan(goodness):
            caveats.append(
                "the fit cannot be judged: the healthy windows of the calibration "
                f"({self._calibration.windows}) do not tell their scatter"
            )
        limit = goodness_limit(found[0], self._settings.goodness_limit)
        defects = []
        if goodness > limit:
            defects.append(
                f"none of the eight faults explains the window: the residual is {goodness:.1f} "
                f"times that of a healthy actuator, at most {limit:.1f} is expected"
            )
        if np.all(unobservable | (np.arange(N_FAULTS) == ECCENTRICITY_PHASE)):
            defects.append(
                "no excitation: the window tells no fault more closely than its range does"
            )
        return Estimate(
            window.start_ns,
            window.end_ns,
            self._settings.algorithm,
            self._settings.seed,
            self._calibration.calibration_id,
            faults=np.where(phase_unknown, healthy_faults(), found[0]),
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
            insignificant=~shown[:N_FAULTS],
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

    def _settle(self, point: NDArray[np.float64]) -> tuple[Linearisation, NDArray[np.bool_], int]:
        """Put insignificant components back to healthy.

        Return where that leads, which components it kept, and how many linearisations it took.
        """
        objective = self._objective
        at = objective.linearise(point)
        if not self._settings.parsimonious:
            return at, np.ones(len(point), dtype=bool), 1
        shown, point = significant_components(
            at.point, objective.healthy, at.residuals, at.jacobian, self._lags
        )
        if np.all(shown):
            return at, shown, 1
        optimum, at = at, objective.linearise(point)
        if at.cost > _MOST_LOSS * optimum.cost:
            return optimum, np.ones(len(point), dtype=bool), 2
        point = refitted(at.point, objective.healthy, at.residuals, at.jacobian, shown)
        again = objective.linearise(point)
        return (again if again.cost < at.cost else at), shown, 3


def _traded(covariance: NDArray[np.float64]) -> list[str]:
    """Return which components of an estimate trade with each other."""
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    return [
        f"{FAULTS[i].label} and {FAULTS[j].label} trade with each other "
        f"(correlation {correlation[i, j]:.2f})"
        for i, j in combinations(range(N_FAULTS), 2)
        if abs(correlation[i, j]) > _TRADED
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
    return limit / np.sqrt(1.0 - most_shorted)


def identify(
    window: Window,
    description: ActuatorDescription,
    calibration: Calibration,
    settings: Settings | None = None,
    *,
    force: bool = False,
    previous: ArrayLike | None = None,
) -> Estimate:
    """Identify the faults in a window, without progress.

    Parameters
    ----------
    window, description, calibration, settings, force, previous
        As of ``Identification``.
    """
    identification = Identification(
        window,
        description,
        calibration,
        settings or Settings(),
        force=force,
        previous=previous,
    )
    for _ in identification:
        pass
    if identification.estimate is None:
        raise RuntimeError("the identification ended without an estimate")
    return identification.estimate
