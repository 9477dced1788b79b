"""What explains a window: faults, hidden causes, or what it cannot tell apart (M27).

The search knows faults only. From its optimum on, sets of faults and hidden causes compete: a
cause is added, or takes the place of faults, when the window is explained so much better, or as
well with fewer components. Sets are compared on the linear model, by ``n ln(cost)`` with ``n``
effective residuals; each chosen set is fitted anew with the model itself.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass
from itertools import combinations
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, FAULTS, N_FAULTS, SHORT_CIRCUITS
from ema_monitor.identification.knowledge import Knowledge, information
from ema_monitor.identification.objective import Linearisation, Objective
from ema_monitor.identification.uncertainty import (
    GROUPS,
    MISMATCH_FACTOR,
    covariance_of_effects,
    refitted,
    ridge_of,
    sandwich_covariance,
    shifts_of,
    significant_components,
)
from ema_monitor.optimizers.bounded_quadratic import lowest_in_box

MOST_CAUSES: Final = 3
"""Largest number of hidden causes in an explanation."""

ADDED_EVIDENCE: Final = 14.0
"""What an added cause must lower ``n ln(cost)`` by."""

COMPONENT_EVIDENCE: Final = 8.0
"""What a component is worth: how much a set with one less may be higher."""

REPLACED_EVIDENCE: Final = 6.0
"""What a cause must lower ``n ln(cost)`` by to take the place of a fault."""

AMBIGUOUS_EVIDENCE: Final = 8.0
"""Up to this difference the window does not tell two explanations apart."""

EQUAL_SHORTS: Final = "equal short circuits of all phases"
"""What three of them are called, where they stand for something else."""

MOST_LOSS: Final = 1.1
"""How much higher the cost may be without the components that are not significant."""

_MOST_STEPS = 8
_STEPS = np.array([1.0, 0.5, 0.2, 0.05])
_CONVERGED = 2e-3


@dataclass(frozen=True, eq=False)
class Explanation:
    """Faults and causes that explain a window.

    Attributes
    ----------
    at
        Linearisation at the estimate, of all components.
    kept
        Components that differ from healthy, ``(d,)``.
    confused
        Components that could stand in for what is kept, ``(d,)``: they widen the covariance.
    alternatives
        Pairs of what is kept and what could stand in for it, both in words.
    """

    at: Linearisation
    kept: NDArray[np.bool_]
    confused: NDArray[np.bool_]
    alternatives: list[tuple[str, str]]


class Quadratic(NamedTuple):
    """The cost of a linearised model as a quadratic: cheap to minimise for many sets."""

    at: Linearisation
    cost: float
    gradient: NDArray[np.float64]
    normal: NDArray[np.float64]

    @classmethod
    def of(cls, at: Linearisation) -> Self:
        """Return that of a linearisation."""
        normal = at.jacobian.T @ at.jacobian
        normal += ridge_of(normal) * np.eye(len(normal))
        return cls(at, at.cost, at.jacobian.T @ at.residuals, normal)

    def lowest(
        self, healthy: NDArray[np.float64], shown: NDArray[np.bool_]
    ) -> tuple[float, NDArray[np.float64]]:
        """Return the lowest cost with some components, others being healthy, and where it is."""
        point = np.where(shown, self.at.point, healthy)
        gradient = self.gradient + self.normal @ (point - self.at.point)
        point[shown] = lowest_in_box(
            self.normal[np.ix_(shown, shown)], gradient[shown], point[shown]
        )
        move = point - self.at.point
        cost = self.cost + 2.0 * self.gradient @ move + move @ self.normal @ move
        return max(float(cost), 1e-12 * self.cost), point


class Explainer:
    """Finds what explains a window.

    Parameters
    ----------
    objective
        Of the window, with hidden causes as components.
    lags
        Number of residuals over which they are correlated.
    floor
        Standard deviation that the mismatch of the model adds to each component, ``(d,)``.
    parsimonious
        Whether components that are not significant are set to healthy.
    most_evaluations
        Number of model evaluations after which no further cause is tried.
    nuisances
        Names of hidden causes that always take part, without evidence, and stand for nothing else.
    """

    def __init__(
        self,
        objective: Objective,
        lags: int,
        floor: NDArray[np.float64],
        *,
        parsimonious: bool,
        most_evaluations: int,
        nuisances: Collection[str] = (),
    ) -> None:
        self._objective = objective
        self._lags = lags
        self._floor = floor
        self._parsimonious = parsimonious
        self._most_evaluations = most_evaluations
        self._quadratic: Quadratic | None = None
        d = objective.dimension
        self._causes = range(d - len(objective.hidden_causes), d)
        self._always = np.arange(d) < self._causes.start
        for number, one in zip(self._causes, objective.hidden_causes, strict=True):
            self._always[number] = one.name in nuisances
        self._suspects = [cause for cause in self._causes if not self._always[cause]]
        self._effects: tuple[Linearisation, NDArray[np.float64]] | None = None

    def uncertainty(self, explanation: Explanation) -> NDArray[np.float64]:
        """Return the covariance of all components in the unit box, ``(d, d)``.

        Where causes take part, that of what is kept holds for the explanation as it is, with what
        it could be confused with; that of each other fault, for the explanation with it. What is
        not known of the unit is part of it.
        """
        at, kept = explanation.at, explanation.kept | explanation.confused
        effects = np.zeros((len(at.residuals), 0))
        # At the healthy point under a calibrated command there is no effect: it was measured.
        departs = np.any(explanation.kept[:N_FAULTS])
        departs |= np.any(explanation.kept[self._causes.start :])
        if departs or self._objective.is_measured:
            effects = self.effects(at)
        if not np.any(kept[self._suspects]):
            return self._covariance_with(at, self.faults_alone, effects)
        if len(self._suspects) < len(self._causes):
            kept = kept | self.faults_alone
        result = self._covariance_with(at, kept, effects)
        for group in GROUPS:
            if not kept[group[0]]:
                wider = self._covariance_with(at, _with(kept, group), effects)
                result[np.ix_(group, group)] = wider[np.ix_(group, group)]
        return result

    def effects(self, at: Linearisation) -> NDArray[np.float64]:
        """Return what is not known of the unit does to the residuals, ``(r, k)``.

        It does not follow the faults, as the mismatch does that widens the whole later.
        """
        if self._effects is None or self._effects[0] is not at:
            self._effects = at, self._objective.unit_effects(at.point) / MISMATCH_FACTOR
        return self._effects[1]

    def knowledge(self, explanation: Explanation) -> tuple[Knowledge, NDArray[np.float64]]:
        """Return what is known of the faults after the window, and its own information, ``(8, 8)``.

        None of the faults is set to healthy, and none held at the bounds of the box (M29).
        """
        objective, at = self._objective, explanation.at
        shown = explanation.kept | explanation.confused | self.faults_alone
        jacobian = at.jacobian[:, shown]
        step, effects = (
            -shifts_of(jacobian, rows) for rows in (at.residuals[:, None], self.effects(at))
        )
        covariance = self.covariance(jacobian, at.residuals + jacobian @ step[:, 0])
        faults = slice(0, N_FAULTS)
        gained = information(np.delete(jacobian, objective.known_rows, axis=0), objective.noise)
        before = objective.known
        total = gained if before is None else before.gained + before.misfit**2 * gained
        known = Knowledge(
            at.point[faults] + step[faults, 0],
            covariance[faults, faults],
            effects[faults],
            max(1.0, objective.misfit(at.residuals)),
            total,
        )
        return known, gained

    def _covariance_with(
        self, at: Linearisation, shown: NDArray[np.bool_], effects: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        d, jacobian = len(shown), at.jacobian[:, shown]
        result = np.zeros((d, d))
        result[np.ix_(shown, shown)] = self.covariance(
            jacobian, at.residuals
        ) + covariance_of_effects(jacobian, effects)
        return result

    @property
    def faults_alone(self) -> NDArray[np.bool_]:
        """Components that need no evidence: all but hidden causes under suspicion, ``(d,)``."""
        return self._always

    def explain(self, point: NDArray[np.float64]) -> Explanation:
        """Return what explains the window.

        Parameters
        ----------
        point
            Optimum of the faults alone, ``(d,)``.
        """
        fitted = self.faults_alone
        at, kept = self._reduced(self._objective.linearise(point, fitted), fitted)
        if self._causes:
            # So far without their columns, which setting to healthy does not need.
            at = self._objective.linearise(at.point)
        for _ in range(MOST_CAUSES):
            left = self._most_evaluations - self._objective.evaluations
            if left < _MOST_STEPS * self._objective.linearisation_evaluations:
                break
            trial = self._promising(at, kept)
            if trial is None:
                break
            starts = [self._predicted(at, trial)[1]]
            if np.all(trial[kept]):
                starts.append(at.point)
            better = self._better(np.stack(starts), trial, at, kept)
            if better is None:
                break
            at, kept = better
        if np.any(kept[self._suspects]):
            # The optimum of the faults alone may have led astray.
            trial = kept | self.faults_alone
            at, kept = self._better(self._objective.healthy[None], trial, at, kept) or (at, kept)
            at, kept = self._without_what_cancels(at, kept)
        confused, alternatives = self._alternatives(at, kept)
        return Explanation(at, kept, confused, alternatives)

    def _without_what_cancels(
        self, at: Linearisation, kept: NDArray[np.bool_]
    ) -> tuple[Linearisation, NDArray[np.bool_]]:
        """Return an explanation without two causes that cancel, or itself.

        Torque constant, or equal short circuits, and inertia hardly change a motion in which load
        and friction are in the same proportion: each is significant beside the other.
        """
        parts = [group for group in self._groups(kept) if group[0] in self._suspects]
        if np.all(kept[SHORT_CIRCUITS]):
            parts.append(list(SHORT_CIRCUITS))
        for one, other in combinations(parts, 2):
            both = one + other
            if np.all(kept[both]):
                trial = _without(kept | self.faults_alone, both)
                starts = np.stack([self._predicted(at, trial)[1], at.point])
                starts[:, both] = self._objective.healthy[both]
                at, kept = self._better(starts, trial, at, kept) or (at, kept)
        return at, kept

    def _better(
        self,
        starts: NDArray[np.float64],
        trial: NDArray[np.bool_],
        at: Linearisation,
        kept: NDArray[np.bool_],
    ) -> tuple[Linearisation, NDArray[np.bool_]] | None:
        """Return the explanation with the components of a trial, None where that is no better."""
        point = self._descended(starts, trial)
        found, shown = self._reduced(self._objective.linearise(point, trial), trial)
        more = _components(shown) - _components(kept)
        if self._evidence(found.cost, at.cost) >= -_price(more):
            return None
        return self._objective.linearise(found.point), shown

    def covariance(
        self, jacobian: NDArray[np.float64], residuals: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the covariance of the components whose columns the Jacobian has."""
        return sandwich_covariance(
            jacobian, residuals, self._lags, self._objective.priors, self._objective.noise
        )

    def _evidence(self, cost: float, other: float) -> float:
        """Return by how much the first cost is worse."""
        return self._objective.effective * float(np.log(cost / other))

    def _predicted(
        self, at: Linearisation, shown: NDArray[np.bool_]
    ) -> tuple[float, NDArray[np.float64]]:
        """Return cost and point of the linear model's optimum with only some components."""
        if self._quadratic is None or self._quadratic.at is not at:
            self._quadratic = Quadratic.of(at)
        return self._quadratic.lowest(self._objective.healthy, shown)

    def _promising(self, at: Linearisation, kept: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
        """Return the components of the best explanation with another cause; None without any.

        The linear model is no judge over far steps: an explanation with fewer components is worth
        trying as long as the window might not tell the two apart.
        """
        now = _components(kept)
        # No set explains more than all components together.
        most = -self._worse(at, np.ones_like(kept)) if len(self._causes) else 0.0
        best, chosen = 0.0, None
        for cause in self._causes:
            if kept[cause]:
                continue
            added = _with(kept, [cause])
            # Faults that the cause has hidden may come back.
            trials = [(added | self.faults_alone, -ADDED_EVIDENCE)]
            for group in self._groups(kept):
                fewer = now - _components(trial := _without(added, group))
                worth = COMPONENT_EVIDENCE * fewer + AMBIGUOUS_EVIDENCE
                trials.append((trial, worth if fewer else 0.0))
            for trial, worth in trials:
                if worth + most <= best:
                    continue
                gain = worth - self._worse(at, trial)
                if gain > best:
                    best, chosen = gain, trial
        return chosen

    def _descended(
        self, starts: NDArray[np.float64], free: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return the optimum of some components, downhill from the lowest start, ``(m, d)``."""
        objective = self._objective
        cost, point, trials = np.inf, starts[0], starts
        for _ in range(_MOST_STEPS):
            costs = np.sum(objective.residuals(trials) ** 2, axis=1)
            lowest = int(np.argmin(costs))
            if costs[lowest] >= (1.0 - _CONVERGED) * cost:
                break
            cost, point = costs[lowest], trials[lowest]
            at = self._objective.linearise(point, free)
            target = refitted(point, point, at.residuals, at.jacobian, free)
            trials = point + _STEPS[:, None] * (target - point)
        return point

    def _reduced(
        self, at: Linearisation, fitted: NDArray[np.bool_]
    ) -> tuple[Linearisation, NDArray[np.bool_]]:
        """Set components that are not significant to healthy and fit the others anew."""
        objective = self._objective
        if not self._parsimonious:
            return at, fitted
        groups = [group for group in GROUPS if fitted[group[0]]]
        groups += [[cause] for cause in self._suspects if fitted[cause]]
        kept, point = significant_components(
            at.point,
            objective.healthy,
            at.residuals,
            at.jacobian,
            self.covariance,
            self._floor,
            fitted,
            groups,
        )
        if np.all(kept == fitted):
            return at, kept
        optimum, at = at, self._objective.linearise(point, fitted)
        loss = math.log(MOST_LOSS) * objective.effective
        if np.any(fitted[self._suspects]):
            loss = max(loss, COMPONENT_EVIDENCE * (_components(fitted) - _components(kept)))
        if self._evidence(at.cost, optimum.cost) > loss:
            at = self._objective.linearise(self._descended(point[None], kept), fitted)
        if self._evidence(at.cost, optimum.cost) > loss:
            return optimum, fitted
        point = refitted(at.point, objective.healthy, at.residuals, at.jacobian, kept)
        again = self._objective.linearise(point, fitted)
        return (again if again.cost < at.cost else at), kept

    def _alternatives(
        self, at: Linearisation, kept: NDArray[np.bool_]
    ) -> tuple[NDArray[np.bool_], list[tuple[str, str]]]:
        """Return which causes could stand in for what is kept, and what could for what."""
        confused = np.zeros_like(kept)
        found = []
        for group in self._groups(kept):
            without = _without(kept, group)
            fewer = _components(kept) - _components(without)
            # What hardly shows is not worth an alternative.
            most = min(
                AMBIGUOUS_EVIDENCE + COMPONENT_EVIDENCE * (fewer - 1),
                self._worse(at, without) - COMPONENT_EVIDENCE,
            )
            for cause in self._causes:
                if not kept[cause] and self._worse(at, _with(without, [cause])) < most:
                    found.append((self._name(group), self._name([cause])))
                    confused[cause] = True
            healthy = [phase for phase in SHORT_CIRCUITS if not kept[phase]]
            may_be_shorts = group[0] in self._suspects and len(healthy) > 1
            if may_be_shorts and self._worse(at, _with(without, healthy)) < most:
                found.append((self._name(group), self._name(healthy)))
                confused[healthy] = True
        return confused, found

    def _worse(self, at: Linearisation, shown: NDArray[np.bool_]) -> float:
        """Return by how much the linear model's optimum with only some components is worse."""
        return self._evidence(self._predicted(at, shown)[0], at.cost)

    def _groups(self, kept: NDArray[np.bool_]) -> list[list[int]]:
        """Return what may be replaced: each component kept, and short circuits together."""
        groups = [group for group in GROUPS if kept[group[0]]]
        groups += [[cause] for cause in self._suspects if kept[cause]]
        shorted = [phase for phase in SHORT_CIRCUITS if kept[phase]]
        if len(shorted) == len(SHORT_CIRCUITS):
            groups += [list(pair) for pair in combinations(shorted, 2)]
        if len(shorted) > 1:
            groups.append(shorted)
        return groups

    def _name(self, group: list[int]) -> str:
        if group == SHORT_CIRCUITS:
            return EQUAL_SHORTS
        if group[0] in SHORT_CIRCUITS:
            return " and ".join(FAULTS[phase].label for phase in group)
        first = group[0]
        if first < N_FAULTS:
            return FAULTS[first].label
        return self._objective.hidden_causes[first - self._causes.start].cause.label


def _with(kept: NDArray[np.bool_], group: list[int]) -> NDArray[np.bool_]:
    more = kept.copy()
    more[group] = True
    return more


def _without(kept: NDArray[np.bool_], group: list[int]) -> NDArray[np.bool_]:
    rest = kept.copy()
    rest[group] = False
    return rest


def _price(more: int) -> float:
    """Return by how much an explanation with ``more`` components must be better to be chosen."""
    return COMPONENT_EVIDENCE * more if more else REPLACED_EVIDENCE


def _components(kept: NDArray[np.bool_]) -> int:
    """Return the number of components, the vector of eccentricity as one."""
    return int(np.sum(kept)) - int(kept[ECCENTRICITY] and kept[ECCENTRICITY_PHASE])
