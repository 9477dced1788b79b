"""How explanations of a window compare: by what they leave, and by how usual they are (M27)."""

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
"""What a component is worth: how much a set with one less may be higher."""

REPLACED_EVIDENCE: Final = 6.0
"""What a cause must lower the evidence by to take the place of a fault."""

UNUSUAL_EVIDENCE: Final = 2.0
"""How much more usual a fault is than a cause among explanations that a window leaves open."""

AMBIGUOUS_EVIDENCE: Final = 8.0
"""Up to this difference the window does not tell two explanations apart."""

REMEMBERED_EVIDENCE: Final = 3.0
"""How much earlier tests tell at most between explanations that the window leaves open."""

Components = Flags
"""A set of components, ``(d,)``."""


class Explanations(NamedTuple):
    """Explanations that a window does not separate; the first one is the estimate (M27)."""

    worse: Array  # by how much the evidence against each is higher, (k,)
    steps: Array  # from the estimate to each, in the unit box, (k, d)

    @property
    def weights(self) -> Array:
        """Probability of each, ``(k,)``; the estimate, which the search chose, has half or more."""
        odds = np.exp(-np.maximum(self.worse, -100.0) / 2.0)
        odds[1:] /= max(1.0, float(np.sum(odds[1:])))
        return odds / np.sum(odds)

    @property
    def spread(self) -> Array:
        """Second moment about the estimate, ``(d, d)``."""
        return (self.steps.T * self.weights) @ self.steps


class _Quadratic(NamedTuple):
    """The cost about a linearisation, and its part by priors of causes and by relations."""

    at: Linearisation
    cost: Quadratic
    by_priors: Quadratic

    @classmethod
    def of(cls, at: Linearisation, objective: Objective) -> Self:
        rows = objective.surprising_rows
        of_priors = at._replace(residuals=at.residuals[rows], jacobian=at.jacobian[rows])
        return cls(at, Quadratic.of(at).with_ridge(), Quadratic.of(of_priors))


class Evidence:
    """Compares sets of faults and hidden causes as explanations of a window.

    A set is worth ``n ln(cost) + z^2``, and how much it surprises after the unit's earlier tests,
    less being better, with ``n`` effective residuals, the cost of the window alone, and ``z^2`` the
    squared distance of its causes from what is usual: where the model does not match the unit, the
    window counts less, but no cause gets more usual.

    Parameters
    ----------
    objective
        Of the window.
    suspects
        Numbers of the components that are hidden causes which need evidence.
    remembered
        Returns how much points, ``(..., d)``, surprise after the earlier tests, ``(...)``; None
        where there are none.
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
        # Of the latest linearisation: gradient and normal matrix, cheap to minimise for many sets.
        self._quadratic: _Quadratic | None
        self._quadratic = None

    def against(self, one: Linearisation, other: Linearisation, most: float = np.inf) -> float:
        """Return by how much the first is worse, of which earlier tests tell so much at most."""
        return float(self._difference(one.cost, one.point, other, most))

    def worse(self, at: Linearisation, sets: Components, most: float = np.inf) -> Array:
        """Return by how much the linear model's optima with only some components are worse.

        The ``sets`` are ``(n, d)``, the result is ``(n,)``; ``most`` as of `against`.
        """
        return self._difference(*self._optima(at, sets), at, most)

    def price(self, kept: Components) -> float:
        """Return what a set must lower the evidence by against a healthy motor."""
        causes = int(np.sum(kept[self._suspects]))
        return COMPONENT_EVIDENCE * components(kept) + REPLACED_EVIDENCE * causes

    def predicted(self, at: Linearisation, shown: Components) -> Array:
        """Return the linear model's optimum with only some components, ``(d,)``."""
        return self._optima(at, shown[None])[1][0]

    def _optima(self, at: Linearisation, sets: Components) -> tuple[Array, Array]:
        """Return costs, ``(n,)``, and points, ``(n, d)``."""
        from ema_monitor.optimizers.bounded_quadratic import lowest_of_each  # with the compiler

        objective = self._objective
        if self._quadratic is None or self._quadratic.at is not at:
            self._quadratic = _Quadratic.of(at, objective)
        _, (_, gradient, normal), (_, of_priors, by_priors) = self._quadratic
        starts = np.where(sets, at.point, objective.healthy)
        points = lowest_of_each(normal, gradient, at.point, starts, sets)
        moves = points - at.point
        # Priors with heavy tails are far from linear.
        gradient, normal = gradient - of_priors, normal - by_priors
        surprised = objective.noise * (objective.surprise(points) - objective.surprise(at.point))
        costs = at.cost + np.sum((2.0 * gradient + moves @ normal) * moves, axis=1) + surprised
        return np.maximum(costs, 1e-12 * at.cost), points

    def alternatives(
        self, at: Linearisation, kept: Components, tried: Components
    ) -> tuple[Components, Explanations, list[Alternative]]:
        """Return which of those ``tried`` could stand in for what is kept, with them, pairs."""
        confused = np.zeros_like(kept)
        found, worse, steps = [], [0.0], [np.zeros_like(at.point)]
        for group in self.groups(kept):
            without = excluding(kept, group)
            fewer = components(kept) - components(without)
            others = self._stand_ins(group, kept, tried)
            sets = np.array([without, *(including(without, other) for other in others)])
            of_none, *differences = self.worse(at, sets, REMEMBERED_EVIDENCE).tolist()
            # What hardly shows is not worth an alternative.
            most = min(
                AMBIGUOUS_EVIDENCE + COMPONENT_EVIDENCE * (fewer - 1), of_none - COMPONENT_EVIDENCE
            )
            for other, trial, difference in zip(others, sets[1:], differences, strict=True):
                if difference < most:
                    found.append(self.named(group, other))
                    confused[other] = True
                    worse.append(difference - COMPONENT_EVIDENCE * (fewer - 1))
                    steps.append(self.predicted(at, trial) - at.point)
        return confused, Explanations(np.array(worse), np.array(steps)), found

    def groups(self, kept: Components) -> list[list[int]]:
        """Return what may be replaced: each component kept, and short circuits together."""
        groups = self.singles(kept)
        shorted = [phase for phase in SHORT_CIRCUITS if kept[phase]]
        if len(shorted) == len(SHORT_CIRCUITS):
            groups += [list(pair) for pair in combinations(shorted, 2)]
        if len(shorted) > 1:
            groups.append(shorted)
        return groups

    def singles(self, kept: Components) -> list[list[int]]:
        """Return each fault and each suspect that is kept; the vector of eccentricity is one."""
        groups = [group for group in GROUPS if kept[group[0]]]
        return groups + [[cause] for cause in self._suspects if kept[cause]]

    def _stand_ins(self, group: list[int], kept: Components, tried: Components) -> list[list[int]]:
        """Return what could take the place of a part of an explanation."""
        others = [[cause] for cause in self._suspects if tried[cause] and not kept[cause]]
        if group[0] in self._suspects:
            healthy = [phase for phase in SHORT_CIRCUITS if not kept[phase]]
            others += [one for one in GROUPS if not kept[one[0]]]
            others += [healthy] if len(healthy) > 1 else []
        return others

    def _difference(
        self, cost: Array | float, point: Array, other: Linearisation, most: float
    ) -> Array:
        remembered = self._remembered(point) - self._remembered(other.point)
        of_window = self._value(cost, point) - self._value(other.cost, other.point)
        return of_window + np.clip(remembered, -most, most)

    def _value(self, cost: Array | float, point: Array) -> Array:
        objective = self._objective
        surprise = objective.surprise(point)
        of_window = np.maximum(cost - objective.noise * surprise, 1e-12 * cost)
        return objective.fitness.effective * np.log(of_window) + surprise

    def named(self, group: list[int], other: list[int]) -> Alternative:
        """Return what is kept, and what could stand in for it, by name."""
        return Alternative(self._part(group), self._part(other))

    def _part(self, group: list[int]) -> Part:
        first = group[0]
        if first in SHORT_CIRCUITS:
            return tuple(FAULT_NAMES[phase] for phase in group)
        if first < N_FAULTS:
            return (FAULT_NAMES[first],)
        return (self._objective.hidden_causes[first - self._objective.first_cause].name,)


def including(kept: Components, group: list[int]) -> Components:
    """Return a set with some components more."""
    more = kept.copy()
    more[group] = True
    return more


def excluding(kept: Components, group: list[int]) -> Components:
    """Return a set without some components."""
    rest = kept.copy()
    rest[group] = False
    return rest


def components(kept: Components) -> int:
    """Return the number of components, the vector of eccentricity as one."""
    return int(np.sum(kept)) - int(kept[ECCENTRICITY] and kept[ECCENTRICITY_PHASE])
