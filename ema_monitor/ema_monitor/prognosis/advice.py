# SPDX-License-Identifier: Apache-2.0
"""Maintenance advice with the lowest expected cost (docs/prognosis.md, P18-P20)."""

import math
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array
from ema_core.labels import label_of
from ema_core.levels import ERROR
from ema_core.quantity import Checked, quantity, text
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.sentences import removal_text

Action = Literal["unknown", "continue", "inspect", "remove"]
"""Kinds of advice."""

_GROUPS: Final = 10
_MOST_MISSING: Final = 8


@dataclass(frozen=True)
class Costs(Checked):
    """Costs of removal, failure and inspection, in a common unit chosen by the user."""

    inspection: float = quantity(
        0.0, "-", 0.0, 1e12, "cost of an inspection, in costs.unit; 0: no inspection is advised"
    )
    removal: float = quantity(
        0.0, "-", 0.0, 1e12, "cost of a planned removal, in costs.unit; 0: no advice is given"
    )
    failure: float = quantity(
        0.0, "-", 0.0, 1e12, "cost of a failure with its removal, in costs.unit"
    )
    lead_time: float = quantity(0.0, "h", 0.0, 1e6, "service hours from a decision to a removal")
    unit: str = text("", "unit of the costs")

    @property
    def defect(self) -> str:
        """Reason why the costs do not permit advice; empty if they do."""
        if self.removal == 0.0:
            return "no costs are given: costs.removal and costs.failure are not set"
        if self.failure <= self.removal:
            return (
                f"costs.failure = {self.failure:g}: expected more than costs.removal = "
                f"{self.removal:g}; otherwise a planned removal never pays"
            )
        return ""


class Choice(NamedTuple):
    """Maintenance plan: removal time, risk, and expected cost and service life."""

    cost: float
    hours: float
    """Expected cost, and expected service hours over the whole life [h]."""
    removal_hours: float
    """Hours from now to the removal [h], or to the earliest removal after the next test if the
    decision waits for it."""
    risk: float
    """Probability of a failure before the removal [-]."""

    @property
    def rate(self) -> float:
        """Cost per service hour over the life."""
        return self.cost / self.hours if self.hours > 0.0 else np.inf


@dataclass(frozen=True, eq=False)
class Decision:
    """A maintenance decision after a test."""

    costs: Costs
    """Costs and lead time."""
    hours: float
    """Current service hours [h]."""
    interval_hours: float
    """Hours to the next test [h]."""
    lives: Array
    """Equally probable remaining lives, truncated at the horizon, ``(n,)`` [h]."""
    missing_share: float = 0.0
    """Probability that a test gives no valid estimate [-]."""
    tests_tell: bool = True
    """Whether the next test will show the dominant fault."""

    def remove(self) -> Choice:
        """Return the best of the removals that must be decided before the next test (P18)."""
        lead = self.costs.lead_time
        between = self.lives[(self.lives > lead) & (self.lives < lead + self.interval_hours)]
        return self.removed_at(np.concatenate([[lead], np.sort(between)]))

    def wait(self) -> Choice:
        """Return the expected outcome of deciding after the next test (P19).

        If the test shows the fault, the remaining life is assumed to be known exactly afterwards.
        Lives that end before a removal could follow the test are failures. All others end with a
        removal one test interval before the failure, or with the earliest possible removal if that
        is later. With the probability ``missing_share``, a test gives no estimate, and the decision
        waits for the following test. If the test does not show the fault, the best removal
        according to current knowledge is used.
        """
        # Hours until the first, second, ... test from now, each possibly the next with an estimate.
        waits = self.costs.lead_time + self.interval_hours * np.arange(1, _MOST_MISSING + 1)
        earliest = float(waits[0])
        if not self.tests_tell:
            later = np.sort(self.lives[self.lives > earliest])
            return self.removed_at(np.concatenate([[earliest], later]))
        probability = self.missing_share ** np.arange(_MOST_MISSING)
        probability /= probability.sum()
        fails = self.lives < waits[:, None]
        before_end = np.maximum(self.lives - self.interval_hours, waits[:, None])
        used = probability @ np.mean(np.where(fails, self.lives, before_end), axis=1)
        risk = float(probability @ np.mean(fails, axis=1))
        return Choice(self._cost(risk), self.hours + float(used), earliest, risk)

    def inspect(self, levels: Array) -> Choice:
        """Return the expected outcome of inspecting now, which measures the current level (P20).

        Parameters
        ----------
        levels
            Current distance of the dominant fault from healthy in each of ``lives``, ``(n,)`` [-].
        """
        order = np.argsort(levels, kind="stable")
        chosen = [
            self._judged(training, held_out)
            for group in np.array_split(order, _GROUPS)
            # Evaluate each choice on held-out lives to avoid optimistic bias.
            for training, held_out in ((group[::2], group[1::2]), (group[1::2], group[::2]))
        ]
        cost, hours, removal, risk = np.mean(np.array(chosen), axis=0).tolist()
        return Choice(cost + self.costs.inspection, hours, removal, risk)

    def _judged(self, training: NDArray[np.intp], held_out: NDArray[np.intp]) -> Choice:
        """Return the optimum for the training lives, evaluated on the held-out lives."""
        planned, real = (replace(self, lives=self.lives[part]) for part in (training, held_out))
        removal, waiting = planned.remove(), planned.wait()
        if waiting.rate < removal.rate:
            return real.wait()
        return real.removed_at(np.array([removal.removal_hours]))

    def removed_at(self, at_hours: Array) -> Choice:
        """Return the removal with the lowest cost rate among candidate hours from now [h] (P18)."""
        lives = np.sort(self.lives)
        fail = np.searchsorted(lives, at_hours, "left")
        risk = fail / lives.size
        until = np.concatenate([[0.0], np.cumsum(lives)])[fail] / lives.size
        hours = self.hours + until + (1.0 - risk) * at_hours
        cost = self._cost(risk)
        # The rate is undefined at 0 hours.
        rate = np.divide(cost, hours, out=np.full_like(hours, np.inf), where=hours > 0.0)
        k = int(np.argmin(rate))
        return Choice(float(cost[k]), float(hours[k]), float(at_hours[k]), float(risk[k]))

    def _cost(self, risk: Any) -> Any:
        return self.costs.removal + (self.costs.failure - self.costs.removal) * risk


@dataclass(frozen=True)
class Advice:
    """Advised action for a unit and its time."""

    action: Action
    """"unknown", "continue", "inspect" or "remove"."""
    reason: str
    """Reason for the advice, as a sentence."""
    flight_hours: float = math.nan
    from_now: float = math.nan
    """Service hour of the action or of the next decision, and hours from the latest test to it [h];
    NaN when unknown."""
    probability_of_failure: float = math.nan
    """Probability of a failure before that hour [-]; NaN if unknown."""
    expected_cost: float = math.nan
    """Expected cost per service hour over the life with this advice; NaN when unknown."""
    cost_of_immediate_removal: float = math.nan
    """Expected cost per service hour with the earliest possible removal; NaN when unknown."""


def advise(outlook: Outlook, costs: Costs) -> Advice:
    """Return the advice for a unit after its latest test (docs/prognosis.md, P18 to P20)."""
    rul, now = outlook.rul, outlook.flight_hours
    if costs.defect:
        return Advice("unknown", costs.defect)
    items = (*outlook.health.faults, *outlook.health.requirements)
    if any(item.level == ERROR for item in items):
        return Advice("remove", removal_text(outlook), now, 0.0, 1.0)
    if math.isnan(now):
        return Advice("unknown", rul.reason)
    if not rul.known:
        return Advice(
            "continue",
            f"the remaining life is unknown: {rul.reason}; decide again after the next test",
        )
    test = outlook.hours_per_cycle
    if not test > 0.0:
        return Advice("unknown", "the service hours from test to test are unknown")
    lives = np.minimum(outlook.lifetimes, outlook.horizon_hours)
    decision = Decision(costs, now, test, lives, outlook.missing_share, outlook.tests_tell)
    removal, waiting = decision.remove(), decision.wait()
    at_once = decision.removed_at(np.array([costs.lead_time]))

    def per_hour(rate: float) -> str:
        return f"{rate:.3g} {costs.unit}".strip() + "/h"

    least = min(removal.rate, waiting.rate)
    if costs.inspection > 0.0 and outlook.levels.size:
        inspection = decision.inspect(outlook.levels)
        if inspection.rate < least:
            reason = (
                f"an inspection now, which measures {label_of(outlook.dominant_fault)}, reduces "
                f"the expected cost from {per_hour(least)} to {per_hour(inspection.rate)}"
            )
            return Advice("inspect", reason, now, 0.0, 0.0, inspection.rate, at_once.rate)
    grounds = (
        f"{100.0 * waiting.risk:.2g} % risk of failure until a removal can follow the next test, "
        f"in {waiting.removal_hours:,.0f} h; {per_hour(waiting.rate)} if the decision waits, "
        f"{per_hour(removal.rate)} if not"
    )
    if waiting.rate < removal.rate:
        reason = f"the decision can wait for the next test: {grounds}"
        fails = float(np.mean(lives < test))
        return Advice("continue", reason, now + test, test, fails, waiting.rate, at_once.rate)
    until, reason = removal.removal_hours, f"the removal must not wait: {grounds}"
    return Advice("remove", reason, now + until, until, removal.risk, removal.rate, at_once.rate)
