"""What is known of each component, and its remaining useful life, where it can be given."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_core.wording import text_table
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.duty.future import FutureDuty
from ema_monitor.prognosis.growth.check import TrackRecord

_ANY_LIMIT: Final = "first fault limit"


@dataclass(frozen=True)
class TrackedFault:
    """What is known of one component.

    Attributes
    ----------
    name
        Component of the fault vector.
    tests
        Number of tests that showed it.
    value, sigma
        Mean and standard deviation, in the units of the fault vector [-]; NaN before any test.
    trend
        Growth of the value [1/h].
    trend_sigma
        Its standard deviation [1/h].
    laws
        Probability of each law [-]; ``constant`` stands for no growth yet.
    growing_probability
        Probability that it grows [-].
    calibration
        How its predictions held against the tests so far.
    """

    name: str
    tests: int
    value: float
    sigma: float
    trend: float
    trend_sigma: float
    laws: Mapping[str, float]
    growing_probability: float
    calibration: TrackRecord


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
    future
        What is assumed of the duty to come.
    levels
        Present distance of the dominant fault from healthy in each sample [-], ``(n,)``; empty
        when there is no dominant one.
    """

    hours: float
    components: Mapping[str, RemainingLife]
    overall: RemainingLife
    dominant_fault: str
    samples: NDArray[np.float64]
    future: FutureDuty
    levels: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    @classmethod
    def unknown(cls, reason: str, limits: HealthLimits, duty: FutureDuty) -> "Prognosis":
        """Return the prognosis of which no figure can be given."""
        components = {
            name: RemainingLife.unknown(_criterion(name, limits.of(name)), reason)
            for name in COMPONENTS
        }
        overall = RemainingLife.unknown(_ANY_LIMIT, reason)
        return cls(math.nan, components, overall, "", np.empty(0), duty)

    @property
    def duty(self) -> float:
        """Growth of the faults in a future flight hour beside the duty to come [-]."""
        return self.future.factor

    @property
    def assumption(self) -> str:
        """What is assumed of future use, in words."""
        return str(self.future)

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


def prognosis_of(
    at_hours: float,
    samples: NDArray[np.float64],
    is_shown: NDArray[np.bool_],
    reasons: Sequence[str],
    limits: HealthLimits,
    duty: FutureDuty,
    levels: NDArray[np.float64],
) -> Prognosis:
    """Return the prognosis by samples of lives, with quantiles where they can be given.

    Once the life of one component is known, the overall one counts all that a test has shown, each
    as probable as its growth is: growth that is nearly certain must not come as a surprise. Samples
    and present levels are ``(7, n)``; a reason is empty where a life can be given.
    """
    components = {
        name: RemainingLife.unknown(criterion, reason)
        if reason
        else RemainingLife.of_samples(own, criterion)
        for name, own, reason in zip(COMPONENTS, samples, reasons, strict=True)
        for criterion in [_criterion(name, limits.of(name))]
    }
    every = np.where(is_shown[:, None], samples, np.inf)
    if not all(reasons):
        counts = np.bincount(every.argmin(axis=0), minlength=len(COMPONENTS))
        number = int(counts.argmax())
        dominant, first, own_levels = COMPONENTS[number], every.min(axis=0), levels[number]
        overall = RemainingLife.of_samples(first, components[dominant].criterion)
    else:
        dominant, first, own_levels = "", np.full(samples.shape[1], np.inf), np.empty(0)
        overall = RemainingLife.unknown(_ANY_LIMIT, "; ".join(sorted(set(reasons))))
    return Prognosis(at_hours, components, overall, dominant, first, duty, own_levels)


def _criterion(name: str, limit: float) -> str:
    """Return in words when a fault ends life."""
    fault = FAULTS[FAULT_NAMES.index(name)]
    if fault.is_two_sided:
        return f"{fault.label} differs from {fault.healthy:g} by more than {limit:g}"
    return f"{fault.label} exceeds {limit:g}"
