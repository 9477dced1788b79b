# SPDX-License-Identifier: Apache-2.0
"""Simulated lives: faults grow in a new actuator until a fault reaches its limit.

The rate of each fault is drawn from a distribution around the typical rate. One fault dominates: by
default, all other faults grow at a fifth of their rates. Tests have a fixed interval; some are
missing, and some windows are disturbed by noise of the current sensor or by a gap.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import (
    COMPONENTS,
    ECCENTRICITY_PHASE,
    FAULT_NAMES,
    FAULTS,
    KINDS,
    SHORT_CIRCUITS,
    TYPICAL,
    healthy_faults,
)
from ema_core.growth_laws import TIME_SCALE_LAWS, TypicalGrowth
from ema_core.quantity import Checked, quantity
from ema_sim.growth import Growth, grow

WindowKind = Literal["good", "noisy", "gap", "missing"]
"""Quality of the window of a test."""

NOISE_OF_DISTURBED: Final = 1.0
"""Standard deviation of the current sensor's noise in a noisy window [A]."""

_MOST_DRAWS: Final = 1000


@dataclass(frozen=True)
class LifeSettings(Checked):
    """Settings for random lives.

    Lives outside the permitted length are redrawn. The life of a repaired actuator counts from the
    repair.

    Raises
    ------
    ValueError
        If a value is out of range, or no length is permitted.
    """

    interval_hours: float = quantity(10.0, "h", 0.01, 1e4, "service hours between tests")
    process_noise: float = quantity(0.3, "-", 0.0, 3.0, "sigma of an increment's lognormal factor")
    others_share: float = quantity(
        0.2, "-", 0.0, 1.0, "growth rate of the other faults, relative to their typical rates"
    )
    missing_share: float = quantity(0.1, "-", 0.0, 0.9, "share of tests that are missing")
    disturbed_share: float = quantity(0.03, "-", 0.0, 1.0, "share of windows that are disturbed")
    least_tests: int = quantity(60, "-", 1, 10_000, "shortest life, in tests")
    most_tests: int = quantity(200, "-", 1, 10_000, "longest life, in tests")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.least_tests > self.most_tests:
            raise ValueError(
                f"least_tests = {self.least_tests}: expected at most most_tests = {self.most_tests}"
            )


@dataclass(frozen=True, eq=False)
class SimulatedLife:
    """Simulated life of an actuator, as a series of tests."""

    dominant: str
    """Component that reaches its limit first; empty in a life without growth."""
    growths: Mapping[str, Growth]
    hours: NDArray[np.float64]
    """Service hours of all tests, including missing tests, ``(n,)`` [h]."""
    faults: NDArray[np.float64]
    """True fault vectors of the tests, ``(n, 8)``."""
    windows: tuple[WindowKind, ...]
    end_hours: float
    """Service hour at which a fault reaches its limit [h]; infinite in a life without growth."""
    repair_hours: float = math.nan
    """Service hour of the first test after the repair [h]; NaN without a repair."""


def run_to_failure(
    limits: Mapping[str, float],
    rng: np.random.Generator,
    kind: str | None = None,
    settings: LifeSettings | None = None,
    *,
    with_repair: bool = False,
    typical: Mapping[str, TypicalGrowth] = TYPICAL,
) -> SimulatedLife:
    """Return the random life of a new actuator until its dominant fault reaches its limit.

    Lives that another fault ends are redrawn.

    Parameters
    ----------
    limits
        Distance from healthy at which life ends, keyed by component [-].
    rng
        Random generator.
    kind
        Dominant fault, a key of ``typical``; None to draw it.
    settings
        Settings of the life; None for the default settings.
    with_repair
        Whether the dominant fault is reset to healthy once, after 20 to 50 % of the largest number
        of tests.
    typical
        Typical growth, keyed by kind of fault.

    Raises
    ------
    ValueError
        If a limit is missing, the kind is unknown, or no drawn life has a permitted length.
    """
    settings = settings or LifeSettings()
    _check(limits, kind, typical)
    for _ in range(_MOST_DRAWS):
        chosen = kind or str(rng.choice(list(typical)))
        life = _draw_life(limits, rng, chosen, typical, settings, with_repair=with_repair)
        if life is not None:
            return life
    raise ValueError(
        f"none of {_MOST_DRAWS} drawn lives had {settings.least_tests} to {settings.most_tests} "
        f"tests, {settings.interval_hours:g} h apart"
    )


def constant_life(
    limits: Mapping[str, float], rng: np.random.Generator, settings: LifeSettings | None = None
) -> SimulatedLife:
    """Return a random life in which no fault grows.

    Parameters
    ----------
    limits
        Distance from healthy at which life ends, keyed by component [-].
    rng
        Random generator.
    settings
        Settings of the life; None for the default settings.

    Raises
    ------
    ValueError
        If a limit is missing.

    Notes
    -----
    Each component is healthy with a probability of 0.5, else constant at up to 60 % of its limit.
    At most one phase has a short circuit. The phase of the eccentricity is random.
    """
    settings = settings or LifeSettings()
    _check(limits)
    tests = int(rng.integers(settings.least_tests, settings.most_tests, endpoint=True))
    k = _new_actuator(rng)
    shorted = int(rng.choice(SHORT_CIRCUITS))
    for number, fault in enumerate(FAULTS):
        side = rng.choice([-1.0, 1.0]) if fault.healthy > 0.0 else 1.0
        value = fault.healthy + side * 0.6 * rng.random() * limits.get(fault.name, 0.0)
        is_worn = rng.random() < 0.5
        if number == ECCENTRICITY_PHASE or (number in SHORT_CIRCUITS and number != shorted):
            continue
        if is_worn:
            k[number] = value
    hours = _hours(tests, settings)
    return SimulatedLife(
        "", {}, hours, np.tile(k, (tests, 1)), _windows(tests, rng, settings), math.inf
    )


def _check(
    limits: Mapping[str, float],
    kind: str | None = None,
    typical: Mapping[str, TypicalGrowth] = TYPICAL,
) -> None:
    for name in COMPONENTS:
        if not limits.get(name, 0.0) > 0.0:
            raise ValueError(f"limit of {name} = {limits.get(name)!r}: expected a number above 0")
    if kind is not None and kind not in typical:
        raise ValueError(f"dominant fault {kind!r} is unknown; known: {', '.join(typical)}")


def _new_actuator(rng: np.random.Generator) -> NDArray[np.float64]:
    k = healthy_faults()
    k[ECCENTRICITY_PHASE] = rng.random()
    return k


def _hours(n: int, settings: LifeSettings) -> NDArray[np.float64]:
    return np.arange(n, dtype=np.float64) * np.float64(settings.interval_hours)


def _windows(n: int, rng: np.random.Generator, settings: LifeSettings) -> tuple[WindowKind, ...]:
    disturbed = settings.disturbed_share / 2.0
    present = 1.0 - settings.missing_share
    kinds: tuple[WindowKind, ...] = ("missing", "noisy", "gap", "good")
    shares = (1.0 - present, present * disturbed, present * disturbed)
    picked = np.searchsorted(np.cumsum(shares), rng.random(n), side="right")
    return tuple(kinds[number] for number in picked)


def _drawn_growth(
    typical: TypicalGrowth, rng: np.random.Generator, share: float, settings: LifeSettings
) -> Growth:
    """Return the random growth of a component with its rate scaled by ``share``.

    The component does not grow if ``share`` is 0.
    """
    rate = typical.rate * math.exp(typical.rate_sigma * rng.standard_normal())
    onset = typical.latest_onset * rng.random()
    side = float(rng.choice([-1.0, 1.0]))
    if share == 0.0:
        return Growth()
    if typical.law == "drift":
        diffusion = typical.diffusion * math.sqrt(share)
        return Growth("drift", side * rate * share, noise=diffusion, onset=onset)
    rate = rate / share if typical.law in TIME_SCALE_LAWS else rate * share
    return Growth(typical.law, rate, typical.shape, noise=settings.process_noise, onset=onset)


def _draw_life(
    limits: Mapping[str, float],
    rng: np.random.Generator,
    kind: str,
    typical: Mapping[str, TypicalGrowth],
    settings: LifeSettings,
    *,
    with_repair: bool,
) -> SimulatedLife | None:
    """Return a random life, or None if it is too short or too long, or if another fault ends it."""
    names = {
        kind: KINDS[kind][int(rng.integers(len(KINDS[kind]))) if len(KINDS[kind]) > 1 else 0].name
        for kind in typical
    }
    dominant = names[kind]
    growths = {
        names[name]: _drawn_growth(
            growth, rng, 1.0 if name == kind else settings.others_share, settings
        )
        for name, growth in typical.items()
    }
    longest, step = settings.most_tests, settings.interval_hours
    repair = int(rng.integers(longest // 5, longest // 2)) if with_repair else 0
    column = FAULT_NAMES.index(dominant)
    reach = np.array([limits.get(name, math.inf) for name in FAULT_NAMES])
    reach[ECCENTRICITY_PHASE] = math.inf
    faults = [_new_actuator(rng)]
    for number in range(repair + longest):
        if with_repair and number + 1 == repair:
            faults[-1][column] = FAULTS[column].healthy
        after = grow(faults[-1], growths, number * step, step, rng)
        first, share = _first_passage(faults[-1], after, reach)
        if not math.isfinite(share):
            faults.append(after)
            continue
        if first != column or number + 1 < repair + settings.least_tests:
            return None
        n = len(faults)
        return SimulatedLife(
            dominant,
            growths,
            _hours(n, settings),
            np.array(faults),
            _windows(n, rng, settings),
            (number + share) * step,
            (repair - 1) * step if with_repair else math.nan,
        )
    return None


def _first_passage(
    before: NDArray[np.float64], after: NDArray[np.float64], reach: NDArray[np.float64]
) -> tuple[int, float]:
    """Return the index of the first component to reach its limit, and when.

    The time is the share of the step that passes before; it is infinite if no component reaches its
    limit.
    """
    was, distance = np.abs(before - healthy_faults()), np.abs(after - healthy_faults())
    share = np.full(reach.shape, np.inf)
    passing = distance >= reach
    share[passing] = (reach - was)[passing] / (distance - was)[passing]
    first = int(np.argmin(share))
    return first, float(share[first])
