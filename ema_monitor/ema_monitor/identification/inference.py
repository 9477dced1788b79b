"""From the optimum of a search to the estimate: significance, uncertainty, goodness of fit."""

import math
import time

import numpy as np
from numpy.typing import NDArray

from ema_core.causes import CauseEstimate
from ema_core.faults import (
    ECCENTRICITY_PHASE,
    N_FAULTS,
    FaultVector,
    healthy_faults,
)
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.explained import Explanation, Precision
from ema_monitor.identification.explanation import Explainer
from ema_monitor.identification.fitness import DEFAULT_FITNESS
from ema_monitor.identification.knowledge import NOTHING_KNOWN, Before, Knowledge, surprise
from ema_monitor.identification.objective import Objective
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.uncertainty import (
    CORRELATION_S,
    MISMATCH_FACTOR,
    MISMATCH_SIGMA,
    SIGNIFICANT_CAUSE,
    SPANS,
    shifts_of,
    uncertainty_of_faults,
    with_mismatch,
)
from ema_monitor.identification.verdict import (
    Misfit,
    assumed_goodness,
    correlated,
    goodness_limit,
    judged,
    resting_on_unit,
)
from ema_monitor.model.measured import expected_causes
from ema_monitor.model.monitor_model import LEARNS_UNIT, Response
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.window import Window


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
    before
        What is known before the window; nothing by default.
    """

    def __init__(
        self,
        window: Window,
        calibration: Calibration,
        settings: SearchSettings,
        before: Before = NOTHING_KNOWN,
    ) -> None:
        self._window = window
        self._calibration = calibration
        self._settings = settings
        # The other measures of distance know no noise that priors could be weighed against; and
        # what is never put back to healthy leaves nothing for causes to stand in for.
        causes = ()
        if settings.fitness == DEFAULT_FITNESS:
            causes = before.causes(calibration.parameters, window)
            if calibration.form in LEARNS_UNIT and settings.parsimonious:
                causes = expected_causes(
                    calibration.parameters,
                    window.excitation,
                    window.measured,
                    window.telemetry.missing,
                )
        self._before = before
        self._fitted = before.fitted(window)
        self._measured = {one.name: one for one in window.measured}
        self._objective = Objective(
            window,
            calibration,
            settings.fitness,
            cartesian=True,
            causes=causes,
            known=before.known,
        )
        self.knowledge: Knowledge | None = None
        self.misfit: Misfit | None = None
        self.unlearned: list[str] = []
        self.surprise = 0.0
        self._lags = max(1, round(CORRELATION_S / self._objective.spacing))
        # Of one unit of a point: the play changes by 2.
        self._span = np.ones(len(self._objective.healthy))
        self._span[:N_FAULTS] = SPANS
        if window.play is None:
            self._span[N_FAULTS] = 2.0

    @property
    def most_evaluations(self) -> int:
        """Number of model evaluations that an estimate needs where no hidden cause is suspected."""
        objective = self._objective
        return 3 * objective.linearisation_evaluations + objective.unit_evaluations + 2

    def estimate(
        self,
        faults: NDArray[np.float64],
        play: float,
        evaluations: int,
        caveats: list[str],
        started: float,
        *,
        warm_start: bool,
        fitted: NDArray[np.float64],
    ) -> Estimate:
        """Return the estimate; ``knowledge`` is then what is known after the window.

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
        fitted
            The causes that always are components at the optimum, in the unit box.

        Raises
        ------
        numpy.linalg.LinAlgError
            When the covariance cannot be computed.
        """
        objective, window = self._objective, self._window
        floor = np.zeros(objective.dimension)
        floor[:N_FAULTS] = MISMATCH_SIGMA
        explainer = Explainer(
            objective,
            self._lags,
            floor / self._span,
            parsimonious=self._settings.parsimonious,
            most_evaluations=(
                self._settings.termination.budget - evaluations - objective.unit_evaluations - 2
            ),
            nuisances=self._fitted,
            seeds={} if self._before.nuisances else {"position_offset": (window.start_offset,)},
        )
        optimum = objective.encode(faults, play)
        optimum[self._always] = fitted
        explanation = explainer.explain(optimum)
        at, kept = explanation.at, explanation.kept
        optimum, plays = objective.decode(at.point[None])
        faults = optimum[0]
        self.misfit = self._misfit(objective.expect(np.stack([at.point, objective.healthy])))
        goodness = self.misfit.goodness
        known = explainer.precision.uncertainty(explanation) * np.outer(self._span, self._span)
        if self._before.nuisances:
            self.knowledge, gained = explainer.precision.knowledge(explanation)
            if self._before.known is not None:
                self.surprise = surprise(self._before.known, self.knowledge, gained)
        covariance, unobservable = uncertainty_of_faults(
            faults, known, assumed_goodness(faults, goodness)
        )
        phase_unknown = unobservable & (np.arange(N_FAULTS) == ECCENTRICITY_PHASE)
        causes = self._causes(explanation, known)
        self.unlearned = self._unlearned(explainer.precision, explanation, known)
        limit = goodness_limit(faults, self._settings.goodness_limit)
        verdict = judged(
            self._before.subject,
            self.misfit,
            limit,
            unobservable,
            explanation.alternatives,
            [*caveats, *correlated(covariance, kept), *self.unlearned, *map(str, causes)],
            self._calibration.windows,
        )
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
            fitness=objective.window_cost(at.residuals),
            goodness_of_fit=goodness,
            goodness_limit=limit,
            excitation=window.excitation,
            evaluations=evaluations + objective.evaluations,
            computing_time_s=time.perf_counter() - started,
            valid=verdict.name != "refused",
            reason=verdict.reason,
            insignificant=~kept[:N_FAULTS],
            warm_start=warm_start,
            calibration_windows=self._calibration.windows,
            verdict=verdict.name,
            unexplained_share=self.misfit.share,
            causes=causes,
            alternatives=tuple(explanation.alternatives),
            measured=window.measured,
        )

    def _causes(
        self, explanation: Explanation, covariance: NDArray[np.float64]
    ) -> tuple[CauseEstimate, ...]:
        """Return the hidden causes that are part of the explanation."""
        objective, at = self._objective, explanation.at
        first = objective.dimension - len(objective.hidden_causes)
        found = [
            CauseEstimate(
                one.cause.name,
                float(value),
                # Two reaches are one unit of a point.
                MISMATCH_FACTOR * 2.0 * one.reach * math.sqrt(covariance[first + i, first + i]),
            )
            for i, (one, value) in enumerate(
                zip(objective.hidden_causes, objective.causes(at.point), strict=True)
            )
            if explanation.kept[first + i]
        ]
        return tuple(cause for cause in found if self._is_news(cause))

    def _unlearned(
        self, precision: Precision, explanation: Explanation, covariance: NDArray[np.float64]
    ) -> list[str]:
        """Return in words which faults are uncertain for what the calibration could not learn."""
        at, kept = explanation.at, explanation.kept
        # At the healthy point it does not matter.
        if not np.any(kept[:N_FAULTS]) or not self._calibration.not_learned:
            return []
        steps = self._objective.unit_steps
        shown = kept | precision.alone
        shifts = np.zeros((len(kept), len(steps)))
        shifts[shown] = shifts_of(at.jacobian[:, shown], precision.effects(at)[:, : len(steps)])
        shifts = MISMATCH_FACTOR * self._span[:, None] * shifts
        sigma = np.sqrt(np.diag(with_mismatch(covariance[:N_FAULTS, :N_FAULTS], MISMATCH_SIGMA)))
        return resting_on_unit(sigma, shifts[:N_FAULTS], steps, self._calibration.not_learned)

    def _is_news(self, cause: CauseEstimate) -> bool:
        """Return whether a cause differs significantly from what was expected of it."""
        if measured := self._measured.get(cause.name):
            # Of both, the window and the measurement, it cannot be known less well than of one.
            return abs(cause.value - measured.value) > SIGNIFICANT_CAUSE * measured.sigma
        if cause.name in self._before.nuisances:
            return abs(cause.value) > SIGNIFICANT_CAUSE * cause.sigma
        return True

    @property
    def _always(self) -> list[int]:
        """Numbers of the components that are causes which always take part, in their order."""
        names = [one.name for one in self._objective.hidden_causes]
        first = self._objective.dimension - len(names)
        return [first + i for i, name in enumerate(names) if name in self._fitted]

    def _misfit(self, expected: Response) -> Misfit:
        """Return what is missed at the estimate and at the healthy point.

        Parameters
        ----------
        expected
            Response at the two, ``(2, n)`` each.
        """
        window = self._window
        missed = window.missed(*expected, self._calibration.parameters.tau)
        squares = band_limited(missed, window.sample_period) ** 2
        # Ordinary motion dwells, where neither model nor fit says what current flows.
        weights = self._objective.weights**2 if self._before.nuisances else None
        in_band = np.average(squares, axis=-1, weights=weights)
        return Misfit(in_band / np.square(self._objective.scatter)[:, None])
