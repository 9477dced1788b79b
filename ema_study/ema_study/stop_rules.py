"""The thesis's stop rules (its section 7.1), each a `StopRule` of the optimizers' driver.

Their best costs begin with that of the starting population. GA, PSO and DE do not count
it as a generation, GWO does (appendix B evaluates it within its first iteration). The ``budget`` of
each is the largest number of evaluations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ema_monitor.optimizers.driver import StopRule

THRESHOLD: Final = 1e-3
"""Cost at which DE and GWO, and the study of speed, stop in the thesis [A^2.s]."""

TOLERANCES: Final = {"ga": 1e-9, "pso": 1e-9, "de": 1e-12, "gwo": 1e-16}
"""Function tolerance by family of algorithms: a share for GA and PSO [-], else [A^2.s]."""

_STALL_GENERATIONS = {"ga": 50, "pso": 20}


@dataclass(frozen=True)
class AllGenerations:
    """Never before the budget is spent (tables 9 and 10)."""

    budget: int

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return False."""
        return False


@dataclass(frozen=True)
class Threshold:
    """At a cost [A^2.s], at once (table 56)."""

    budget: int
    threshold: float

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return whether the best cost has reached the threshold."""
        return best_costs[-1] <= self.threshold


@dataclass(frozen=True)
class ThresholdAndStall:
    """Below a cost, once the last generation improved by less than a tolerance (DE and GWO).

    Threshold and tolerance in [A^2.s]; ``uncounted`` populations at the start are no generation,
    and it does not stop in the first ``patience`` generations.
    """

    budget: int
    threshold: float
    tolerance: float
    uncounted: int
    patience: int = 20

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return whether all three conditions hold."""
        return (
            len(best_costs) - self.uncounted > self.patience
            and best_costs[-1] < self.threshold
            and best_costs[-2] - best_costs[-1] < self.tolerance
        )


@dataclass(frozen=True)
class RelativeStall:
    """When the best cost falls by less than a share of itself in some generations (GA and PSO).

    The fall is ``averaged``, divided by the number of generations, as by Matlab's ``ga``;
    ``particleswarm`` does not.
    """

    budget: int
    generations: int
    tolerance: float
    averaged: bool

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return whether the fall over the last generations is too small."""
        if len(best_costs) - 1 <= self.generations:
            return False
        fall = best_costs[-1 - self.generations] - best_costs[-1]
        if self.averaged:
            fall /= self.generations
        return fall <= self.tolerance * best_costs[-1]


@dataclass(frozen=True)
class Unchanged:
    """When the best point is the same for some generations in a row (table 57)."""

    budget: int
    generations: int = 10

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return whether the best cost has not changed."""
        before = best_costs[-1 - self.generations :]
        return len(before) > self.generations and before[0] == best_costs[-1]


RULES: Final = ("all_generations", "printed", "floor_corrected", "unchanged")
"""Names of the rules.

"printed" and "floor_corrected" depend on the algorithm: the stall of GA and PSO, the threshold and
stall of DE and GWO, or the threshold alone in table 56. "printed" uses the threshold as printed,
"floor_corrected" adds the cost of the true faults, below which a model without the reference's PWM
ripple hardly comes. Where the model does not describe the fault, as eq. 4.24 the eccentricity, the
true faults cost more than others, and that threshold is met at once.
"""


def stop_rule(rule: str, algorithm: str, level: str, budget: int, floor: float) -> StopRule:
    """Return the rule under which the thesis ran an algorithm.

    Parameters
    ----------
    rule
        One of ``RULES``.
    algorithm
        Registered name of the optimizer; a variant has the rule of its family.
    level
        Level of the fault; "fast_stop" for the study of speed.
    budget
        Largest number of evaluations.
    floor
        Cost of the true faults [A^2.s].

    Raises
    ------
    ValueError
        When the rule is unknown.
    """
    if rule not in RULES:
        raise ValueError(f"stop rule {rule!r} is unknown; known: {', '.join(RULES)}")
    if rule == "all_generations":
        return AllGenerations(budget)
    if rule == "unchanged":
        return Unchanged(budget)
    threshold = THRESHOLD + (floor if rule == "floor_corrected" else 0.0)
    if level == "fast_stop":
        return Threshold(budget, threshold)
    family = family_of(algorithm)
    tolerance = TOLERANCES[family]
    if family in _STALL_GENERATIONS:
        return RelativeStall(budget, _STALL_GENERATIONS[family], tolerance, averaged=family == "ga")
    return ThresholdAndStall(budget, threshold, tolerance, uncounted_populations(algorithm))


def uncounted_populations(algorithm: str) -> int:
    """Return how many populations are evaluated before the first generation is counted."""
    return 0 if family_of(algorithm) == "gwo" else 1


def family_of(algorithm: str) -> str:
    """Return the one of the thesis's four algorithms that a registered one implements."""
    return algorithm.removesuffix("_thesis")
