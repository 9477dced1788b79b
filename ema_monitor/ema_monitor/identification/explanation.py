"""What explains a window: faults, hidden causes, or what it cannot tell apart (M27).

The search knows faults only. From its optimum on, sets of faults and hidden causes compete: a
cause is added, or takes the place of faults, when the window is explained so much better, or as
well with fewer components. Sets are compared on the linear model; each chosen set is fitted anew
with the model itself. What is still not explained, or only by an unusual cause, is looked for from
other places too.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, compress
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.faults import N_FAULTS, SHORT_CIRCUITS
from ema_monitor.identification.evidence import (
    ADDED_EVIDENCE,
    AMBIGUOUS_EVIDENCE,
    COMPONENT_EVIDENCE,
    REMEMBERED_EVIDENCE,
    REPLACED_EVIDENCE,
    Components,
    Evidence,
    Explanations,
    components,
    excluding,
    including,
)
from ema_monitor.identification.knowledge import FLOOR
from ema_monitor.identification.objective import Objective
from ema_monitor.identification.uncertainty import Linearisation, refitted, significant_components
from ema_monitor.model.readings import MOVES_START

MOST_CAUSES: Final = 3
"""Largest number of hidden causes in an explanation."""

MOST_LOSS: Final = 1.1
"""How much higher the cost may be without the components that are not significant."""

DOUBTFUL_SIGMAS: Final = 4.0
"""From this distance from what is usual on, a cause is doubted: other places are looked at, too."""

FAR_EVIDENCE: Final = 40.0
"""Up to this difference by the linear model an explanation far away is tried."""

_EQUAL = (0.03, 0.1)
_SEEDED: Final = {
    "load_torque": (-1.5, -1.0, -0.5, 0.5, 1.0, 1.5),
    "command_delay": (1.0, 2.0, 4.0),
}
_MOST_SEEDS = 2
_MOST_STEPS = 8
_STEPS = np.array([1.0, 0.5, 0.2, 0.05])
_CONVERGED = 2e-3
# Share of the cost that a further fit has to take off by the linear model.
_SETTLED = 1e-5


Fitted = tuple[Linearisation, Components]
"""An explanation: a linearisation at its optimum, and the components that it consists of."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """Faults and causes that explain a window.

    Attributes
    ----------
    at
        Linearisation at the estimate, of all components.
    kept
        Components that differ from healthy, ``(d,)``.
    confused, alternatives
        Components that could stand in for what is kept, ``(d,)``, and pairs of both in words.
    open, far
        Explanations that the window leaves open; and the second moment of the one of them that the
        linear model does not predict, about the estimate, ``(d, d)``.
    """

    at: Linearisation
    kept: Components
    confused: Components
    alternatives: list[tuple[str, str]]
    open: Explanations
    far: Array


class Explainer:
    """Finds what explains a window.

    Parameters
    ----------
    objective
        Of the window, with hidden causes as components.
    always
        Components that need no evidence: all but hidden causes under suspicion, ``(d,)``.
    most_evaluations
        Number of model evaluations after which no further cause is tried.
    seeds
        Where to look for hidden causes besides, by name, in their units.
    remembered
        As of `Evidence`.
    """

    def __init__(
        self,
        objective: Objective,
        always: Components,
        *,
        most_evaluations: int,
        seeds: Mapping[str, Sequence[float]],
        remembered: Callable[[Array], Array] | None = None,
    ) -> None:
        self._objective = objective
        self._always = always
        self._most_evaluations = most_evaluations
        self._causes = range(objective.first_cause, objective.dimension)
        self._suspects = [cause for cause in self._causes if not always[cause]]
        self._evidence = Evidence(objective, self._suspects, remembered)
        self._tried = np.ones_like(always)
        self._seeds = seeds

    def explain(self, point: Array) -> Explanation:
        """Return what explains the window, from the optimum of the faults alone, ``(d,)``."""
        fitted = self._always
        at = self._objective.linearise(point, fitted)
        # So far with the columns of faults alone: setting to healthy needs no others.
        self._tried = self._worth_trying(at)
        at, kept = self._reduced(at, fitted)
        at = self._objective.extended(at, self._tried)
        at, kept = self._with_causes(at, kept)
        if self._is_doubtful(at, kept):
            for start, trial in self._elsewhere(at, kept):
                better = self._better(start[None], trial, at, kept)
                if better is not None:
                    at, kept = self._with_causes(*better)
        if np.any(kept[self._suspects]):
            # The optimum of the faults alone may have led astray.
            trial = kept | self._always
            at, kept = self._better(self._objective.healthy[None], trial, at, kept) or (at, kept)
            at, kept = self._without_what_cancels(at, kept)
        confused, found, alternatives = self._evidence.alternatives(at, kept, self._tried)
        far = np.zeros((len(kept), len(kept)))
        explanation = Explanation(at, kept, confused, alternatives, found, far)
        return self._with_weaker_motors(explanation)

    def _with_weaker_motors(self, explanation: Explanation) -> Explanation:
        """Return an explanation after the others by which the motor is as weak.

        Equal parts of short circuits weaken it as a smaller torque constant does, or a larger
        inertia and friction; the linear model misses that, as the two are far apart. Where the
        window does not tell them apart the explanation is less certain, by how far they are.
        """
        at, evidence = explanation.at, self._evidence
        for group, other, starts in self._weaker_motors(explanation):
            trial = including(excluding(explanation.kept | self._always, group), other)
            if evidence.worse(at, trial[None], REMEMBERED_EVIDENCE)[0] > FAR_EVIDENCE:
                continue
            if not self._can_afford_more:
                break
            starts = np.vstack([evidence.predicted(at, trial), starts])
            there = self._objective.linearise(self._descended(starts, trial), trial)
            if not np.all(np.isfinite(there.jacobian)):
                continue
            worse = evidence.against(there, at, REMEMBERED_EVIDENCE)
            if worse < AMBIGUOUS_EVIDENCE:
                away, found = there.point - at.point, explanation.open
                # What the linear model said of it does not hold.
                named = evidence.named(group, other)
                others = [pair != named for pair in explanation.alternatives]
                rest = [True, *others]
                return replace(
                    explanation,
                    alternatives=[named, *compress(explanation.alternatives, others)],
                    open=Explanations(
                        np.insert(found.worse[rest], 1, worse),
                        np.insert(found.steps[rest], 1, away, axis=0),
                    ),
                    far=Explanations(np.array([0.0, worse]), np.stack([0.0 * away, away])).spread,
                )
        return explanation

    def _weaker_motors(
        self, explanation: Explanation
    ) -> Iterator[tuple[list[int], list[int], Array]]:
        """Yield what may be replaced, by what, and where to begin, ``(m, d)``."""
        point, kept = explanation.at.point, explanation.kept
        shorts = point[SHORT_CIRCUITS]
        healthy = [phase for phase in SHORT_CIRCUITS if not kept[phase]]
        if len(healthy) > 1:
            for cause in self._suspects:
                if kept[cause]:
                    starts = np.tile(point, (len(_EQUAL), 1))
                    starts[:, cause] = self._objective.healthy[cause]
                    starts[:, SHORT_CIRCUITS] = shorts + np.outer(_EQUAL, 1.0 - shorts)
                    yield [cause], healthy, starts
        for cause, one in zip(self._causes, self._objective.hidden_causes, strict=True):
            is_open = self._tried[cause] and not kept[cause]
            if one.name == "torque_constant" and is_open and not healthy:
                least = float(np.min(shorts))
                start = point.copy()
                start[SHORT_CIRCUITS] = 1.0 - (1.0 - shorts) / (1.0 - least)
                start[cause] = np.clip(0.5 - least / (2.0 * one.reach), 0.0, 1.0)
                yield [SHORT_CIRCUITS[int(np.argmin(shorts))]], [cause], start[None]

    def _worth_trying(self, at: Linearisation) -> Components:
        """Return the components whose derivatives are worth their runs of the model, ``(d,)``.

        A wrong position at the start leaves a window unexplained, or disagrees with the speed.
        """
        objective = self._objective
        if at.cost > objective.fitness.good_cost or not objective.relations.are_healthy:
            return np.ones_like(self._always)
        moves = [one.name in MOVES_START for one in objective.hidden_causes]
        return self._always | ~np.array([False] * objective.first_cause + moves)

    def _with_causes(self, at: Linearisation, kept: Components) -> Fitted:
        """Return an explanation with further hidden causes, as far as they are worth it."""
        for _ in range(MOST_CAUSES - int(np.sum(kept[self._suspects]))):
            if not self._can_afford_more:
                break
            trial = self._promising(at, kept)
            if trial is None:
                break
            starts = [self._evidence.predicted(at, trial)]
            if np.all(trial[kept]):
                starts.append(at.point)
            better = self._better(np.stack(starts), trial, at, kept)
            if better is None:
                break
            at, kept = better
        return at, kept

    @property
    def _can_afford_more(self) -> bool:
        left = self._most_evaluations - self._objective.evaluations
        return left >= _MOST_STEPS * self._objective.linearisation_evaluations

    def _is_doubtful(self, at: Linearisation, kept: Components) -> bool:
        """Return whether a window is not explained, or only by a cause that is unusual."""
        if not self._suspects:
            return False
        away = np.abs(self._objective.cause_sigmas(at.point))
        if np.any(away[kept[self._causes.start :]] > DOUBTFUL_SIGMAS):
            return True
        return at.cost > self._objective.fitness.good_cost and at.cost > self._objective.fair_cost()

    def _elsewhere(self, at: Linearisation, kept: Components) -> list[tuple[Array, Components]]:
        """Return where else an explanation may be found: points, ``(d,)``, and their components.

        Each begins at a value of a cause that is not part of the explanation, with it or without
        faults and other causes; of each cause the lowest one, and of these the lowest.
        """
        if not self._can_afford_more:
            return []
        objective = self._objective
        healthy = objective.healthy
        points, trials, numbers = [], [], []
        for number in self._suspects:
            one = objective.hidden_causes[number - self._causes.start]
            values = [one.sigma * sigmas for sigmas in _SEEDED.get(one.name, ())]
            for value in (*values, *self._seeds.get(one.name, ())):
                if kept[number]:
                    continue
                for base, with_it in ((at.point, kept), (healthy, np.zeros_like(kept))):
                    point = base.copy()
                    point[number] = np.clip(0.5 + value / (2.0 * one.reach), 0.0, 1.0)
                    points.append(point)
                    trials.append(including(with_it | self._always, [number]))
                    numbers.append(number)
        if not points:
            return []
        costs = np.sum(objective.residuals(np.stack(points)) ** 2, axis=1)
        best: dict[int, int] = {}
        for place in np.argsort(costs).tolist():
            best.setdefault(numbers[place], place)
        return [(points[place], trials[place]) for place in list(best.values())[:_MOST_SEEDS]]

    def _without_what_cancels(self, at: Linearisation, kept: Components) -> Fitted:
        """Return an explanation without two causes that cancel, or itself.

        Torque constant, or equal short circuits, and inertia hardly change a motion in which load
        and friction are in the same proportion: each is significant beside the other.
        """
        parts = [group for group in self._evidence.groups(kept) if group[0] in self._suspects]
        if np.all(kept[SHORT_CIRCUITS]):
            parts.append(list(SHORT_CIRCUITS))
        for one, other in combinations(parts, 2):
            both = one + other
            if np.all(kept[both]):
                trial = excluding(kept | self._always, both)
                starts = np.stack([self._evidence.predicted(at, trial), at.point])
                starts[:, both] = self._objective.healthy[both]
                at, kept = self._better(starts, trial, at, kept) or (at, kept)
        return at, kept

    def _better(
        self, starts: Array, trial: Components, at: Linearisation, kept: Components
    ) -> Fitted | None:
        """Return the explanation with the components of a trial, None where that is no better."""
        point = self._descended(starts, trial)
        there = self._objective.linearise(point, trial)
        if not np.all(np.isfinite(there.jacobian)):
            return None  # two phases without turns: the model has no finite response
        found, shown = self._reduced(there, trial)
        more = components(shown) - components(kept)
        wanted = COMPONENT_EVIDENCE * more if more else REPLACED_EVIDENCE
        if self._evidence.against(found, at) >= -wanted:
            return None
        return self._objective.extended(found, self._tried), shown

    def _promising(self, at: Linearisation, kept: Components) -> Components | None:
        """Return the components of the best explanation with another cause; None without any.

        The linear model is no judge over far steps: an explanation with fewer components is worth
        trying as long as the window might not tell the two apart.
        """
        now = components(kept)
        groups = self._evidence.groups(kept)
        # The new cause takes the place of one of them.
        fewer = [now - components(excluding(kept, group)) - 1 for group in groups]
        trials, worths = [], []
        for cause in self._causes:
            if kept[cause] or not self._tried[cause]:
                continue
            added = including(kept, [cause])
            # Faults that the cause has hidden may come back.
            trials.append(added | self._always)
            worths.append(-ADDED_EVIDENCE)
            for group, less in zip(groups, fewer, strict=True):
                trials.append(excluding(added, group))
                worths.append(COMPONENT_EVIDENCE * less + AMBIGUOUS_EVIDENCE if less else 0.0)
        if not trials:
            return None
        gains = np.array(worths) - self._evidence.worse(at, np.array(trials))
        best = int(np.argmax(gains))
        return trials[best] if gains[best] > 0.0 else None

    def _descended(self, starts: Array, free: Components) -> Array:
        """Return the optimum of some components, downhill from the lowest start, ``(m, d)``."""
        objective = self._objective
        cost, point, trials = np.inf, starts[0], starts
        for _ in range(_MOST_STEPS):
            costs = np.sum(objective.residuals(trials) ** 2, axis=1)
            costs[np.isnan(costs)] = np.inf
            lowest = int(np.argmin(costs))
            if costs[lowest] >= (1.0 - _CONVERGED) * cost:
                break
            cost, point = costs[lowest], trials[lowest]
            at = self._objective.linearise(point, free)
            if not np.all(np.isfinite(at.jacobian)):
                break
            target = refitted(at, point, free)
            trials = point + _STEPS[:, None] * (target - point)
        return point

    def _reduced(self, at: Linearisation, fitted: Components) -> Fitted:
        """Set what is not significant to healthy, and fit anew, with derivatives of the rest."""
        objective = self._objective
        floor = np.pad(FLOOR, (0, objective.dimension - N_FAULTS))
        groups = self._evidence.singles(fitted)
        kept, point = significant_components(
            at, objective.healthy, objective.covariance, floor, fitted, groups
        )
        if np.all(kept == fitted):
            return at, kept
        optimum, at = at, objective.linearise(point, kept)
        loss = math.log(MOST_LOSS) * objective.fitness.effective
        if np.any(fitted[self._suspects]):
            loss = max(loss, COMPONENT_EVIDENCE * (components(fitted) - components(kept)))
        if self._evidence.against(at, optimum) > loss:
            at = objective.linearise(self._descended(point[None], kept), kept)
        if self._evidence.against(at, optimum) > loss:
            return optimum, fitted
        point = refitted(at, objective.healthy, kept)
        left = at.residuals + at.jacobian @ (point - at.point)
        if left @ left > (1.0 - _SETTLED) * at.cost:
            return at, kept
        again = objective.linearise(point, kept)
        return (again if again.cost < at.cost else at), kept
