# SPDX-License-Identifier: Apache-2.0
"""Stop rules of the thesis (section 7.1).

The list of best costs begins with the cost of the starting population. GA, PSO and DE do not count
this population as a generation; GWO does (appendix B evaluates it within its first iteration).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

THRESHOLD: Final = 1e-3
"""Cost at which DE and GWO, and the study of speed, stop in the thesis [A^2.s]."""

_PATIENCE = 20
_UNCHANGED = 10
# A search has stalled if the lowest cost falls by less than this share over these generations.
_STALLS = {"ga": (50, 1e-9), "pso": (20, 1e-9)}
# Improvement in the last generation [A^2.s].
_TOLERANCES = {"de": 1e-12, "gwo": 1e-16}

BestCosts = Sequence[float]


@dataclass(frozen=True)
class Rule:
    """Stop rule for ``ema_monitor.optimizers.driver.minimise``."""

    budget: int
    """Largest number of evaluations."""
    condition: Callable[[BestCosts], bool]
    """Function that decides from the lowest costs so far whether to stop."""
    threshold: float | None = None
    """Cost at which the rule may stop [A^2.s]; None if it has no threshold."""

    def reached(self, best_costs: BestCosts) -> bool:
        """Return whether to stop, given the lowest cost after each generation so far."""
        return self.condition(best_costs)


def stop_rule(rule: str, algorithm: str, level: str, budget: int, floor: float) -> Rule:
    """Return the stop rule of a run.

    Rules are "all_generations" (tables 9 and 10), "unchanged" (table 57), "printed" and
    "floor_corrected". The last two depend on the algorithm: the stall of GA and PSO, threshold and
    stall of DE and GWO, or the threshold alone in table 56. "printed" uses the printed threshold.
    "floor_corrected" adds the cost of the true faults, ``floor`` [A^2.s]: a model without the PWM
    ripple of the reference hardly reaches a lower cost.

    Raises
    ------
    ValueError
        If the rule is unknown.
    """
    family, uncounted = family_of(algorithm), uncounted_populations(algorithm)
    threshold = THRESHOLD + (floor if rule == "floor_corrected" else 0.0)

    def has_stalled(best: BestCosts) -> bool:
        generations, tolerance = _STALLS[family]
        if len(best) - 1 <= generations:
            return False
        fall = best[-1 - generations] - best[-1]
        # Matlab's ga takes the mean over the generations, its particleswarm does not.
        return (fall / generations if family == "ga" else fall) <= tolerance * best[-1]

    def is_below_and_still(best: BestCosts) -> bool:
        is_late = len(best) - uncounted > _PATIENCE
        return is_late and best[-1] < threshold and best[-2] - best[-1] < _TOLERANCES[family]

    def has_not_changed(best: BestCosts) -> bool:
        return len(best) > _UNCHANGED and best[-1 - _UNCHANGED] == best[-1]

    if rule == "all_generations":
        return Rule(budget, lambda best: False)
    if rule == "unchanged":
        return Rule(budget, has_not_changed)
    if rule not in ("printed", "floor_corrected"):
        raise ValueError(f"stop rule {rule!r} is unknown")
    if level == "fast_stop":
        return Rule(budget, lambda best: best[-1] <= threshold, threshold)
    if family in _STALLS:
        return Rule(budget, has_stalled)
    return Rule(budget, is_below_and_still, threshold)


def uncounted_populations(algorithm: str) -> int:
    """Return the number of populations evaluated before the first counted generation."""
    return 0 if family_of(algorithm) == "gwo" else 1


def family_of(algorithm: str) -> str:
    """Return the thesis's algorithm ("ga", "pso", "de" or "gwo") that an algorithm implements."""
    return algorithm.removesuffix("_thesis")
