# SPDX-License-Identifier: Apache-2.0
"""Explanation of a window by faults and hidden causes, with its alternatives.

The search fits faults only. Starting from its optimum, sets of faults and hidden causes compete. A
cause is added, or replaces faults, if it explains the window much better, or equally well with
fewer components. Sets are compared on the linear model; each selected set is fitted again with the
full model. If the window remains unexplained, or only an unusual cause explains it, further fits
begin at other starting points.

The method is described in ``docs/identification.md``, M27.
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
from ema_monitor.optimizers.gauss_newton import LeastSquaresProblem, LineSearch, Stopping, descend
from ema_monitor.optimizers.linear_model import Linearisation, refitted

MOST_CAUSES: Final = 3
"""Largest number of hidden causes in an explanation."""

MOST_LOSS: Final = 1.1
"""Largest ratio of the costs without and with the insignificant components [-]."""

DOUBTFUL_SIGMAS: Final = 4.0
"""Distance of a cause from its prior beyond which more starting points are tried [sigma]."""

DOUBTFUL_MOTOR_SIGMAS: Final = 1.0
"""Distance of inertia and torque constant from their priors beyond which more starting points are
tried [sigma].

These causes may be confused with the gain of the current sensor. In combination with another cause,
they are doubtful at any distance, as are short circuits of all phases.
"""

# Largest evidence against an explanation at which it is fitted.
_ABOUT = 2.0
# Causes that change the strength of the motor, with the exponent of their effect.
_WEAKER: Final = {"torque_constant": 1.0, "inertia": -1.0}
_LOADS: Final = ("load_torque", "load_stiffness")
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
# On 40 windows of simulated units, the full step alone gives the same estimates with 2 % fewer
# evaluations, but fails if it overshoots. A gain of 2e-4 requires 3 % more evaluations for the same
# estimates; a gain of 2e-2 changes one estimate; 15 iterations give the same estimates.
_SHARES: Final = ((1.0, 0.5, 0.2, 0.05),)
_STOPPING: Final = Stopping(iterations=7, gain=2e-3)
# Smallest relative reduction of the cost, in the linear model, for a further fit.
_SETTLED = 1e-5


Fitted = tuple[Linearisation, Components]
"""Linearisation at the optimum of an explanation, and its components."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """Faults and causes that explain a window."""

    at: Linearisation
    """Linearisation at the estimate, with respect to all components."""
    kept: Components
    """Components that differ from healthy, ``(d,)``."""
    confused: Components
    """Components that could replace a part of the explanation, ``(d,)``."""
    alternatives: list[Alternative]
    """Parts of the explanation and their possible replacements, by name."""
    open: Explanations
    """Explanations that the window cannot distinguish from the estimate."""
    far: Array
    """Second moment about the estimate of the explanations that were compared with the full model,
    ``(d, d)``."""


class Explainer:
    """Search for the explanation of a window.

    Parameters
    ----------
    objective
        Objective of the window, with hidden causes as components.
    always
        Flags of the components that need no evidence, ``(d,)``: all except suspected hidden causes.
    most_evaluations
        Number of model evaluations after which no further cause is tried.
    seeds
        Additional starting values of hidden causes by name, in their units.
    remembered
        Function that returns the surprise, ``(...)``, of points, ``(..., d)``, given the earlier
        tests of the unit. None without earlier tests.
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
        """Return the explanation of the window.

        Parameters
        ----------
        point
            Optimum of the faults alone, ``(d,)``.
        """
        fitted = self._always
        at = self._objective.linearise(point, fitted)
        # The significance test of the faults needs only the derivatives of the fitted components.
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
            # The optimum of the faults alone may be a poor starting point.
            trial = kept | self._always
            at, kept = self._better(self._objective.healthy[None], trial, at, kept) or (at, kept)
        return self._with_equal_motors(at, kept)

    def _with_equal_motors(self, at: Linearisation, kept: Components) -> Explanation:
        """Return the explanation after a comparison with motors of the same strength.

        Equal short circuits of all phases weaken the motor like a smaller torque constant, or like
        a larger inertia and friction. Because these explanations are far apart, they are compared
        with the full model instead of the linear model. A better explanation replaces the current
        explanation. An explanation that the window cannot distinguish increases the uncertainty
        according to its distance.
        """
        evidence, replacements = self._evidence, self._equal_motors(at, kept)
        points = np.stack([at.point, *(point for _, _, point in replacements)])
        _, *rows = self._objective.residuals(points)
        worse, named = [0.0], []
        for (group, stand_in, point), row in zip(replacements, rows, strict=True):
            replaced = Linearisation(point, row, at.jacobian)
            worse.append(evidence.against(replaced, at, REMEMBERED_EVIDENCE))
            penalty = evidence.penalty(including(excluding(kept, group), stand_in))
            if worse[-1] + penalty - evidence.penalty(kept) < _ABOUT and self._can_afford_more:
                trial = including(excluding(kept | self._always, group), stand_in)
                better = self._better(point[None], trial, at, kept)
                if better is not None:
                    return self._with_equal_motors(*better)
            more_causes = (stand_in[0] in self._suspects) - (group[0] in self._suspects)
            worse[-1] += UNUSUAL_EVIDENCE * more_causes
            named.append(evidence.named(group, stand_in))
        confused, linear, pairs = evidence.alternatives(at, kept, self._tried)
        near = np.array(worse) < AMBIGUOUS_EVIDENCE
        compared = Explanations(np.array(worse)[near], (points - at.point)[near])
        # The linear model is not used for the explanations that the full model compared.
        rest = np.array([False, *(pair not in named for pair in pairs)])
        linear = (values[rest] for values in linear)
        return Explanation(
            at,
            kept,
            confused,
            [*compress(named, near[1:]), *compress(pairs, rest[1:])],
            Explanations(*map(np.concatenate, zip(compared, linear, strict=True))),
            compared.spread,
        )

    def _equal_motors(
        self, at: Linearisation, kept: Components
    ) -> list[tuple[list[int], list[int], Array]]:
        """Return replacements in the explanation that do not change the strength of the motor.

        Each item consists of the replaced components, their replacements, and the point, ``(d,)``.
        """
        healthy = [phase for phase in SHORT_CIRCUITS if not kept[phase]]
        least = min(SHORT_CIRCUITS, key=lambda phase: float(at.point[phase]))
        causes = [[n] for n in self._suspects if self._prior(n).name in _WEAKER]
        result = []
        for group in [part for part in [*causes, [least]] if kept[part[0]]]:
            strength = self._strength(at.point, group[0])
            without = self._strengthened(at.point, group[0], 1.0 / strength)
            for stand_in in [*causes, healthy or SHORT_CIRCUITS]:
                if stand_in != group and not (group == [least] and stand_in[0] in SHORT_CIRCUITS):
                    point = self._strengthened(without, stand_in[0], strength)
                    result.append((group, stand_in, point))
        return result

    def _prior(self, cause: int) -> Prior:
        return self._objective.hidden_causes[cause - self._causes.start]

    def _strength(self, point: Array, number: int) -> float:
        """Return the factor by which a short circuit or cause changes the motor's strength [-]."""
        if number in SHORT_CIRCUITS:
            return 1.0 - float(point[number])
        cause = self._prior(number)
        return (1.0 + cause.reach * (2.0 * float(point[number]) - 1.0)) ** _WEAKER[cause.name]

    def _strengthened(self, point: Array, number: int, factor: float) -> Array:
        """Return a point with the motor's strength scaled by short circuits or a cause."""
        result = point.copy()
        if number in SHORT_CIRCUITS:
            result[SHORT_CIRCUITS] = 1.0 - factor * (1.0 - point[SHORT_CIRCUITS])
        else:
            cause = self._prior(number)
            value = (factor * self._strength(point, number)) ** _WEAKER[cause.name] - 1.0
            result[number] = 0.5 + value / (2.0 * cause.reach)
            if cause.name == "inertia":
                result[FRICTION] = ((1.0 + 2.0 * point[FRICTION]) / factor - 1.0) / 2.0
                for load in (n for n in self._causes if self._prior(n).name in _LOADS):
                    expected = self._prior(load).expected / (2.0 * self._prior(load).reach)
                    result[load] = 0.5 + (point[load] - 0.5 + expected) / factor - expected
        return np.clip(result, 0.0, 1.0)

    def _worth_trying(self, at: Linearisation) -> Components:
        """Return the components whose derivatives are worth their model evaluations, ``(d,)``.

        Causes that change the initial position are excluded if the window is explained and its
        columns are consistent. A wrong initial position would leave the window unexplained, or
        would contradict the speed.
        """
        objective = self._objective
        if at.cost > objective.fitness.good_cost or not objective.relations.are_healthy:
            return np.ones_like(self._always)
        moves = [cause.name in MOVES_START for cause in objective.hidden_causes]
        return self._always | ~np.array([False] * objective.first_cause + moves)

    def _with_causes(self, at: Linearisation, kept: Components) -> Fitted:
        """Return the explanation extended by hidden causes with sufficient evidence."""
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
        remaining = self._most_evaluations - self._objective.evaluations
        return remaining >= (1 + _STOPPING.iterations) * self._objective.linearisation_evaluations

    def _is_doubtful(self, at: Linearisation, kept: Components) -> bool:
        """Return whether the window is unexplained, or only explained by an unusual cause."""
        if not self._suspects:
            return False
        distances = np.abs(self._objective.cause_sigmas(at.point))
        if np.any(distances[kept[self._causes.start :]] > DOUBTFUL_SIGMAS):
            return True
        shown = [cause for cause in self._suspects if kept[cause]]
        motor = [cause for cause in shown if self._prior(cause).name in _WEAKER]
        if np.any(
            distances[np.array(motor, dtype=int) - self._causes.start] > DOUBTFUL_MOTOR_SIGMAS
        ):
            return True
        # If one of these explanations is right, it needs no further cause.
        are_all_shorted = bool(np.all(kept[SHORT_CIRCUITS]))
        if (motor or are_all_shorted) and len(shown) + are_all_shorted > 1:
            return True
        return at.cost > self._objective.fitness.good_cost and at.cost > self._objective.fair_cost()

    def _elsewhere(self, at: Linearisation, kept: Components) -> list[tuple[Array, Components]]:
        """Return further starting points, ``(d,)``, with their components, by increasing cost.

        In each point, a cause that is not part of the explanation has a trial value, and all other
        components are as in the explanation or healthy. Only the best point of each cause is
        returned, and at most ``_MOST_SEEDS`` points. The list is empty if the budget permits no
        further fit.
        """
        if not self._can_afford_more:
            return []
        objective = self._objective
        healthy = objective.healthy
        points, trials, numbers = [], [], []
        for number in self._suspects:
            cause = objective.hidden_causes[number - self._causes.start]
            values = [cause.sigma * sigmas for sigmas in _SEEDED.get(cause.name, ())]
            for value in (*values, *self._seeds.get(cause.name, ())):
                if kept[number]:
                    continue
                for base, shown in ((at.point, kept), (healthy, np.zeros_like(kept))):
                    point = base.copy()
                    point[number] = np.clip(0.5 + value / (2.0 * cause.reach), 0.0, 1.0)
                    points.append(point)
                    trials.append(including(shown | self._always, [number]))
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
        """Return the fit of the components ``trial``, or None if it is not a better explanation.

        The fit begins at the best of several ``starts``, ``(m, d)``.
        """
        point = self._descended(starts, trial)
        fitted = self._objective.linearise(point, trial)
        if not np.all(np.isfinite(fitted.jacobian)):
            return None  # two phases without turns: the model has no finite response
        reduced, shown = self._reduced(fitted, trial)
        penalty = self._evidence.penalty(shown) - self._evidence.penalty(kept)
        if self._evidence.against(reduced, at) >= -(penalty or REPLACED_EVIDENCE):
            return None
        return self._objective.extended(reduced, self._tried), shown

    def _promising(self, at: Linearisation, kept: Components) -> Components | None:
        """Return the components of the best explanation with an additional cause, or None.

        The linear model is inaccurate over large steps. Therefore an explanation with fewer
        components is tried even if it fits slightly worse in the linear model.
        """
        evidence = self._evidence
        groups = evidence.groups(kept)
        trials, advantages = [], []
        for cause in self._causes:
            if kept[cause] or not self._tried[cause]:
                continue
            added = including(kept, [cause])
            # The cause may have masked faults.
            trials.append(added | self._always)
            advantages.append(evidence.penalty(kept) - evidence.penalty(added))
            # The new cause may replace one of the parts.
            for group in groups:
                trials.append(excluding(added, group))
                advantage = evidence.penalty(kept) - evidence.penalty(trials[-1])
                is_fewer = components(trials[-1]) < components(kept)
                advantages.append(advantage + AMBIGUOUS_EVIDENCE * is_fewer)
        if not trials:
            return None
        gains = np.array(advantages) - evidence.worse(at, np.array(trials))
        best = int(np.argmax(gains))
        return trials[best] if gains[best] > 0.0 else None

    def _descended(self, starts: Array, free: Components) -> Array:
        """Return the optimum of the free components, ``(d,)``, from the best start, ``(m, d)``."""
        objective = self._objective
        problem = LeastSquaresProblem(
            objective.residuals, lambda point: objective.linearise(point, free)
        )
        search = LineSearch(lambda at: refitted(at, at.point, free), _SHARES)
        return descend(problem, starts, search, _STOPPING).point

    def _reduced(self, at: Linearisation, fitted: Components) -> Fitted:
        """Return the fit with insignificant components set to healthy and the rest fitted again.

        If this increases the cost too much, the fit is returned unchanged.
        """
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
        refined = objective.linearise(point, kept)
        return (refined if refined.cost < at.cost else at), kept
