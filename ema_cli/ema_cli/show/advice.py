"""Advice in words."""

import math
from typing import Final

from ema_cli.bags.unit_course import Course

_ACTIONS: Final = {
    "continue": "Go on, and decide anew after the next test",
    "inspect": "Inspect",
    "remove": "Remove",
    "unknown": "No advice",
}


def advice_in_words(course: Course) -> str:
    """Return what to do, when, at what cost and why, in a sentence; empty without costs."""
    advice, costs = course.advice, course.given.costs
    if advice is None or costs is None:
        return ""
    words = _ACTIONS[advice.action]
    if math.isfinite(advice.hours):
        joined = ", at" if advice.action == "continue" else " by"
        words += f"{joined} {advice.hours:,.0f} service hours (in {advice.from_now:,.0f} h)"
    parts = [f"{words}: {advice.reason}"]
    if math.isfinite(advice.rate):
        unit = f"{costs.unit}/h".lstrip("/") if costs.unit else "an hour"
        parts.append(
            f"expected cost over the life {advice.rate:.3g} {unit}, {advice.rate_at_once:.3g} "
            "if it is removed as early as possible"
        )
    if math.isfinite(advice.probability):
        parts.append(f"risk of failure until then {100.0 * advice.probability:.2g} %")
    return "; ".join(parts)
