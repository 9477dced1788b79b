# SPDX-License-Identifier: Apache-2.0
"""Derivation of an estimate from the optimum of a search: explanation, uncertainty, verdict."""

import math
import time
from dataclasses import dataclass
from itertools import compress

import numpy as np

from ema_core.arrays import Array
from ema_core.causes import CauseEstimate, SystemPart
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
from ema_monitor.identification.search_settings import SearchSettings
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
from ema_monitor.reasons import CauseFound, Contradicted, Reason, Subject
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.window import Window

_FAULTS = slice(0, N_FAULTS)
# Share of the search range beyond which a value counts as being at its bound.
_AT_BOUND = 0.999


@dataclass(frozen=True, eq=False)
class WindowResult:
    """Result of an identification."""

    estimate: Estimate
    """The estimate. For a refusal, all other fields have their defaults."""
    misfit: Misfit | None = None
    """Misfit of the estimate to the window."""
    knowledge: Knowledge | None = None
    """Knowledge of the faults after a stretch of motion; None for a test window."""
    surprise: float = 0.0
    """Squared distance of a stretch from the prior knowledge [-]."""
    contradicted: tuple[CauseEstimate, ...] = ()
    """Measured causes that were not used because the window contradicts them."""
    caveats: tuple[Reason, ...] = ()
    """Reservations about the search."""


class Inference:
    """Derives the estimate of a window from the optimum of a search.

    Parameters
    ----------
    window
        The window, with its measured causes.
    calibration
        Calibration of the model.
    settings
        Settings of the search.
    knowledge
        Prior knowledge of the faults in a stretch of motion; None for a test window.
    memory
        Memory of the unit's earlier tests.
    """

    def __init__(
        self,
        window: Window,
        calibration: Calibration,
        settings: SearchSettings,
        knowledge: Knowledge | None = None,
        memory: Memory = NOTHING,
    ) -> None:
        self._memory = memory
        self._window = window
        self._calibration = calibration
        self._settings = settings
        self._knowledge = knowledge
        informed = memory.informed(window)
        fitted = needs_no_evidence(informed, knowledge)
        expected = needs_no_evidence(window, knowledge)
        causes = expected_causes(calibration.parameters, informed)
        # Priors need the noise, which only the default distance measure models.
        if settings.fitness != DEFAULT_FITNESS:
            causes = ()
        elif calibration.form not in LEARNS_UNIT:
            causes = tuple(cause for cause in causes if cause.name in fitted)
        self._objective = objective = Objective(
            window, calibration, settings.fitness, causes=causes, knowledge=knowledge
        )
        first = objective.first_cause
        self._always = np.arange(objective.dimension) < first
        self._always[first:] = [cause.name in fitted for cause in causes]
        self._expects_causes = any(cause.name in expected for cause in causes)
        # Range of each component per unit of a point; the position in the play has a range of 2.
        self._span = np.ones(objective.dimension)
        self._span[:N_FAULTS] = SPANS
        if window.play is None:
            self._span[N_FAULTS] = 2.0
        self._unit_effects: Array | None = None

    def searched(self, *, cartesian: bool) -> Objective:
        """Return the objective of the search, without hidden causes that need evidence.

        If ``cartesian``, the components of the eccentricity are Cartesian (`Coordinates`).
        """
        priors, fitted = self._objective.hidden_causes, self._always[self._objective.first_cause :]
        causes = tuple(compress(priors, fitted))
        return self._objective.with_causes(causes, cartesian=cartesian)

    @property
    def most_evaluations(self) -> int:
        """Largest number of model evaluations in `result` without suspected hidden causes."""
        objective = self._objective
        return 3 * objective.linearisation_evaluations + objective.unit_evaluations + 2

    def result(
        self,
        faults: Array,
        play: float,
        fitted: Array,
        *,
        started: float,
        warm_start: bool,
        contradicted: tuple[CauseEstimate, ...],
        caveats: tuple[Reason, ...],
    ) -> WindowResult:
        """Return the result at the optimum of a search.

        Parameters
        ----------
        faults, play
            Faults at the optimum, ``(8,)``, and position of the motor in its play [half-widths].
        fitted
            Values of the causes that need no evidence, in the unit box, ``(k,)``.
        started
            Start time of the identification by ``time.perf_counter`` [s].
        warm_start
            Whether the search began at earlier faults.
        contradicted
            Measured causes that were not used because the window contradicts them.
        caveats
            Reservations about the search.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the covariance cannot be computed.
        """
        objective, window, settings = self._objective, self._window, self._settings
        remaining = settings.budget - objective.unit_evaluations - 2
        explainer = Explainer(
            objective,
            self._always,
            most_evaluations=remaining,
            seeds={"position_offset": (window.start_offset,)} if self._knowledge is None else {},
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
        if self._knowledge is not None:
            knowledge, gained = self._knowledge_after(explanation, self._knowledge)
            surprised = surprise(self._knowledge, knowledge, gained)
        fault_covariance, unobservable = uncertainty_of_faults(faults, covariance)
        widths = self._uncertainty(explanation, math.sqrt(goodness), of_quantiles=True)
        quantiles, probability = self._distribution(explanation, faults, widths[_FAULTS, _FAULTS])
        phase_unknown = unobservable & (np.arange(N_FAULTS) == ECCENTRICITY_PHASE)
        causes = self._causes(explanation, covariance)
        limit = goodness_limit(faults, settings.goodness_limit)
        subject = Subject.WINDOW if self._knowledge is None else Subject.STRETCH
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
            covariance=fault_covariance,
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
        return WindowResult(estimate, misfit, knowledge, surprised, contradicted, caveats)

    def _remembered(self, points: Array) -> Array:
        """Return the surprise, ``(...)``, of points, ``(..., d)``, given the earlier tests."""
        objective, flat = self._objective, np.atleast_2d(points)
        names = [prior.name for prior in objective.hidden_causes]
        causes = dict(zip(names, objective.causes(flat).T, strict=True))
        surprise = self._memory.surprise(objective.decode(flat)[0], causes)
        return surprise.reshape(points.shape[:-1])

    def _distribution(
        self, explanation: Explanation, faults: Array, covariance: Array
    ) -> tuple[Array, Array]:
        """Return quantiles, ``(5, 8)``, and the probability that each fault is present, ``(8,)``.

        ``covariance``, ``(8, 8)``, is the covariance about each explanation. See M18 in
        ``docs/identification.md``.
        """
        explanations = explanation.open
        steps = explanations.steps[:, _FAULTS]
        departures = explanation.at.point[_FAULTS] + steps - self._objective.healthy[_FAULTS]
        present = ~np.isclose(departures, 0.0)
        present[:, PLANE] = np.any(present[:, PLANE], axis=1, keepdims=True)
        turn = turn_of(faults) * SPANS
        means, widths = faults + steps @ turn.T, np.sqrt(np.diag(turn @ covariance @ turn.T))
        weights = explanations.weights
        return quantiles_of(weights, means, np.outer(WIDTHS, widths)), weights @ present

    def _uncertainty(
        self, explanation: Explanation, widened: float, *, of_quantiles: bool = False
    ) -> Array:
        """Return the covariance of all components in the unit box, ``(d, d)``.

        If the explanation includes causes, the covariance of its components refers to the
        explanation itself. The covariance of each further fault refers to the explanation with this
        fault added. The uncertain deviations of the unit are included. ``widened`` is the factor by
        which a poor fit increases the residuals. See M18 in ``docs/identification.md``.
        """
        at, kept = explanation.at, explanation.kept
        # The uncertain deviations of the unit do not depend on the misfit.
        at = at._replace(residuals=widened * at.residuals)
        always, is_cause = self._always, np.arange(len(kept)) >= self._objective.first_cause
        effects = np.zeros((len(at.residuals), 0))
        # The healthy response to the calibrated command was measured: the deviations do not affect
        # it.
        departs = np.any(explanation.kept[:N_FAULTS]) or np.any(explanation.kept[is_cause])
        if departs or self._window.measured:
            effects = self._effects(at, of_quantiles=of_quantiles)
        if self._expects_causes or not np.any(kept & is_cause):
            kept = kept | always
        result = self._covariance(at, kept, effects)
        for group in GROUPS:
            if not kept[group[0]]:
                wider = self._covariance(at, including(kept, group), effects)
                result[np.ix_(group, group)] = wider[np.ix_(group, group)]
        return result

    def _covariance(self, at: Linearisation, shown: Components, effects: Array) -> Array:
        """Return the covariance if only the components ``shown`` are fitted, ``(d, d)``."""
        jacobian = at.jacobian[:, shown]
        result = np.zeros((len(shown), len(shown)))
        shifts = shifts_of(jacobian, effects)
        covariance = self._objective.covariance(jacobian, at.residuals)
        result[np.ix_(shown, shown)] = covariance + shifts @ shifts.T
        return result

    def _effects(self, at: Linearisation, *, of_quantiles: bool = False) -> Array:
        """Return the effects of the unit's uncertain deviations on the residuals, ``(r, k)``.

        For the covariance, the effects are divided by ``MISMATCH_FACTOR``, which is later applied
        to the whole covariance. Quantiles use half of the effects, and a smaller share for the
        play, because backlash faults are multiples of the nominal play.
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

    def _knowledge_after(
        self, explanation: Explanation, before: Knowledge
    ) -> tuple[Knowledge, Array]:
        """Return the knowledge of the faults after a stretch, and its information, ``(8, 8)``.

        No fault is set to healthy or limited to the unit box. See M29 in
        ``docs/identification.md``.
        """
        objective, at = self._objective, explanation.at
        shown = explanation.kept | explanation.confused | self._always
        jacobian = at.jacobian[:, shown]
        step = -shifts_of(jacobian, at.residuals[:, None])
        effects = -shifts_of(jacobian, self._effects(at))
        covariance = objective.covariance(jacobian, at.residuals + jacobian @ step[:, 0])
        gained = information(np.delete(jacobian, objective.knowledge_rows, axis=0), objective.noise)
        after = Knowledge(
            at.point[_FAULTS] + step[_FAULTS, 0],
            covariance[_FAULTS, _FAULTS] + explanation.far[_FAULTS, _FAULTS],
            effects[_FAULTS],
            max(1.0, objective.misfit(at.residuals)),
            before.gained + before.misfit**2 * gained,
        )
        return after, gained

    def _causes(self, explanation: Explanation, covariance: Array) -> tuple[CauseEstimate, ...]:
        """Return the hidden causes that are part of the explanation.

        Causes that agree with their measured or expected values are omitted.
        """
        objective = self._objective
        first = objective.first_cause
        causes = [
            CauseEstimate(
                prior.cause.name,
                float(value),
                # One unit of a point corresponds to two reaches.
                MISMATCH_FACTOR * 2.0 * prior.reach * math.sqrt(covariance[first + i, first + i]),
            )
            for i, (prior, value) in enumerate(
                zip(objective.hidden_causes, objective.causes(explanation.at.point), strict=True)
            )
            if explanation.kept[first + i]
        ]
        return tuple(cause for cause in causes if self._is_unexpected(cause))

    def _is_unexpected(self, cause: CauseEstimate) -> bool:
        """Return whether a cause differs significantly from its measured or expected value.

        The result is True for a cause without such a value.
        """
        for measured in self._window.measured:
            if measured.name == cause.name:
                # Combining window and measurement never increases the variance.
                return abs(cause.value - measured.value) > SIGNIFICANT_CAUSE * measured.sigma
        if self._knowledge is not None and cause.name == NUISANCE:
            return abs(cause.value) > SIGNIFICANT_CAUSE * cause.sigma
        return True

    def _is_at_bound(self, cause: CauseEstimate) -> bool:
        """Return whether a cause is a sensor error at a bound of the search."""
        prior = next(item for item in self._objective.hidden_causes if item.name == cause.name)
        distance = abs(cause.value - prior.expected)
        return prior.cause.place == SystemPart.SENSOR and distance > _AT_BOUND * prior.reach

    def _misfit(self, at: Linearisation) -> Misfit:
        """Return the misfit at the estimate and at the healthy point."""
        window, objective = self._window, self._objective
        expected = objective.expect(np.stack([at.point, objective.healthy]))
        missed = window.missed(*expected, self._calibration.parameters.tau)
        squares = band_limited(missed, window.sample_period) ** 2
        # At rest, neither model nor fit determines the current: samples of motion are weighted.
        weights = None if self._knowledge is None else objective.fitness.weights**2
        in_band = np.average(squares, axis=-1, weights=weights)
        return Misfit(in_band / np.square(objective.scatter)[:, None])
