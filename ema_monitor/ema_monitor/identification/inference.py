"""From the optimum of a search to the estimate: what explains it, and how well it is known."""

import math
import time
from dataclasses import dataclass

import numpy as np

from ema_core.arrays import Array
from ema_core.causes import CauseEstimate, Place
from ema_core.faults import ECCENTRICITY_PHASE, N_FAULTS, FaultVector, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.evidence import Components, including
from ema_monitor.identification.explanation import Explainer, Explanation
from ema_monitor.identification.fitness import DEFAULT_FITNESS
from ema_monitor.identification.knowledge import (
    NUISANCE,
    Knowledge,
    information,
    needs_no_evidence,
    surprise,
)
from ema_monitor.identification.memory import NOTHING, Memory
from ema_monitor.identification.objective import CALIBRATED_SHARE, Objective
from ema_monitor.identification.quantiles import quantiles_of
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.uncertainty import (
    GROUPS,
    MISMATCH_FACTOR,
    PLANE,
    SIGNIFICANT_CAUSE,
    SPANS,
    WIDTHS,
    shifts_of,
    turn_of,
    uncertainty_of_faults,
    widening,
)
from ema_monitor.identification.verdict import Misfit, assumed_goodness, goodness_limit, judged
from ema_monitor.model.deviations import NAMES
from ema_monitor.model.measured import expected_causes
from ema_monitor.model.monitor_model import LEARNS_UNIT
from ema_monitor.optimizers.linear_model import Linearisation
from ema_monitor.reasons import CauseFound, Contradicted, Reason
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.window import Window

_FAULTS = slice(0, N_FAULTS)
# Share of the range of the search.
_AT_BOUND = 0.999


@dataclass(frozen=True, eq=False)
class Finding:
    """What an identification has found in a window.

    Attributes
    ----------
    estimate
        The estimate, or the refusal of one; then there is nothing else.
    misfit
        What the estimate misses of the window.
    knowledge
        What is known of the faults after a stretch of motion; None of a test window.
    surprise
        Squared distance of a stretch from what was known before it.
    contradicted
        What was measured and not used, as the window contradicts it.
    caveats
        Further reservations about the search.
    """

    estimate: Estimate
    misfit: Misfit | None = None
    knowledge: Knowledge | None = None
    surprise: float = 0.0
    contradicted: tuple[CauseEstimate, ...] = ()
    caveats: tuple[Reason, ...] = ()


class Inference:
    """Makes the estimate from the optimum that a search of a window found.

    Parameters
    ----------
    window, calibration, settings, known, memory
        As of ``ModelIdentification``.
    """

    def __init__(
        self,
        window: Window,
        calibration: Calibration,
        settings: SearchSettings,
        known: Knowledge | None = None,
        memory: Memory = NOTHING,
    ) -> None:
        self._memory = memory
        self._window = window
        self._calibration = calibration
        self._settings = settings
        self._known = known
        informed = memory.informed(window)
        fitted = needs_no_evidence(informed, known)
        told = needs_no_evidence(window, known)
        causes = expected_causes(calibration.parameters, informed)
        # The other measures of distance know no noise that priors could be weighed against.
        if settings.fitness != DEFAULT_FITNESS:
            causes = ()
        elif calibration.form not in LEARNS_UNIT:
            causes = tuple(one for one in causes if one.name in fitted)
        self._objective = objective = Objective(
            window, calibration, settings.fitness, causes=causes, known=known
        )
        first = objective.first_cause
        self._always = np.arange(objective.dimension) < first
        self._always[first:] = [one.name in fitted for one in causes]
        self._is_told = any(one.name in told for one in causes)
        # Of one unit of a point: the play changes by 2.
        self._span = np.ones(objective.dimension)
        self._span[:N_FAULTS] = SPANS
        if window.play is None:
            self._span[N_FAULTS] = 2.0
        self._unit_effects: Array | None = None

    def searched(self, *, cartesian: bool) -> Objective:
        """Return what the search minimises: without the hidden causes that need evidence.

        ``cartesian`` is as of `Coordinates`.
        """
        suspects, told = self._objective.hidden_causes, self._always[self._objective.first_cause :]
        causes = tuple(one for one, is_told in zip(suspects, told, strict=True) if is_told)
        return self._objective.with_causes(causes, cartesian=cartesian)

    @property
    def most_evaluations(self) -> int:
        """Number of model evaluations that an estimate needs where no hidden cause is suspected."""
        objective = self._objective
        return 3 * objective.linearisation_evaluations + objective.unit_evaluations + 2

    def finding(
        self,
        faults: Array,
        play: float,
        fitted: Array,
        *,
        started: float,
        warm_start: bool,
        contradicted: tuple[CauseEstimate, ...],
        caveats: tuple[Reason, ...],
    ) -> Finding:
        """Return what is found at an optimum.

        Parameters
        ----------
        faults, play
            The optimum, ``(8,)``, and the motor's place in its play there [half-widths].
        fitted
            The causes that need no evidence there, in the unit box.
        started
            When the identification began, by ``time.perf_counter`` [s].
        warm_start
            Whether the search began at earlier faults.
        contradicted, caveats
            As of `Finding`.

        Raises
        ------
        numpy.linalg.LinAlgError
            When the covariance cannot be computed.
        """
        objective, window, settings = self._objective, self._window, self._settings
        left = settings.budget - objective.unit_evaluations - 2
        explainer = Explainer(
            objective,
            self._always,
            most_evaluations=left,
            seeds={} if self._known is not None else {"position_offset": (window.start_offset,)},
            remembered=self._remembered if self._memory.causes else None,
        )
        optimum = objective.encode(faults, play)
        first = objective.first_cause
        optimum[first:][self._always[first:]] = fitted
        explanation = explainer.explain(optimum)
        at, kept = explanation.at, explanation.kept
        [faults], [play] = objective.decode(at.point[None])
        misfit = self._misfit(at)
        goodness = assumed_goodness(faults, misfit.goodness)
        spread = explanation.open.spread / MISMATCH_FACTOR**2
        spans = np.outer(self._span, self._span)
        covariance = spans * (self._uncertainty(explanation, widening(goodness)) + spread)
        knowledge, surprised = None, 0.0
        if self._known is not None:
            knowledge, gained = self._knowledge(explanation, self._known)
            surprised = surprise(self._known, knowledge, gained)
        known, unobservable = uncertainty_of_faults(faults, covariance)
        told = self._uncertainty(explanation, math.sqrt(goodness), of_quantiles=True)
        quantiles, probability = self._distribution(explanation, faults, told[_FAULTS, _FAULTS])
        phase_unknown = unobservable & (np.arange(N_FAULTS) == ECCENTRICITY_PHASE)
        causes = self._causes(explanation, covariance)
        limit = goodness_limit(faults, settings.goodness_limit)
        subject = "window" if self._known is None else "stretch"
        verdict = judged(
            subject,
            misfit,
            limit,
            unobservable,
            explanation.alternatives,
            [
                *(Contradicted(subject, *cause) for cause in contradicted),
                *caveats,
                *(CauseFound(*cause) for cause in causes),
            ],
            self._calibration.windows,
            [cause for cause in causes if self._is_at_bound(cause)],
        )
        estimate = Estimate(
            window.start_ns,
            window.end_ns,
            settings.algorithm,
            settings.seed,
            self._calibration.calibration_id,
            faults=FaultVector.of(np.where(phase_unknown, healthy_faults(), faults)),
            covariance=known,
            unobservable=unobservable,
            quantiles=quantiles,
            probability=probability,
            play_offset=float(play),
            fitness=objective.window_cost(at.residuals),
            goodness_of_fit=misfit.goodness,
            goodness_limit=limit,
            excitation=window.excitation,
            evaluations=objective.evaluations,
            computing_time=time.perf_counter() - started,
            insignificant=~kept[:N_FAULTS],
            warm_start=warm_start,
            calibration_windows=self._calibration.windows,
            unexplained_share=misfit.share,
            causes=causes,
            alternatives=tuple(explanation.alternatives),
            measured=window.measured,
            **verdict,
        )
        return Finding(estimate, misfit, knowledge, surprised, contradicted, caveats)

    def _remembered(self, points: Array) -> Array:
        """Return how much points, ``(..., d)``, surprise after the earlier tests, ``(...)``."""
        objective, flat = self._objective, np.atleast_2d(points)
        names = [one.name for one in objective.hidden_causes]
        causes = dict(zip(names, objective.causes(flat).T, strict=True))
        surprise = self._memory.surprise(objective.decode(flat)[0], causes)
        return surprise.reshape(points.shape[:-1])

    def _distribution(
        self, explanation: Explanation, faults: Array, told: Array
    ) -> tuple[Array, Array]:
        """Return quantiles, ``(5, 8)``, and the probability that each fault is present, ``(8,)``.

        ``told``, ``(8, 8)``, is the covariance about each explanation (M18).
        """
        found = explanation.open
        steps = found.steps[:, _FAULTS]
        away = explanation.at.point[_FAULTS] + steps - self._objective.healthy[_FAULTS]
        present = ~np.isclose(away, 0.0)
        present[:, PLANE] = np.any(present[:, PLANE], axis=1, keepdims=True)
        turn = turn_of(faults) * SPANS
        means, widths = faults + steps @ turn.T, np.sqrt(np.diag(turn @ told @ turn.T))
        return quantiles_of(found.weights, means, np.outer(WIDTHS, widths)), found.weights @ present

    def _uncertainty(
        self, explanation: Explanation, widened: float, *, of_quantiles: bool = False
    ) -> Array:
        """Return the covariance of all components in the unit box, ``(d, d)``.

        Where causes take part, that of what is kept holds for the explanation as it is; that of
        each other fault, for the explanation with it. What is not known of the unit is part of it
        (M18); ``widened`` is what a poor fit makes of residuals.
        """
        at, kept = explanation.at, explanation.kept
        # What is not known of the unit does not follow the misfit.
        at = at._replace(residuals=widened * at.residuals)
        always, is_cause = self._always, np.arange(len(kept)) >= self._objective.first_cause
        effects = np.zeros((len(at.residuals), 0))
        # At the healthy point under a calibrated command there is no effect: it was measured.
        departs = np.any(explanation.kept[:N_FAULTS]) or np.any(explanation.kept[is_cause])
        if departs or self._window.measured:
            effects = self._effects(at, of_quantiles=of_quantiles)
        if self._is_told or not np.any(kept & is_cause):
            kept = kept | always
        result = self._covariance(at, kept, effects)
        for group in GROUPS:
            if not kept[group[0]]:
                wider = self._covariance(at, including(kept, group), effects)
                result[np.ix_(group, group)] = wider[np.ix_(group, group)]
        return result

    def _covariance(self, at: Linearisation, shown: Components, effects: Array) -> Array:
        """Return the covariance with only some components fitted, ``(d, d)``."""
        jacobian = at.jacobian[:, shown]
        result = np.zeros((len(shown), len(shown)))
        shifts = shifts_of(jacobian, effects)
        known = self._objective.covariance(jacobian, at.residuals)
        result[np.ix_(shown, shown)] = known + shifts @ shifts.T
        return result

    def _effects(self, at: Linearisation, *, of_quantiles: bool = False) -> Array:
        """Return what is not known of the unit does to the residuals, ``(r, k)``.

        It does not follow the faults, as the mismatch does that widens the whole later. Quantiles
        have half of it, and less of the play: faults are in multiples of the nominal one.
        """
        if self._unit_effects is None:
            self._unit_effects = self._objective.unit_effects(at.point)
        if not of_quantiles:
            return self._unit_effects / MISMATCH_FACTOR
        steps = self._objective.unit_steps
        is_play = 2.0 * steps[:, NAMES.index("backlash")] ** 2 > np.sum(steps**2, axis=1)
        shares = np.full(self._unit_effects.shape[1], 0.5)
        shares[: len(steps)][is_play] = CALIBRATED_SHARE
        return self._unit_effects * shares

    def _knowledge(self, explanation: Explanation, before: Knowledge) -> tuple[Knowledge, Array]:
        """Return what is known of the faults after the window, and its own information, ``(8, 8)``.

        None of the faults is set to healthy, and none held at the bounds of the box (M29).
        """
        objective, at = self._objective, explanation.at
        shown = explanation.kept | explanation.confused | self._always
        jacobian = at.jacobian[:, shown]
        step = -shifts_of(jacobian, at.residuals[:, None])
        effects = -shifts_of(jacobian, self._effects(at))
        covariance = objective.covariance(jacobian, at.residuals + jacobian @ step[:, 0])
        gained = information(np.delete(jacobian, objective.known_rows, axis=0), objective.noise)
        known = Knowledge(
            at.point[_FAULTS] + step[_FAULTS, 0],
            covariance[_FAULTS, _FAULTS] + explanation.far[_FAULTS, _FAULTS],
            effects[_FAULTS],
            max(1.0, objective.misfit(at.residuals)),
            before.gained + before.misfit**2 * gained,
        )
        return known, gained

    def _causes(self, explanation: Explanation, covariance: Array) -> tuple[CauseEstimate, ...]:
        """Return the hidden causes that are part of the explanation."""
        objective = self._objective
        first = objective.first_cause
        found = [
            CauseEstimate(
                one.cause.name,
                float(value),
                # Two reaches are one unit of a point.
                MISMATCH_FACTOR * 2.0 * one.reach * math.sqrt(covariance[first + i, first + i]),
            )
            for i, (one, value) in enumerate(
                zip(objective.hidden_causes, objective.causes(explanation.at.point), strict=True)
            )
            if explanation.kept[first + i]
        ]
        return tuple(cause for cause in found if self._is_news(cause))

    def _is_news(self, cause: CauseEstimate) -> bool:
        """Return whether a cause differs significantly from what was expected of it."""
        for measured in self._window.measured:
            if measured.name == cause.name:
                # Of both, the window and the measurement, it is not known less well than of one.
                return abs(cause.value - measured.value) > SIGNIFICANT_CAUSE * measured.sigma
        if self._known is not None and cause.name == NUISANCE:
            return abs(cause.value) > SIGNIFICANT_CAUSE * cause.sigma
        return True

    def _is_at_bound(self, cause: CauseEstimate) -> bool:
        """Return whether the error of a sensor ends the range of the search."""
        prior = next(one for one in self._objective.hidden_causes if one.name == cause.name)
        away = abs(cause.value - prior.expected)
        return prior.cause.place == Place.SENSOR and away > _AT_BOUND * prior.reach

    def _misfit(self, at: Linearisation) -> Misfit:
        """Return what is missed at the estimate and at the healthy point."""
        window, objective = self._window, self._objective
        expected = objective.expect(np.stack([at.point, objective.healthy]))
        missed = window.missed(*expected, self._calibration.parameters.tau)
        squares = band_limited(missed, window.sample_period) ** 2
        # Ordinary motion dwells, where neither model nor fit says what current flows.
        weights = None if self._known is None else objective.fitness.weights**2
        in_band = np.average(squares, axis=-1, weights=weights)
        return Misfit(in_band / np.square(objective.scatter)[:, None])
