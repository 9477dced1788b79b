# SPDX-License-Identifier: Apache-2.0
"""Lives by the foreign laws of laws.py, with estimates whose errors are correlated.

Tests are 5 to 20 h apart, one in ten is missing, and the errors of successive estimates have a
correlation of 0.5. Of every six lives of a law, three follow the law alone. One has a gap of 200 to
400 h without tests, one a repair, and one a second fault that grows by a law of the same set under
the same load. All other faults grow a little. Lives with constant faults have the same tests; every
second one has a wave in a fault.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY_PHASE, FAULT_NAMES, HIGHEST, KINDS, healthy_faults
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_sim.lives import constant_life
from prognosis.estimates import error_model
from prognosis.laws import SETS, Kind, Law, Seasonal
from prognosis.lives import LIMITS

SEED: Final = 18_018
"""Root of the seeds of these lives."""

STEP_HOURS: Final = 2.5
VARIATIONS: Final = ("plain", "plain", "plain", "gap", "repair", "two faults")
CORRELATION: Final = 0.5
"""Correlation of the errors of successive estimates [-]."""

_LIVES_HOURS: Final = (900.0, 2300.0)
_LONGEST: Final = 4.0
_NOISES: Final = (0.1, 0.4)
_OTHERS_MOST: Final = 0.15
_MISSING: Final = 0.1


@dataclass(frozen=True, eq=False)
class Grown:
    """A component that grows by a foreign law."""

    name: str
    side: float  # sign of the growth from its healthy value, 1 or -1
    law: Law
    hours: NDArray[np.float64]  # steps of the whole life [h], (n,)
    share: NDArray[np.float64]  # share of the limit at each step, without its wave [-], (n,)
    states: NDArray[np.float64]  # states of the law, (n, k)
    since: float  # service hour at which the law starts: the last repair, or 0 [h]

    @property
    def away(self) -> NDArray[np.float64]:
        """Distance from healthy at each step, including its wave [-], ``(n,)``."""
        return np.maximum(self.share + self.law.wave(self.hours), 0.0) * LIMITS[self.name]


@dataclass(frozen=True, eq=False)
class ForeignLife:
    """Faults and tests of a simulated life."""

    grown: tuple[Grown, ...]  # components that grow; the first one ends life
    hours: NDArray[np.float64]  # service hours of the tests with an estimate [h], (n,)
    faults: NDArray[np.float64]  # true faults, (n, 8)
    end_hours: float  # service hour at which a fault reaches its limit [h]; infinite without growth
    start_hours: float  # service hour from which predictions are scored: the repair, or 0 [h]
    noise: float  # standard deviation of the logarithm of the growth of ten hours [-]

    @property
    def dominant(self) -> str:
        """Name of the component that ends life."""
        return self.grown[0].name


@dataclass(frozen=True)
class ForeignCase:
    """A life, identified by the name of its law ("" for constant faults) and its number."""

    kind: str
    number: int

    @property
    def variation(self) -> str:
        """Variation of the life, one of ``VARIATIONS``; "" for constant faults."""
        return VARIATIONS[self.number % len(VARIATIONS)] if self.kind else ""

    def rng(self, purpose: int) -> np.random.Generator:
        """Return the random generator for a purpose."""
        return np.random.default_rng([SEED, *self.kind.encode(), self.number, purpose])

    def life(self) -> ForeignLife:
        """Return the simulated life."""
        rng = self.rng(0)
        if not self.kind:
            return _constant(rng, with_wave=self.number % 2 == 1)
        while (life := _drawn(self, rng)) is None:
            pass
        return life

    def measurements(self, life: ForeignLife) -> list[Measurement]:
        """Return the estimates of the tests of ``life``, with reproducible errors."""
        rng = self.rng(1)
        return error_model().draw_correlated(life.hours, life.faults, CORRELATION, rng)


def lives_of(kinds: Mapping[str, Kind], count: int) -> list[ForeignCase]:
    """Return ``count`` lives of each law."""
    return [ForeignCase(kind, number) for kind in kinds for number in range(count)]


def constant_lives(count: int) -> list[ForeignCase]:
    """Return lives without growth; every second one has a wave."""
    return [ForeignCase("", number) for number in range(count)]


def continued(
    law: Law,
    share: NDArray[np.float64],
    states: NDArray[np.float64],
    hours: NDArray[np.float64],
    noise: float,
    rngs: tuple[np.random.Generator, np.random.Generator],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Continue a law. Return shares of the limit, ``(m, n)``, and states, ``(m, k, n)``.

    ``hours``, ``(m,)``, are counted from the start of the law [h]. ``share``, ``(n,)``, and
    ``states``, ``(k, n)``, are the values of n samples at the first of the hours; ``states`` is
    overwritten. ``rngs`` are the generators of the law and of the noise.
    """
    law_rng, noise_rng = rngs
    shares, kept = [share], [states.copy()]
    for start, h in zip(hours[:-1], np.diff(hours), strict=True):
        step = law.step(shares[-1], float(start), float(h), states, law_rng)
        sigma = math.sqrt(math.log1p(math.expm1(noise**2) * 10.0 / h))
        factor = np.exp(sigma * noise_rng.standard_normal(share.size) - 0.5 * sigma**2)
        shares.append(np.minimum(shares[-1] + factor * step, 10.0))
        kept.append(states.copy())
    return np.array(shares), np.array(kept)


def _grown(
    case: ForeignCase,
    kind: str,
    fault: str,
    law: Law,
    until: float,
    repair: float,
    noise: float,
    stream: int,
) -> Grown:
    """Return the growth of a component until a service hour [h]; ``repair`` 0 is no repair."""
    rng = case.rng(stream)
    name = str(rng.choice([component.name for component in KINDS[fault]]))
    is_two_sided = KINDS[fault][0].is_two_sided
    side = float(rng.choice([-1.0, 1.0])) if is_two_sided else 1.0
    parts = []
    for since, end in ((0.0, repair), (repair, until)) if repair else ((0.0, until),):
        hours = np.arange(0.0, end - since, STEP_HOURS)
        # Faults of one unit share their load, so the noise of their growth is the same.
        rngs = (rng, case.rng(2))
        states = law.states(1, rng)
        shares, kept = continued(law, np.array([law.start]), states, hours, noise, rngs)
        parts.append((hours + since, shares[:, 0], kept[:, :, 0]))
    hours, share, states = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Grown(name, side, law, hours, share, states, repair)


def _drawn(case: ForeignCase, rng: np.random.Generator) -> ForeignLife | None:
    """Return a random life, or None if it is too short or too long or another fault ends it."""
    kinds = next(laws for laws in SETS.values() if case.kind in laws)
    faults = kinds[case.kind].faults
    # Combine each variation with each fault.
    fault = faults[(case.number + case.number // len(VARIATIONS)) % len(faults)]
    span = rng.uniform(*_LIVES_HOURS)
    noise = rng.uniform(*_NOISES)
    repair = 0.0
    if case.variation == "repair":
        repair = float(STEP_HOURS * round(rng.uniform(0.3, 0.6) * span / STEP_HOURS))
    law = kinds[case.kind].law(span, rng)
    until = repair + _LONGEST * span
    stream = int(rng.integers(10, 1_000_000))
    grown = [_grown(case, case.kind, fault, law, until, repair, noise, stream)]
    if case.variation == "two faults":
        candidates = [
            name
            for name, kind in kinds.items()
            for name_of_fault in kind.faults
            if name_of_fault != fault
        ]
        second_kind = str(rng.choice(candidates))
        second_faults = [
            name_of_fault for name_of_fault in kinds[second_kind].faults if name_of_fault != fault
        ]
        second_law = kinds[second_kind].law(span * rng.uniform(0.9, 1.5), rng)
        grown.append(
            _grown(
                case,
                second_kind,
                str(rng.choice(second_faults)),
                second_law,
                until,
                0.0,
                noise,
                stream + 1,
            )
        )
    ends = [_end(growth, repair) for growth in grown]
    end = min(ends)
    if ends[0] > end or not 600.0 < end - repair < _LONGEST * span:
        return None
    gaps = rng.uniform(5.0, 20.0, int(end / 5.0) + 1)
    tests = np.cumsum(gaps)
    if case.variation == "gap":
        begin = rng.uniform(0.3, 0.7) * end
        tests = tests[(tests < begin) | (tests > begin + rng.uniform(200.0, 400.0))]
    tests = tests[(tests < end) & (rng.random(tests.size) >= _MISSING)]
    vectors = np.tile(healthy_faults(), (tests.size, 1))
    vectors[:, ECCENTRICITY_PHASE] = rng.random()
    growing = {growth.name for growth in grown}
    for members in KINDS.values():
        # The other faults grow a little.
        slope = rng.uniform(0.0, _OTHERS_MOST) * LIMITS[members[0].name] / end
        if not growing & {member.name for member in members}:
            vectors[:, FAULT_NAMES.index(members[0].name)] += slope * tests
    for growth in grown:
        column = FAULT_NAMES.index(growth.name)
        away = np.interp(tests, growth.hours, growth.away)
        vectors[:, column] = healthy_faults()[column] + growth.side * away
    return ForeignLife(tuple(grown), tests, np.clip(vectors, 0.0, HIGHEST), end, repair, noise)


def _end(grown: Grown, after: float) -> float:
    """Return the service hour at which the limit is first reached [h]; infinite if never.

    The hour is interpolated between steps, except before ``after``, the hour of a repair [h].
    """
    limit, away = LIMITS[grown.name], grown.away
    over = np.flatnonzero(away >= limit)
    if not over.size:
        return math.inf
    at = int(over[0])
    if grown.hours[at] < after:
        return float(grown.hours[at])
    part = (limit - away[at - 1]) / (away[at] - away[at - 1])
    return float(grown.hours[at - 1] + part * (grown.hours[at] - grown.hours[at - 1]))


def _constant(rng: np.random.Generator, *, with_wave: bool) -> ForeignLife:
    """Return a life of constant faults; ``with_wave`` adds a wave to one of them."""
    still = constant_life(LIMITS, rng)
    tests = np.cumsum(rng.uniform(5.0, 20.0, still.hours.size))
    tests = tests[rng.random(tests.size) >= _MISSING]
    vectors = np.tile(still.faults[0], (tests.size, 1))
    if with_wave:
        waving = [FAULT_NAMES.index(name) for name in ("friction", "backlash", "eccentricity")]
        column = int(rng.choice(waving))
        vectors[:, column] += LIMITS[FAULT_NAMES[column]] * Seasonal(1.0, rng).wave(tests)
    return ForeignLife((), tests, np.clip(vectors, 0.0, HIGHEST), math.inf, 0.0, 0.0)
