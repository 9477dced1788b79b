"""Whether a remaining useful life may be told, and what it is."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_monitor.health import ONE_SIDED_95, HealthLimits
from ema_monitor.prognosis.growth.prediction import Prognosis, RemainingLife, assumption_of
from ema_monitor.prognosis.growth.settings import TrackerSettings

_LIKELY: Final = 0.5


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a verdict rests on, ``(7,)`` each.

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
        Whether it is taken to grow.
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
    """Return what may be told of samples of lives.

    Once the life of one component is told, the overall one counts all that a test has told of, each
    as probable as its growth is: what is about to be certain must not come as a surprise.

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
            reason = _ignorance(number, own * duty, evidence, settings)
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


def _ignorance(
    number: int, past_hours: NDArray[np.float64], evidence: Evidence, settings: TrackerSettings
) -> str:
    """Return why no life can be told of a component; empty when it can."""
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
