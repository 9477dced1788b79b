"""How long an actuator goes on to perform as required, by what its tracker tells."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS, ECCENTRICITY_PHASE, FAULT_NAMES, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.health import ONE_SIDED_95, FaultHealth, HealthLimits
from ema_monitor.prognosis.growth.prediction import Prognosis, RemainingLife
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.tracked_fault import TrackedFault
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.requirements.life import OVERALL, life_by_requirements
from ema_monitor.prognosis.requirements.requirements import (
    REQUIREMENTS,
    Judgement,
    RequirementLimits,
    Requirements,
)

BEING_COMPUTED: Final = "requirements are being computed"
"""Why nothing is said of the requirements of a unit as long as they are fitted elsewhere."""

_SAMPLES: Final = 200
_TIMES: Final = 33
# How far to look beyond the life that the fault limits leave.
_BEYOND: Final = 2.0


@dataclass(frozen=True)
class RequiredLife:
    """Health, growth and remaining life as to the requirements.

    Attributes
    ----------
    healths
        As to each requirement; empty when none can be watched.
    trends
        Growth of each performance by name [its unit per flight hour].
    lives
        Remaining life under each requirement, by name.
    overall
        Until the first of them fails.
    dominant
        That requirement; empty when none is known to fail.
    with_limits
        Until the first of them fails or the first fault reaches its limit, in the same samples.
    """

    healths: tuple[FaultHealth, ...]
    trends: Mapping[str, float]
    lives: Mapping[str, RemainingLife]
    overall: RemainingLife
    dominant: str
    with_limits: RemainingLife

    @classmethod
    def unknown(
        cls,
        reason: str,
        required: Requirements | RequirementLimits,
        healths: tuple[FaultHealth, ...] = (),
    ) -> "RequiredLife":
        """Return a life of which no figure can be given."""
        lives = {
            name: RemainingLife.unknown(required.criterion(name), reason) for name in REQUIREMENTS
        }
        nothing = RemainingLife.unknown(OVERALL, reason)
        return cls(healths, {}, lives, nothing, "", nothing)


class FittedRequirements:
    """The requirements of units, fitted once for each; any thread may call.

    Parameters
    ----------
    most
        How many to keep.
    """

    def __init__(self, most: int = 256) -> None:
        self._most = most
        self._fitted: dict[tuple[ActuatorParameters, RequirementLimits], Requirements | str] = {}
        self._fitting = threading.Lock()

    def of(self, parameters: ActuatorParameters, limits: RequirementLimits) -> Requirements | str:
        """Return the requirements of a unit, or why they cannot be watched.

        The first call for a unit takes about a second on two cores, others none.

        Parameters
        ----------
        parameters
            Those of the unit.
        limits
            What is required.
        """
        with self._fitting:
            key = parameters, limits
            if key not in self._fitted:
                while len(self._fitted) >= self._most:
                    del self._fitted[next(iter(self._fitted))]
                try:
                    self._fitted[key] = Requirements(parameters, limits)
                except ValueError as error:
                    self._fitted[key] = f"requirements cannot be watched: {error}"
            return self._fitted[key]

    def if_ready(
        self, parameters: ActuatorParameters, limits: RequirementLimits
    ) -> Requirements | str:
        """Return the same without waiting: ``BEING_COMPUTED`` where ``of`` has not been called.

        Parameters
        ----------
        parameters, limits
            As of ``of``.
        """
        return self._fitted.get((parameters, limits), BEING_COMPUTED)

    def clear(self) -> None:
        """Forget all."""
        self._fitted.clear()


FITTED: Final = FittedRequirements()
"""Those of all units in this process."""


def required_life(
    requirements: Requirements,
    judgement: Judgement,
    faults: NDArray[np.float64],
    tracker: Tracker,
    tracked: tuple[TrackedFault, ...],
    prognosis: Prognosis,
    limits: HealthLimits,
    settings: TrackerSettings,
    observed_hours: float,
) -> RequiredLife:
    """Return how long the requirements are met.

    Each component goes on as probable: one of which growth is not certain yet grows in as many of
    the samples. Where none is known to grow, all stay as they may be now, and a life is told only
    if a requirement fails now at 95 % certainty. As long as no test has told of a component, no
    life is told: it might be anything.

    Parameters
    ----------
    requirements
        What is required.
    judgement
        How far it is met now.
    faults
        Fault vector now, ``(8,)``.
    tracker, tracked, prognosis
        What is known of the growth, what of each component that a test has told of, and how long
        the fault limits are kept.
    limits
        Those of the faults.
    settings
        Horizon.
    observed_hours
        Hours over which the actuator has been observed [h].
    """
    healths = judgement.healths
    grows = any(life.known for life in prognosis.components.values())
    if not tracked:
        return RequiredLife.unknown("no test to rely on yet", requirements, healths)
    seen = {item.name for item in tracked}
    if unseen := [name for name in COMPONENTS if name not in seen]:
        reason = f"no test has told of {', '.join(unseen)} yet"
        return RequiredLife.unknown(reason, requirements, healths)
    if not grows and not any(map(_surely_fails, healths)):
        return RequiredLife.unknown("no significant growth", requirements, healths)
    duty = prognosis.duty
    horizon = min(settings.horizon_hours, settings.horizon_factor * observed_hours) / duty
    longest = prognosis.overall.hours_95
    if 0.0 < longest < np.inf:
        horizon = min(horizon, _BEYOND * longest)
    # More times near now, where they count most.
    hours = max(horizon, 1.0) * np.linspace(0.0, 1.0, _TIMES) ** 2
    paths = np.swapaxes(tracker.futures(hours, _SAMPLES, duty), 0, 1)
    if not grows:
        paths[:] = paths[:, :1]
    paths[..., ECCENTRICITY_PHASE] = faults[ECCENTRICITY_PHASE]
    told = life_by_requirements(requirements, paths, hours)
    overall = told.overall
    if told.dominant:
        overall = replace(overall, criterion=told.lives[told.dominant].criterion)
    return RequiredLife(
        healths,
        _trends(judgement, tracked) if grows else {},
        told.lives,
        overall,
        told.dominant,
        _earliest(np.minimum(told.overall_samples, limit_passage(paths, hours, limits)), overall),
    )


def limit_passage(
    paths: NDArray[np.float64], hours: NDArray[np.float64], limits: HealthLimits
) -> NDArray[np.float64]:
    """Return when samples of the faults to come first reach a fault limit.

    Parameters
    ----------
    paths
        Fault vectors, ``(n, t, 8)``; between the hours they go on in a straight line.
    hours
        Their hours, rising from 0 [h], ``(t,)``.
    limits
        Those of the faults.

    Returns
    -------
    numpy.ndarray
        Hours [h], infinite where none is reached, ``(n,)``.
    """
    reach = [limits.of(name) if name in COMPONENTS else np.inf for name in FAULT_NAMES]
    # Share of the way of what is furthest: past 1 life has ended.
    way = np.max(np.abs(paths - healthy_faults()) / reach, axis=2)
    first = np.argmax(way >= 1.0, axis=1)
    rows = np.arange(len(way))
    before = np.maximum(first - 1, 0)
    start, end = way[rows, before], way[rows, first]
    share = np.where(first > 0, (1.0 - start) / np.where(first > 0, end - start, 1.0), 0.0)
    passed = hours[before] + share * (hours[first] - hours[before])
    return np.where(way[rows, first] >= 1.0, passed, np.inf)


def _earliest(samples: NDArray[np.float64], like: RemainingLife) -> RemainingLife:
    if not np.median(samples) < np.inf:
        return RemainingLife.unknown(like.criterion, like.reason)
    return RemainingLife.of_samples(samples, like.criterion)


def _surely_fails(item: FaultHealth) -> bool:
    beyond = item.limit - item.value if item.limit_is_lower else item.value - item.limit
    return beyond > ONE_SIDED_95 * item.sigma


def _trends(judgement: Judgement, tracked: tuple[TrackedFault, ...]) -> dict[str, float]:
    """Return how fast each performance changes with the growth of the faults."""
    trend = {item.name: item.trend for item in tracked}
    slope = np.array([trend.get(name, 0.0) for name in FAULT_NAMES])
    return {name: float(gradient @ slope) for name, gradient in judgement.gradients.items()}
