"""How long an actuator will perform as required, by samples of the faults to come."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.faults import COMPONENTS, ECCENTRICITY_PHASE, FAULT_NAMES, N_FAULTS, healthy_faults
from ema_monitor.health import ONE_SIDED_95, FaultHealth, HealthLimits
from ema_monitor.prognosis.growth.prediction import Prognosis, RemainingLife
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.tracker import TrackedFault, Tracker
from ema_monitor.prognosis.requirements.requirements import (
    MODELLED,
    REQUIREMENTS,
    SEEN,
    Judgement,
    RequirementLimits,
    Requirements,
)
from ema_monitor.prognosis.requirements.surrogate import Surrogate

OVERALL: Final = "any requirement"
"""Criterion of the earliest of the requirements."""

NODES: Final = 9
"""Times at which every trajectory is looked at before the crossing is bisected."""

ROUNDS: Final = 2
POINTS: Final = 32
"""Crossings of a requirement that the model checks after each round but the last."""

_SAFE = 4.0

_Reserve = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class RequirementLives:
    """Remaining life until required performance fails.

    Attributes
    ----------
    lives
        Life under each requirement, by name.
    overall
        Life until the first of them fails.
    dominant
        Requirement that fails first most often; empty when none is known to fail.
    samples
        Life of each sample by requirement [h], ``(n,)`` each; infinite where it does not fail
        within the hours given.
    overall_samples
        The earliest of them [h], ``(n,)``.
    """

    lives: Mapping[str, RemainingLife]
    overall: RemainingLife
    dominant: str
    samples: Mapping[str, NDArray[np.float64]]
    overall_samples: NDArray[np.float64]


def life_by_requirements(
    requirements: Requirements, future: ArrayLike, hours: ArrayLike
) -> RequirementLives:
    """Return when each requirement fails first.

    Parameters
    ----------
    requirements
        What the actuator must perform.
    future
        Samples of the faults to come, ``(n, t, 8)``, with the direction of the eccentricity; a
        sample with NaN is left out. What grows beyond its range stays at its end.
    hours
        Their hours from the latest test on, rising, ``(t,)`` [h]; between them faults grow
        linearly.

    Returns
    -------
    RequirementLives
        A life is known when at least half of the samples fail within the hours.

    Raises
    ------
    ValueError
        When shapes do not agree, or the hours do not rise.

    Notes
    -----
    The first of ``NODES`` times at which a sample fails is found, then the crossing before it is
    bisected: a failure between two nodes that mends itself again is not seen. Free play has a
    closed form at all times. The others are judged by the trend of the reserves; that alone errs
    by several percent of the way to the limit. So the model is run at crossings so found, spread
    over the samples, what the trend misses there is kriged, and the crossings are sought anew, as
    in active learning of limit states (Echard, Gayton and Lemaire 2011, AK-MCS, Structural
    Safety 33). A requirement whose reserve stays above four times the trend's error is not
    checked. That runs the model some 40 times for each requirement in question, where a bisection
    of each sample would take thousands; the hours so found differ from those of the model at all
    times by 1 % rms in most cases, 2 % where a reserve falls slowly.
    """
    faults, times = _checked(future, hours)
    whole = ~np.isnan(faults).any(axis=(1, 2))
    if not whole.any():
        reason = "the faults to come are unknown"
        return _lives(
            {name: np.full(len(faults), np.nan) for name in REQUIREMENTS},
            reason,
            requirements,
            times,
        )
    paths = _Paths(faults[whole])
    indices = _modelled_crossings(requirements, paths)
    indices["free_play"] = _free_play_crossings(requirements, paths)
    samples = {}
    for name in REQUIREMENTS:
        life = np.full(len(faults), np.nan)
        life[whole] = np.interp(indices[name], np.arange(len(times)), times)
        life[whole] = np.where(np.isinf(indices[name]), np.inf, life[whole])
        samples[name] = life
    return _lives(samples, "", requirements, times)


class _Paths:
    """Trajectories of fault vectors, ``(n, t, 8)``."""

    def __init__(self, faults: NDArray[np.float64]) -> None:
        self.faults = faults
        self.n, self.t, _ = faults.shape

    def at(self, rows: NDArray[np.intp], index: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return fault vectors at fractions of the time's index, ``(m, 8)``."""
        before = np.minimum(index.astype(np.intp), self.t - 1)
        after = np.minimum(before + 1, self.t - 1)
        share = (index - before)[:, None]
        # A law may have run to infinity.
        start, end = (np.clip(self.faults[rows, i], 0.0, 1.0) for i in (before, after))
        return (1.0 - share) * start + share * end


def _modelled_crossings(
    requirements: Requirements, paths: _Paths
) -> dict[str, NDArray[np.float64]]:
    nodes = np.unique(np.linspace(0, paths.t - 1, NODES).round().astype(np.intp))
    coarse_faults = paths.faults[:, nodes].reshape(-1, N_FAULTS)
    doubt = {name: _SAFE * requirements.trend_error[name] for name in MODELLED}
    found: dict[str, NDArray[np.float64]] = {name: np.full(paths.n, np.inf) for name in MODELLED}
    # What the trend misses is asked first along the median of the trajectories.
    median = np.median(paths.faults[:, nodes], axis=0)
    wanted = {
        name: median
        for name in MODELLED
        if Surrogate(requirements.trend[name]).at(coarse_faults).min() < doubt[name]
    }
    known: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {
        name: (np.empty((0, N_FAULTS)), np.empty(0)) for name in wanted
    }
    for _ in range(ROUNDS):
        _learn(requirements, wanted, known)
        for name in known:
            surrogate = Surrogate(requirements.trend[name], *known[name])
            coarse = surrogate.at(coarse_faults).reshape(paths.n, -1)
            found[name] = _first_crossing(surrogate.at, coarse, nodes, paths)
            wanted[name] = _doubtful(found[name], coarse, nodes, paths, doubt[name])
    return found


def _doubtful(
    crossing: NDArray[np.float64],
    coarse: NDArray[np.float64],
    nodes: NDArray[np.intp],
    paths: _Paths,
    doubt: float,
) -> NDArray[np.float64]:
    """Return where to run the model: faults at crossings, or at the least reserve if in doubt."""
    lowest = nodes[coarse.argmin(axis=1)].astype(float)
    place = np.where(np.isinf(crossing), lowest, crossing)
    order = np.lexsort((place, np.isinf(crossing)))
    order = order[coarse.min(axis=1)[order] < doubt]
    if not len(order):
        return np.empty((0, N_FAULTS))
    spread = np.unique(np.linspace(0, len(order) - 1, POINTS).round().astype(np.intp))
    return paths.at(order[spread], place[order[spread]])


def _learn(
    requirements: Requirements,
    wanted: Mapping[str, NDArray[np.float64]],
    known: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> None:
    """Run the model at the faults wanted, and add its reserves there to what is known."""
    for names in (("tracking_error", "torque_margin"), ("bandwidth",)):
        names = tuple(name for name in names if len(wanted.get(name, ())))
        if not names:
            continue
        faults = np.concatenate([wanted[name] for name in names])
        exact = np.clip(requirements.exact_reserves(names, faults), *SEEN)
        start = 0
        for column, name in enumerate(names):
            own = slice(start, start + len(wanted[name]))
            start = own.stop
            old_faults, old_exact = known[name]
            known[name] = (
                np.concatenate([old_faults, faults[own]]),
                np.concatenate([old_exact, exact[own, column]]),
            )


def _first_crossing(
    reserve: _Reserve, coarse: NDArray[np.float64], nodes: NDArray[np.intp], paths: _Paths
) -> NDArray[np.float64]:
    """Return the index of the time at which each reserve first reaches 0, or infinity, ``(n,)``."""
    failed = coarse < 0.0
    first = failed.argmax(axis=1)
    crossing = np.where(failed[:, 0], 0.0, np.inf)
    rows = np.flatnonzero(failed.any(axis=1) & ~failed[:, 0])
    low, high = nodes[first[rows] - 1], nodes[first[rows]]
    above, below = coarse[rows, first[rows] - 1], coarse[rows, first[rows]]
    while np.any(high - low > 1):
        middle = (low + high) // 2
        value = reserve(paths.faults[rows, middle])
        fails = value < 0.0
        high, below = np.where(fails, middle, high), np.where(fails, value, below)
        low, above = np.where(fails, low, middle), np.where(fails, above, value)
    crossing[rows] = low + (high - low) * above / (above - below)
    return crossing


def _free_play_crossings(requirements: Requirements, paths: _Paths) -> NDArray[np.float64]:
    left = requirements.reserve("free_play", requirements.model.free_play(paths.faults))
    return _first_crossing(lambda _: left[:, 0], left, np.arange(paths.t), paths)


def _lives(
    samples: dict[str, NDArray[np.float64]],
    reason: str,
    requirements: Requirements,
    hours: NDArray[np.float64],
) -> RequirementLives:
    earliest = np.min([samples[name] for name in REQUIREMENTS], axis=0)
    lives = {
        name: _life(samples[name], requirements.criterion(name), reason, hours)
        for name in REQUIREMENTS
    }
    overall = _life(earliest, OVERALL, reason, hours)
    dominant = ""
    if overall.known:
        ends = [np.sum((samples[name] == earliest) & np.isfinite(earliest)) for name in lives]
        dominant = REQUIREMENTS[int(np.argmax(ends))]
    return RequirementLives(lives, overall, dominant, samples, earliest)


def _life(
    samples: NDArray[np.float64], criterion: str, reason: str, hours: NDArray[np.float64]
) -> RemainingLife:
    valid = samples[~np.isnan(samples)]
    if not len(valid):
        return RemainingLife.unknown(criterion, reason)
    life = RemainingLife.of_samples(valid, criterion)
    if np.isinf(life.hours_50):
        return RemainingLife.unknown(criterion, f"not within the {hours[-1]:.0f} h looked ahead")
    return life


def _checked(
    future: ArrayLike, hours: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    faults, times = np.asarray(future, dtype=np.float64), np.asarray(hours, dtype=np.float64)
    if faults.ndim != 3 or 0 in faults.shape or faults.shape[2] != N_FAULTS:
        raise ValueError(f"future has shape {faults.shape}, expected (samples, times, {N_FAULTS})")
    if times.shape != faults.shape[1:2]:
        raise ValueError(f"hours has shape {times.shape}, expected ({faults.shape[1]},)")
    if not (np.isfinite(times).all() and np.all(np.diff(times) > 0.0)):
        raise ValueError("hours do not rise, or are not finite")
    return faults, times


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
    the samples. Where none is known to grow, all stay as they may be now, and a life is
    given only if a requirement fails now at 95 % certainty. As long as no test has shown a
    component, no life is given: it might be anything.

    Parameters
    ----------
    requirements
        What is required.
    judgement
        How far it is met now.
    faults
        Fault vector now, ``(8,)``.
    tracker, tracked, prognosis
        The growth, each component that a test has shown, and the life by fault limits.
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
        reason = f"no test has shown {', '.join(unseen)} yet"
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
    found = life_by_requirements(requirements, paths, hours)
    overall = found.overall
    if found.dominant:
        overall = replace(overall, criterion=found.lives[found.dominant].criterion)
    return RequiredLife(
        healths,
        _trends(judgement, tracked) if grows else {},
        found.lives,
        overall,
        found.dominant,
        _earliest(
            np.minimum(found.overall_samples, limit_passage(paths, hours, limits)),
            overall,
        ),
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
