"""What explains a window: faults, hidden causes, or what it cannot tell apart (M27).

The search knows faults only. From its optimum on, sets of faults and hidden causes compete: a
cause is added, or takes the place of faults, when the window is explained so much better, or as
well with fewer components. Sets are compared on the linear model; each chosen set is fitted anew
with the model itself. What is still not explained, or only by an unusual cause, is looked for from
other places too.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.faults import FRICTION, N_FAULTS, SHORT_CIRCUITS
from ema_monitor.identification.alternatives import Alternative
from ema_monitor.identification.evidence import (
    AMBIGUOUS_EVIDENCE,
    COMPONENT_EVIDENCE,
    REMEMBERED_EVIDENCE,
    REPLACED_EVIDENCE,
    UNUSUAL_EVIDENCE,
    Components,
    Evidence,
    Explanations,
    components,
    excluding,
    including,
)
from ema_monitor.identification.knowledge import FLOOR
from ema_monitor.identification.objective import Objective
from ema_monitor.identification.uncertainty import significant_components
from ema_monitor.model.deviations import Prior
from ema_monitor.model.readings import MOVES_START
from ema_monitor.optimizers.gauss_newton import LineSearch, Problem, Stopping, descend
from ema_monitor.optimizers.linear_model import Linearisation, refitted

MOST_CAUSES: Final = 3
"""Largest number of hidden causes in an explanation."""

MOST_LOSS: Final = 1.1
"""How much higher the cost may be without the components that are not significant."""

DOUBTFUL_SIGMAS: Final = 4.0
"""From this distance from what is usual on, a cause is doubted: other places are looked at, too."""

DOUBTFUL_MOTOR_SIGMAS: Final = 1.0
"""The same of inertia and torque constant, which may stand for the gain of the current sensor.

Beside another cause they are doubted at any distance, as are short circuits of all phases.
"""

# By how much an explanation may be worse before it is fitted.
_ABOUT = 2.0
# Causes that change the strength of the motor, and the power of it that they go with.
_WEAKER: Final = {"torque_constant": 1.0, "inertia": -1.0}
_SEEDED: Final = {
    "load_torque": (-1.5, -1.0, -0.5, 0.5, 1.0, 1.5),
    "command_delay": (1.0, 2.0, 4.0),
    "current_gain": (-14.0, -10.0, -6.0, 6.0, 10.0, 14.0),
    "current_offset": (-60.0, -40.0, -20.0, 20.0, 40.0, 60.0),
    "current_delay": (-30.0, -25.0, -20.0, -15.0, -10.0, -5.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0),
    "speed_offset": (-60.0, -40.0, -20.0, 20.0, 40.0, 60.0),
    "speed_delay": (-30.0, -25.0, -20.0, -15.0, -10.0, -5.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0),
}
_MOST_SEEDS = 4
# On 40 windows of drawn units: the full step alone gives the same estimates with 2 % fewer
# evaluations, but none where it leads too far; a gain of 2e-4 takes 3 % more evaluations for the
# same estimates, one of 2e-2 moves one; 15 iterations give the same estimates.
_SHARES: Final = ((1.0, 0.5, 0.2, 0.05),)
_STOPPING: Final = Stopping(iterations=7, gain=2e-3)
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
        Components that could stand in for what is kept, ``(d,)``, and the pairs of both by name.
    open, far
        Explanations that the window leaves open; and the second moment of those that the model
        itself compared, about the estimate, ``(d, d)``.
    """

    at: Linearisation
    kept: Components
    confused: Components
    alternatives: list[Alternative]
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
        return self._with_other_motors(at, kept)

    def _with_other_motors(self, at: Linearisation, kept: Components) -> Explanation:
        """Return an explanation after the others by which the motor is as strong.

        Equal parts of short circuits weaken it as a smaller torque constant does, or a larger
        inertia and friction. The linear model misses that, as they are far apart: the model itself
        compares them. A better one takes the place of the explanation; one that the window does not
        tell from it makes it less certain, by how far they are apart.
        """
        evidence, others = self._evidence, self._other_motors(at, kept)
        points = np.stack([at.point, *(point for _, _, point in others)])
        _, *rows = self._objective.residuals(points)
        worse, named = [0.0], []
        for (group, other, point), row in zip(others, rows, strict=True):
            there = Linearisation(point, row, at.jacobian)
            worse.append(evidence.against(there, at, REMEMBERED_EVIDENCE))
            dearer = evidence.price(including(excluding(kept, group), other)) - evidence.price(kept)
            if worse[-1] + dearer < _ABOUT and self._can_afford_more:
                trial = including(excluding(kept | self._always, group), other)
                better = self._better(point[None], trial, at, kept)
                if better is not None:
                    return self._with_other_motors(*better)
            more = (other[0] in self._suspects) - (group[0] in self._suspects)
            worse[-1] += UNUSUAL_EVIDENCE * more
            named.append(evidence.named(group, other))
        confused, linear, pairs = evidence.alternatives(at, kept, self._tried)
        near = np.array(worse) < AMBIGUOUS_EVIDENCE
        found = Explanations(np.array(worse)[near], (points - at.point)[near])
        # What the linear model said of these does not hold.
        rest = np.array([False, *(pair not in named for pair in pairs)])
        linear = (one[rest] for one in linear)
        return Explanation(
            at,
            kept,
            confused,
            [*compress(named, near[1:]), *compress(pairs, rest[1:])],
            Explanations(*map(np.concatenate, zip(found, linear, strict=True))),
            found.spread,
        )

    def _other_motors(
        self, at: Linearisation, kept: Components
    ) -> list[tuple[list[int], list[int], Array]]:
        """Return what may be replaced, by what, and where that leads, ``(d,)``."""
        healthy = [phase for phase in SHORT_CIRCUITS if not kept[phase]]
        least = min(SHORT_CIRCUITS, key=lambda phase: float(at.point[phase]))
        causes = [[n] for n in self._suspects if self._prior(n).name in _WEAKER]
        result = []
        for group in [one for one in [*causes, [least]] if kept[one[0]]]:
            strength = self._strength(at.point, group[0])
            without = self._strengthened(at.point, group[0], 1.0 / strength)
            for other in [*causes, healthy or SHORT_CIRCUITS]:
                if other != group and not (group == [least] and other[0] in SHORT_CIRCUITS):
                    point = self._strengthened(without, other[0], strength)
                    result.append((group, other, point))
        return result

    def _prior(self, cause: int) -> Prior:
        return self._objective.hidden_causes[cause - self._causes.start]

    def _strength(self, point: Array, number: int) -> float:
        """Return how many times as strong a short circuit or a cause makes the motor."""
        if number in SHORT_CIRCUITS:
            return 1.0 - float(point[number])
        one = self._prior(number)
        return (1.0 + one.reach * (2.0 * float(point[number]) - 1.0)) ** _WEAKER[one.name]

    def _strengthened(self, point: Array, number: int, factor: float) -> Array:
        """Return a point with a stronger motor, by all short circuits or by a cause."""
        result = point.copy()
        if number in SHORT_CIRCUITS:
            result[SHORT_CIRCUITS] = 1.0 - factor * (1.0 - point[SHORT_CIRCUITS])
        else:
            one = self._prior(number)
            value = (factor * self._strength(point, number)) ** _WEAKER[one.name] - 1.0
            result[number] = 0.5 + value / (2.0 * one.reach)
            if one.name == "inertia":
                result[FRICTION] = ((1.0 + 2.0 * point[FRICTION]) / factor - 1.0) / 2.0
                for load in (n for n in self._causes if self._prior(n).name.startswith("load")):
                    expected = self._prior(load).expected / (2.0 * self._prior(load).reach)
                    result[load] = 0.5 + (point[load] - 0.5 + expected) / factor - expected
        return np.clip(result, 0.0, 1.0)

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
        return left >= (1 + _STOPPING.iterations) * self._objective.linearisation_evaluations

    def _is_doubtful(self, at: Linearisation, kept: Components) -> bool:
        """Return whether a window is not explained, or only by a cause that is unusual."""
        if not self._suspects:
            return False
        away = np.abs(self._objective.cause_sigmas(at.point))
        if np.any(away[kept[self._causes.start :]] > DOUBTFUL_SIGMAS):
            return True
        shown = [cause for cause in self._suspects if kept[cause]]
        motor = [cause for cause in shown if self._prior(cause).name in _WEAKER]
        if np.any(away[np.array(motor, dtype=int) - self._causes.start] > DOUBTFUL_MOTOR_SIGMAS):
            return True
        # By themselves, they fit where they are right.
        are_all_shorted = bool(np.all(kept[SHORT_CIRCUITS]))
        if (motor or are_all_shorted) and len(shown) + are_all_shorted > 1:
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

    def _better(
        self, starts: Array, trial: Components, at: Linearisation, kept: Components
    ) -> Fitted | None:
        """Return the explanation with the components of a trial, None where that is no better."""
        point = self._descended(starts, trial)
        there = self._objective.linearise(point, trial)
        if not np.all(np.isfinite(there.jacobian)):
            return None  # two phases without turns: the model has no finite response
        found, shown = self._reduced(there, trial)
        dearer = self._evidence.price(shown) - self._evidence.price(kept)
        if self._evidence.against(found, at) >= -(dearer or REPLACED_EVIDENCE):
            return None
        return self._objective.extended(found, self._tried), shown

    def _promising(self, at: Linearisation, kept: Components) -> Components | None:
        """Return the components of the best explanation with another cause; None without any.

        The linear model is no judge over far steps: an explanation with fewer components is worth
        trying as long as the window might not tell the two apart.
        """
        evidence = self._evidence
        groups = evidence.groups(kept)
        trials, worths = [], []
        for cause in self._causes:
            if kept[cause] or not self._tried[cause]:
                continue
            added = including(kept, [cause])
            # Faults that the cause has hidden may come back.
            trials.append(added | self._always)
            worths.append(evidence.price(kept) - evidence.price(added))
            # The new cause takes the place of one of them.
            for group in groups:
                trials.append(excluding(added, group))
                cheaper = evidence.price(kept) - evidence.price(trials[-1])
                is_fewer = components(trials[-1]) < components(kept)
                worths.append(cheaper + AMBIGUOUS_EVIDENCE * is_fewer)
        if not trials:
            return None
        gains = np.array(worths) - evidence.worse(at, np.array(trials))
        best = int(np.argmax(gains))
        return trials[best] if gains[best] > 0.0 else None

    def _descended(self, starts: Array, free: Components) -> Array:
        """Return the optimum of some components, downhill from the lowest start, ``(m, d)``."""
        objective = self._objective
        problem = Problem(objective.residuals, lambda point: objective.linearise(point, free))
        search = LineSearch(lambda at: refitted(at, at.point, free), _SHARES)
        return descend(problem, starts, search, _STOPPING).point

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
        if at.predicted_cost(point) > (1.0 - _SETTLED) * at.cost:
            return at, kept
        again = objective.linearise(point, kept)
        return (again if again.cost < at.cost else at), kept
