"""Remaining useful life: its quantiles, and whether they can be given."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_core.wording import text_table
from ema_monitor.health import ONE_SIDED_95, HealthLimits
from ema_monitor.prognosis.growth.settings import TrackerSettings

_LIKELY: Final = 0.5


@dataclass(frozen=True)
class RemainingLife:
    """Quantiles of the remaining useful life under one criterion.

    Attributes
    ----------
    known
        Whether a figure can be given.
    hours_05, hours_50, hours_95
        5 %, 50 % and 95 % quantiles from the latest test on [h]; NaN when not known.
    criterion
        What ends life.
    reason
        Why no figure can be given; empty when known.
    """

    known: bool
    hours_05: float
    hours_50: float
    hours_95: float
    criterion: str
    reason: str = ""

    @classmethod
    def unknown(cls, criterion: str, reason: str) -> "RemainingLife":
        """Return a life of which no figure can be given."""
        return cls(False, math.nan, math.nan, math.nan, criterion, reason)

    @classmethod
    def of_samples(cls, hours: NDArray[np.float64], criterion: str) -> "RemainingLife":
        """Return the quantiles of samples of a life [h], ``(n,)``."""
        low, median, high = np.quantile(hours, [0.05, 0.5, 0.95], method="inverted_cdf")
        return cls(True, float(low), float(median), float(high), criterion)


@dataclass(frozen=True, eq=False)
class Prognosis:
    """Remaining useful life of an actuator, from its latest test on.

    Attributes
    ----------
    hours
        Service hour of the latest test [h]; NaN when there was none.
    components
        Life until each component reaches its limit, by name.
    overall
        Life until the first of them does.
    dominant_fault
        Component that does so first most often; empty when none is known to grow.
    samples
        Samples of the overall life [h], ``(n,)``; infinite when it is not known.
    duty
        Growth of the faults in a future flight hour, relative to a past one [-].
    assumption
        What is assumed of future use, in words.
    """

    hours: float
    components: Mapping[str, RemainingLife]
    overall: RemainingLife
    dominant_fault: str
    samples: NDArray[np.float64]
    duty: float
    assumption: str

    def as_rows(self) -> list[dict[str, Any]]:
        """Return a table of plain values: a row a component, and one for the first of them."""
        return [asdict(life) for life in (*self.components.values(), self.overall)]

    def __str__(self) -> str:
        lives = {life.criterion: life for life in self.components.values()}
        lives["the first of these"] = self.overall
        rows = [
            (
                criterion,
                *(f"{hours:.0f}" for hours in (life.hours_05, life.hours_50, life.hours_95)),
                life.reason,
            )
            for criterion, life in lives.items()
        ]
        table = text_table(("until", "5 %", "50 %", "95 %", ""), rows)
        return f"remaining useful life from {self.hours:g} h on [h], {self.assumption}\n{table}"


@dataclass(frozen=True, eq=False)
class Fan:
    """Quantiles of the future of each component, for plots.

    Attributes
    ----------
    hours
        Hours from the latest test on [h], ``(m,)``.
    levels
        Probabilities of the quantiles [-], ``(q,)``.
    values
        Fault values by component [-], ``(q, m)`` each.
    """

    hours: NDArray[np.float64]
    levels: NDArray[np.float64]
    values: Mapping[str, NDArray[np.float64]]


def assumption_of(duty: float) -> str:
    """Return in words what a duty assumes of future use."""
    if duty == 1.0:
        return "future use as in the past"
    return f"faults grow {duty:g} times as fast in each future flight hour as in the past"


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a prognosis is judged by, ``(7,)`` each.

    Attributes
    ----------
    hours
        Service hour of the latest test [h], a number.
    tests
        Number of tests.
    span
        Hours over which the component has been observed [h].
    mean, sigma
        Signed distance from healthy [-].
    growing
        Whether it counts as growing.
    growing_probability
        Probability that it grows [-].
    """

    hours: float
    tests: NDArray[np.intp]
    span: NDArray[np.float64]
    mean: NDArray[np.float64]
    sigma: NDArray[np.float64]
    growing: NDArray[np.bool_]
    growing_probability: NDArray[np.float64]


def prognosis_of(
    hours: NDArray[np.float64],
    evidence: Evidence,
    limits: HealthLimits,
    settings: TrackerSettings,
    duty: float,
) -> Prognosis:
    """Return the prognosis by samples of lives, with quantiles where they can be given.

    Once the life of one component is known, the overall one counts all that a test has shown, each
    as probable as its growth is: growth that is nearly certain must not come as a surprise.

    Parameters
    ----------
    hours
        Samples of each component's life under the duty [h], ``(7, n)``.
    evidence
        What they rest on.
    limits
        Where life ends.
    settings
        Horizon.
    duty
        Future use relative to that of the past [-].
    """
    components: dict[str, RemainingLife] = {}
    every = hours.copy()
    for number, name in enumerate(COMPONENTS):
        limit = limits.of(name)
        criterion = _criterion(name, limit)
        own = hours[number]
        lower = abs(evidence.mean[number]) - ONE_SIDED_95 * evidence.sigma[number]
        if evidence.tests[number] and lower > limit:
            own = np.zeros_like(own)
            reason = ""
        else:
            reason = _reason_unknown(number, own * duty, evidence, settings)
        known = not reason
        components[name] = (
            RemainingLife.of_samples(own, criterion)
            if known
            else RemainingLife.unknown(criterion, reason)
        )
        every[number] = own if evidence.tests[number] else np.inf
    first = every.min(axis=0)
    known_names = [name for name, life in components.items() if life.known]
    if known_names:
        counts = np.bincount(every.argmin(axis=0), minlength=len(COMPONENTS))
        dominant = COMPONENTS[int(counts.argmax())]
        overall = RemainingLife.of_samples(first, components[dominant].criterion)
    else:
        dominant, first = "", np.full_like(first, np.inf)
        reasons = sorted({life.reason for life in components.values()})
        overall = RemainingLife.unknown("first fault limit", "; ".join(reasons))
    return Prognosis(
        evidence.hours, components, overall, dominant, first, duty, assumption_of(duty)
    )


def _criterion(name: str, limit: float) -> str:
    """Return in words when a fault ends life."""
    fault = FAULTS[FAULT_NAMES.index(name)]
    if fault.is_two_sided:
        return f"{fault.label} differs from {fault.healthy:g} by more than {limit:g}"
    return f"{fault.label} exceeds {limit:g}"


def _reason_unknown(
    number: int, past_hours: NDArray[np.float64], evidence: Evidence, settings: TrackerSettings
) -> str:
    """Return why no life of a component can be given; empty when one can."""
    if not evidence.tests[number]:
        return "no test to rely on yet"
    if not evidence.growing[number]:
        probability = float(evidence.growing_probability[number])
        if probability > _LIKELY:
            return f"growth is not certain yet: its probability is {probability:.3f}"
        return "no significant growth"
    horizon = min(settings.horizon_hours, settings.horizon_factor * float(evidence.span[number]))
    if np.median(past_hours) > horizon:
        return f"limit not within the horizon of {horizon:.0f} h"
    return ""
