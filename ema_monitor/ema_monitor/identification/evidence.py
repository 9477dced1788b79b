# SPDX-License-Identifier: Apache-2.0
"""Comparison of explanations of a window by residuals and prior probability.

The method is described in ``docs/identification.md``, M27.
"""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, FAULT_NAMES, N_FAULTS, SHORT_CIRCUITS
from ema_monitor.identification.alternatives import Alternative, Part
from ema_monitor.identification.objective import Objective
from ema_monitor.identification.uncertainty import GROUPS
from ema_monitor.optimizers.linear_model import Linearisation, Quadratic

COMPONENT_EVIDENCE: Final = 8.0
"""Penalty per component: the advantage that an additional component must have."""

REPLACED_EVIDENCE: Final = 6.0
"""Additional penalty per hidden cause: the advantage that a cause must have to replace a fault."""

UNUSUAL_EVIDENCE: Final = 2.0
"""Advantage of a fault over a hidden cause if a window cannot distinguish their explanations."""

AMBIGUOUS_EVIDENCE: Final = 8.0
"""Largest difference in evidence at which a window cannot distinguish two explanations."""

REMEMBERED_EVIDENCE: Final = 3.0
"""Largest contribution of earlier tests to the evidence between explanations that a window cannot
distinguish."""

Components = Flags
"""Flags of the components in a set, ``(d,)``."""


class Explanations(NamedTuple):
    """Explanations that a window cannot distinguish; the first is the estimate."""

    worse: Array
    """Evidence against each explanation relative to the estimate, ``(k,)`` [-]."""
    steps: Array
    """Difference of each explanation from the estimate, in the unit box, ``(k, d)``."""

    @property
    def weights(self) -> Array:
        """Probability of each explanation, ``(k,)``; at least 0.5 for the estimate."""
        odds = np.exp(-np.maximum(self.worse, -100.0) / 2.0)
        odds[1:] /= max(1.0, float(np.sum(odds[1:])))
        return odds / np.sum(odds)

    @property
    def spread(self) -> Array:
        """Second moment of the explanations about the estimate, in the unit box, ``(d, d)``."""
        return (self.steps.T * self.weights) @ self.steps


class _Quadratic(NamedTuple):
    """Quadratic models of the cost."""

    at: Linearisation
    """Linearisation from which the models are derived."""
    cost: Quadratic
    """Model of the whole cost."""
    by_priors: Quadratic
    """Model of the part of the cost due to cause priors and column relations."""

    @classmethod
    def of(cls, at: Linearisation, objective: Objective) -> Self:
        rows = objective.surprising_rows
        of_priors = at._replace(residuals=at.residuals[rows], jacobian=at.jacobian[rows])
        return cls(at, Quadratic.of(at).with_ridge(), Quadratic.of(of_priors))


class Evidence:
    """Comparison of sets of faults and hidden causes as explanations of a window.

    The evidence against a set is ``n ln(cost) + z^2``, plus its surprise given the earlier tests of
    the unit. Here ``n`` is the number of effective residuals, ``cost`` the cost of the window
    alone, and ``z^2`` the squared distance of the causes from their priors. If the model does not
    match the unit, the window has less weight, but no cause becomes more probable.

    Parameters
    ----------
    objective
        Objective of the window.
    suspects
        Component indices of the hidden causes that need evidence.
    remembered
        Function that returns the surprise, ``(...)``, of points, ``(..., d)``, given the earlier
        tests. None without earlier tests.
    """

    def __init__(
        self,
        objective: Objective,
        suspects: Sequence[int],
        remembered: Callable[[Array], Array] | None = None,
    ) -> None:
        self._objective = objective
        self._remembered = remembered or (lambda points: np.zeros(points.shape[:-1]))
        self._suspects = suspects
        # Gradient and normal matrix of the latest linearisation are reused for many sets.
        self._quadratic: _Quadratic | None
        self._quadratic = None

    def against(
        self, trial: Linearisation, reference: Linearisation, most: float = np.inf
    ) -> float:
        """Return the evidence against an explanation relative to a reference [-].

        Parameters
        ----------
        trial, reference
            The explanations.
        most
            Largest contribution of earlier tests.
        """
        return float(self._difference(trial.cost, trial.point, reference, most))

    def worse(self, at: Linearisation, sets: Components, most: float = np.inf) -> Array:
        """Return the evidence against sets of components, at their optima in the linear model.

        Parameters
        ----------
        at
            Linearisation, which is also the reference of the evidence.
        sets
            Sets of components, ``(n, d)``.
        most
            Largest contribution of earlier tests.

        Returns
        -------
        numpy.ndarray
            Evidence against each set, ``(n,)`` [-].
        """
        return self._difference(*self._optima(at, sets), at, most)

    def penalty(self, kept: Components) -> float:
        """Return the penalty of a set of components relative to the empty set [-]."""
        causes = int(np.sum(kept[self._suspects]))
        return COMPONENT_EVIDENCE * components(kept) + REPLACED_EVIDENCE * causes

    def predicted(self, at: Linearisation, shown: Components) -> Array:
        """Return the optimum of the linear model restricted to some components, ``(d,)``."""
        return self._optima(at, shown[None])[1][0]

    def _optima(self, at: Linearisation, sets: Components) -> tuple[Array, Array]:
        """Return the cost, ``(n,)``, and the point, ``(n, d)``, at the optimum of each set."""
        from ema_monitor.optimizers.bounded_quadratic import lowest_of_each  # with the compiler

        objective = self._objective
        if self._quadratic is None or self._quadratic.at is not at:
            self._quadratic = _Quadratic.of(at, objective)
        _, (_, gradient, normal), (_, of_priors, by_priors) = self._quadratic
        starts = np.where(sets, at.point, objective.healthy)
        points = lowest_of_each(normal, gradient, at.point, starts, sets)
        moves = points - at.point
        # Priors with heavy tails are far from quadratic: their exact cost is added.
        gradient, normal = gradient - of_priors, normal - by_priors
        surprised = objective.noise * (objective.surprise(points) - objective.surprise(at.point))
        costs = at.cost + np.sum((2.0 * gradient + moves @ normal) * moves, axis=1) + surprised
        return np.maximum(costs, 1e-12 * at.cost), points

    def alternatives(
        self, at: Linearisation, kept: Components, tried: Components
    ) -> tuple[Components, Explanations, list[Alternative]]:
        """Return the alternatives to the parts of an explanation.

        Parameters
        ----------
        at
            Linearisation at the estimate.
        kept
            Components of the explanation, ``(d,)``.
        tried
            Components that may replace a part of the explanation, ``(d,)``.

        Returns
        -------
        tuple
            Components that could replace a part, ``(d,)``; the alternative explanations; and each
            part with its alternative, by name.
        """
        confused = np.zeros_like(kept)
        pairs, worse, steps = [], [0.0], [np.zeros_like(at.point)]
        for group in self.groups(kept):
            without = excluding(kept, group)
            fewer = components(kept) - components(without)
            stand_ins = self._stand_ins(group, kept, tried)
            sets = np.array([without, *(including(without, stand_in) for stand_in in stand_ins)])
            of_none, *differences = self.worse(at, sets, REMEMBERED_EVIDENCE).tolist()
            # A part with weak evidence needs no alternative.
            most = min(
                AMBIGUOUS_EVIDENCE + COMPONENT_EVIDENCE * (fewer - 1), of_none - COMPONENT_EVIDENCE
            )
            for stand_in, trial, difference in zip(stand_ins, sets[1:], differences, strict=True):
                if difference < most:
                    pairs.append(self.named(group, stand_in))
                    confused[stand_in] = True
                    worse.append(difference - COMPONENT_EVIDENCE * (fewer - 1))
                    steps.append(self.predicted(at, trial) - at.point)
        return confused, Explanations(np.array(worse), np.array(steps)), pairs

    def groups(self, kept: Components) -> list[list[int]]:
        """Return the parts that may be replaced: single components and several short circuits."""
        groups = self.singles(kept)
        shorted = [phase for phase in SHORT_CIRCUITS if kept[phase]]
        if len(shorted) == len(SHORT_CIRCUITS):
            groups += [list(pair) for pair in combinations(shorted, 2)]
        if len(shorted) > 1:
            groups.append(shorted)
        return groups

    def singles(self, kept: Components) -> list[list[int]]:
        """Return each fault and suspected cause of an explanation as a group of components.

        Both components of the eccentricity vector are in the same group.
        """
        groups = [group for group in GROUPS if kept[group[0]]]
        return groups + [[cause] for cause in self._suspects if kept[cause]]

    def _stand_ins(self, group: list[int], kept: Components, tried: Components) -> list[list[int]]:
        """Return the groups that could replace a part of an explanation."""
        stand_ins = [[cause] for cause in self._suspects if tried[cause] and not kept[cause]]
        if group[0] in self._suspects:
            healthy = [phase for phase in SHORT_CIRCUITS if not kept[phase]]
            stand_ins += [fault for fault in GROUPS if not kept[fault[0]]]
            stand_ins += [healthy] if len(healthy) > 1 else []
        return stand_ins

    def _difference(
        self, cost: Array | float, point: Array, reference: Linearisation, most: float
    ) -> Array:
        remembered = self._remembered(point) - self._remembered(reference.point)
        of_window = self._value(cost, point) - self._value(reference.cost, reference.point)
        return of_window + np.clip(remembered, -most, most)

    def _value(self, cost: Array | float, point: Array) -> Array:
        objective = self._objective
        surprise = objective.surprise(point)
        of_window = np.maximum(cost - objective.noise * surprise, 1e-12 * cost)
        return objective.fitness.effective * np.log(of_window) + surprise

    def named(self, group: list[int], stand_in: list[int]) -> Alternative:
        """Return the names of a part of an explanation and of its alternative."""
        return Alternative(self._part(group), self._part(stand_in))

    def _part(self, group: list[int]) -> Part:
        first = group[0]
        if first in SHORT_CIRCUITS:
            return tuple(FAULT_NAMES[phase] for phase in group)
        if first < N_FAULTS:
            return (FAULT_NAMES[first],)
        return (self._objective.hidden_causes[first - self._objective.first_cause].name,)


def including(kept: Components, group: list[int]) -> Components:
    """Return a set of components with a group added."""
    more = kept.copy()
    more[group] = True
    return more


def excluding(kept: Components, group: list[int]) -> Components:
    """Return a set of components with a group removed."""
    rest = kept.copy()
    rest[group] = False
    return rest


def components(kept: Components) -> int:
    """Return the number of components in a set; the eccentricity vector counts as one component."""
    return int(np.sum(kept)) - int(kept[ECCENTRICITY] and kept[ECCENTRICITY_PHASE])
