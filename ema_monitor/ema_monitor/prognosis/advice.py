"""Advice for a unit after a test: action, hour and reason."""

import math
from dataclasses import dataclass

import numpy as np

from ema_core.levels import ERROR
from ema_monitor.prognosis.advisory import Action, Costs, Decision
from ema_monitor.prognosis.forecaster import Forecaster
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.sentences import label_of, removal_in_words


@dataclass(frozen=True)
class Advice:
    """What to do with a unit, and when.

    Attributes
    ----------
    action
        "unknown", "continue", "inspect" or "remove".
    hours, from_now
        Service hour of the action, or of the decision anew, and the same from the latest test on
        [h]; NaN when unknown.
    probability
        Of a failure before that hour [-]; NaN when unknown.
    rate, rate_at_once
        Expected cost per flight hour over the life with this advice, and with the earliest removal
        that is possible; NaN when unknown.
    reason
        Why, in words.
    """

    action: Action
    hours: float
    from_now: float
    probability: float
    rate: float
    rate_at_once: float
    reason: str

    @classmethod
    def without_figures(cls, action: Action, reason: str) -> "Advice":
        """Return an advice of which no figure is known."""
        nothing = math.nan
        return cls(action, nothing, nothing, nothing, nothing, nothing, reason)


def advise(after: Forecaster, costs: Costs) -> Advice:
    """Return what to do with a unit after its latest test (docs/prognosis.md, P18 to P20).

    Parameters
    ----------
    after
        What is known after the test.
    costs
        What is lost by each action.
    """
    outlook = after.outlook
    if costs.defect:
        return Advice.without_figures("unknown", costs.defect)
    items = (*outlook.health.faults, *outlook.health.requirements)
    if any(item.level == ERROR for item in items):
        nothing = math.nan
        words = removal_in_words(outlook)
        return Advice("remove", outlook.hours, 0.0, 1.0, nothing, nothing, words)
    if after.tracker is None or math.isnan(outlook.hours):
        return Advice.without_figures("unknown", outlook.rul.reason)
    if not outlook.rul.known:
        return Advice.without_figures(
            "continue", f"no remaining life is known: {outlook.rul.reason}; decide anew then"
        )
    if not outlook.hours_per_cycle > 0.0:
        return Advice.without_figures("unknown", "the flight hours from test to test are unknown")
    lives = np.minimum(outlook.lifetimes, after.horizon_hours)
    decision = Decision(
        costs,
        outlook.hours,
        outlook.hours_per_cycle,
        lives,
        after.missing_share,
        outlook.tests_tell,
    )
    return _best(decision, outlook)


def _best(decision: Decision, outlook: Outlook) -> Advice:
    costs, now = decision.costs, decision.hours
    removal, waiting, at_once = decision.remove(), decision.wait(), decision.at_once()
    least = min(removal.rate, waiting.rate)
    if costs.inspection > 0.0 and outlook.levels.size:
        inspection = decision.inspect(outlook.levels)
        if inspection.rate < least:
            saved = _per_hour(least, costs)
            reason = (
                f"an inspection now, which measures {label_of(outlook.dominant)}, lowers the "
                f"expected cost from {saved} to {_per_hour(inspection.rate, costs)}"
            )
            return Advice("inspect", now, 0.0, 0.0, inspection.rate, at_once.rate, reason)
    test = decision.interval_hours
    compared = (
        f"{_per_hour(waiting.rate, costs)} when it waits, {_per_hour(removal.rate, costs)} when not"
    )
    risk = (
        f"{_percent(waiting.risk)} risk of failure until a removal can follow the next test, in "
        f"{waiting.removal_hours:,.0f} h"
    )
    if waiting.rate < removal.rate:
        probability = float(np.mean(decision.lives < test))
        reason = f"the decision can wait for the next test: {risk}; {compared}"
        return Advice("continue", now + test, test, probability, waiting.rate, at_once.rate, reason)
    until = removal.removal_hours
    reason = f"the removal must not wait: {risk}; {compared}"
    return Advice("remove", now + until, until, removal.risk, removal.rate, at_once.rate, reason)


def _per_hour(rate: float, costs: Costs) -> str:
    return f"{rate:.3g} {costs.unit}".strip() + "/h"


def _percent(risk: float) -> str:
    return f"{100.0 * risk:.2g} %"
