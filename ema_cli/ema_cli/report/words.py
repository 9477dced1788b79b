"""Figures of a report in words."""

import math
from datetime import UTC, datetime
from typing import NamedTuple

from ema_monitor.health import FaultHealth
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.requirements.requirements import REQUIREMENTS, RequirementLimits
from ema_monitor.prognosis.sentences import label_of, shown_in

_FIRST_DATE_NS = 10 * 365 * 86_400_000_000_000


class Shown(NamedTuple):
    """A fault or required performance as it is shown.

    Attributes
    ----------
    scale
        Of the unit that it is shown in.
    unit
        That unit with a blank before it; empty for a share.
    """

    label: str
    scale: float
    unit: str
    value_and_sigma: str
    limit: str


def shown(item: FaultHealth) -> Shown:
    """Return a fault or requirement as it is shown."""
    unit, scale = shown_in(RequirementLimits.unit(item.name) if item.name in REQUIREMENTS else "1")
    unit = f" {unit}" if unit else ""
    value, sigma, limit = (scale * one for one in (item.value, item.sigma, item.limit))
    uncertainty = f" ± {sigma:.2g}" if math.isfinite(sigma) else ""
    side = "≥" if item.limit_is_lower else "≤"
    return Shown(
        label_of(item.name),
        scale,
        unit,
        f"{value:.3g}{uncertainty}{unit}",
        f"{side} {limit:.3g}{unit}",
    )


def life_in_words(life: RemainingLife) -> str:
    """Return the quantiles of a life that is known [h]."""
    return " / ".join(_hours(one) for one in (life.hours_05, life.hours_50, life.hours_95))


def moment(stamp_ns: int) -> str:
    """Return a stamp as date and time, or in seconds where it counts from something else."""
    if stamp_ns < _FIRST_DATE_NS:
        return f"{stamp_ns * 1e-9:,.2f} s"
    return f"{datetime.fromtimestamp(stamp_ns * 1e-9, UTC):%Y-%m-%d %H:%M:%S} UTC"


def _hours(value: float) -> str:
    if not math.isfinite(value):
        return "longer"
    return f"{value:,.0f}" if value >= 9.95 else f"{value:.1f}"
