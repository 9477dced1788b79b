# SPDX-License-Identifier: Apache-2.0
"""Cost of the maintenance advice compared with an oracle, fixed intervals and run-to-failure.

    python benchmarks/advisory.py [--lives N] [--reference N] [--json FILE]

Each simulated life is followed test by test until failure, with estimates drawn at the measured
errors of the estimator. After each test the tracker, which does not know the growth law, predicts
the remaining life. A policy then decides whether to continue or to remove the unit after the lead
time. All policies see the same samples of the remaining life at the same tests. The cost rate is
the cost of all lives, in removals, over the hours of all lives.

- advice: the published advice (docs/prognosis.md, P18, P19). It has no parameters fitted to lives.
- oracle: the best of two families of policies, whose parameters are chosen in hindsight on the same
  lives. The first removes a unit when a quantile of its remaining life, less a margin, is below
  the time until the next test plus the lead time. The second is age replacement at a given cost
  rate.
- fixed interval: removal at one age, the best age on other lives of the same population.
- to failure: no removal before a failure.
- known end: a removal just before each failure, a bound that no policy can reach.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from prognosis.estimates import drawn
from prognosis.lives import ScoredLife, lives_of
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_most, grid

from ema_monitor.prognosis.advice import Costs, Decision
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings
from ema_sim.lives import LifeSettings

FAILURES: Final = (5.0, 10.0, 20.0)
"""Cost of a failure over the cost of a removal [-]."""
LEADS: Final = (0.0, 20.0, 50.0)
"""Lead times [h]."""
MOST_OVER_ORACLE: Final = 1.05
"""Largest cost of the advice over the cost of the oracle [-]."""

_INTERVAL: Final = LifeSettings().interval_hours
_QUANTILES: Final = (5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.3)
_MARGINS: Final = (0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
_RATES: Final = (5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 15e-3)
_AGES: Final = np.arange(100.0, 2500.0, 5.0)


@dataclass(frozen=True, eq=False)
class Course:
    """Predictions after each test of a life, and the end of the life."""

    hours: NDArray[np.float64]  # service hours of tests with a known remaining life, (n,) [h]
    lives: NDArray[np.float32]  # samples of the remaining life in ascending order, (n, m) [h]
    missing: NDArray[np.float64]  # probability of no estimate, by Laplace's rule, (n,) [-]
    end: float  # service hour of the failure [h]


Policy = Callable[[Course], float]
"""Function that returns the service hour of removal of a course [h]; infinite for no removal."""


def follow(scored: ScoredLife) -> Course:
    """Return the predictions of the tracker after each test with a known remaining life."""
    life = scored.life()
    tracker, settings = Tracker(), TrackerSettings()
    hours, lives, missing = [], [], []
    measurements = drawn(scored, life)
    first = measurements[0].hours
    for valid, measurement in enumerate(measurements, 1):
        tracker.update(measurement)
        prognosis = tracker.predict()
        if prognosis.overall.known:
            observed = measurement.hours - first
            without = round(observed / _INTERVAL) + 1 - valid
            horizon = min(settings.horizon_hours, settings.horizon_factor * observed)
            hours.append(measurement.hours)
            lives.append(np.sort(np.minimum(prognosis.samples, horizon)).astype(np.float32))
            missing.append((without + 1) / (without + valid + 2))
    samples = np.array(lives).reshape(len(hours), -1)
    return Course(np.array(hours), samples, np.array(missing), life.end_hours)


def end_of(scored: ScoredLife) -> float:
    """Return the service hour at which a life fails [h]."""
    return scored.life().end_hours


def advice(costs: Costs) -> Policy:
    """Return the policy that follows the published advice."""

    def policy(course: Course) -> float:
        for hours, lives, missing in zip(course.hours, course.lives, course.missing, strict=True):
            samples = lives.astype(np.float64)
            decision = Decision(costs, float(hours), _INTERVAL, samples, float(missing))
            removal = decision.remove()
            if removal.rate <= decision.wait().rate:
                return float(hours + removal.removal_hours)
        return np.inf

    return policy


def threshold(costs: Costs, quantile: float, margin: float) -> Policy:
    """Return the policy that removes a unit when a quantile of its remaining life is near.

    It decides to remove at the first test whose quantile, less ``margin`` [h], is below the time
    until the next test plus the lead time. It removes the unit after that reduced quantile, or
    after the lead time if that is longer.
    """

    def policy(course: Course) -> float:
        left = course.lives[:, int(quantile * course.lives.shape[1])] - margin
        near = np.flatnonzero(left < _INTERVAL + costs.lead_time)
        if not near.size:
            return np.inf
        return float(course.hours[near[0]] + np.maximum(left[near[0]], costs.lead_time))

    return policy


def replacement(costs: Costs, rate: float) -> Policy:
    """Return the policy of age replacement at a cost rate [1/h].

    After each test it chooses the time of removal with the least expected cost, less ``rate`` for
    each hour of use, as if no test followed. It removes the unit at that time if it is before the
    next test plus the lead time.
    """

    def policy(course: Course) -> float:
        for hours, row in zip(course.hours, course.lives, strict=True):
            lives = row.astype(np.float64)
            at = np.concatenate([[costs.lead_time], lives[lives > costs.lead_time]])
            fail = np.searchsorted(lives, at, "left")
            risk = fail / lives.size
            used = np.concatenate([[0.0], np.cumsum(lives)])[fail] / lives.size + (1 - risk) * at
            lost = costs.removal + (costs.failure - costs.removal) * risk - rate * used
            best = float(at[int(np.argmin(lost))])
            if best < _INTERVAL + costs.lead_time:
                return float(hours + best)
        return np.inf

    return policy


def outcome(courses: Sequence[Course], policy: Policy, costs: Costs) -> dict[str, float]:
    """Return the cost rate [1/h], failures and mean hours of lives under a policy."""
    ends = np.array([course.end for course in courses])
    removed = np.array([policy(course) for course in courses])
    failed = removed >= ends
    hours = np.sum(np.minimum(removed, ends))
    return {
        "cost_rate": float(np.sum(np.where(failed, costs.failure, costs.removal)) / hours),
        "failures": int(np.sum(failed)),
        "mean_hours": float(hours / len(courses)),
    }


def at_age(ends: NDArray[np.float64], age: float, costs: Costs) -> float:
    """Return the cost rate [1/h] of removals at one age [h]; ``ends`` [h] are the failures."""
    cost = np.where(ends <= age, costs.failure, costs.removal)
    return float(np.sum(cost) / np.sum(np.minimum(ends, age)))


def compare(
    courses: Sequence[Course], other_ends: NDArray[np.float64], costs: Costs
) -> dict[str, Any]:
    """Return the outcome of each policy at the given costs.

    The age of fixed intervals is chosen on ``other_ends`` [h], the failures of other lives.
    """
    candidates: dict[str, Policy] = {
        f"quantile {quantile:g}, margin {margin:g} h": threshold(costs, quantile, margin)
        for quantile, margin in product(_QUANTILES, _MARGINS)
    } | {f"rate {rate:g}": replacement(costs, rate * costs.removal) for rate in _RATES}
    outcomes = {name: outcome(courses, policy, costs) for name, policy in candidates.items()}
    name = min(outcomes, key=lambda policy: outcomes[policy]["cost_rate"])
    ends = np.array([course.end for course in courses])
    age = min(_AGES, key=lambda interval: at_age(other_ends, interval, costs))
    return {
        "failure": costs.failure,
        "lead_hours": costs.lead_time,
        "advice": outcome(courses, advice(costs), costs),
        "oracle": outcomes[name] | {"policy": name},
        "fixed": {
            "cost_rate": at_age(ends, age, costs),
            "age": float(age),
            "failures": int(np.sum(ends <= age)),
        },
        "to_failure": {"cost_rate": float(costs.failure / np.mean(ends))},
        "known_end": {"cost_rate": float(costs.removal / np.mean(ends))},
    }


def measure(pool: Workers, lives: int, reference: int) -> Figures:
    """Measure the cost of the advice; fixed intervals are fitted to other lives."""
    courses = pool.map("lives", follow, lives_of("advised", lives))
    ends = np.array(pool.map("other lives", end_of, lives_of("advised_others", reference)))
    cases = [
        compare(courses, ends, Costs(removal=1.0, failure=failure, lead_time=lead))
        for failure, lead in product(FAILURES, LEADS)
    ]
    return {"lives": lives, "reference": reference, "cases": cases}


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    for comparison in figures["cases"]:
        case = f"failure {comparison['failure']:g} removals, lead {comparison['lead_hours']:g} h"
        rate = comparison["advice"]["cost_rate"]
        over, share = (
            rate / comparison["oracle"]["cost_rate"],
            rate / comparison["fixed"]["cost_rate"],
        )
        yield at_most(f"{case}: cost over the oracle", over, MOST_OVER_ORACLE, f"{over:.3f}")
        what = f"{case}: cost over the best fixed interval"
        yield Row(what, "< 1", f"{share:.3f}", share < 1.0)


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print below the targets."""
    headings = ("failure", "lead [h]", "advice", "(failed)", "oracle", "(failed)", "its policy")
    yield grid(
        f"cost per 1,000 service hours over {figures['lives']} lives, in removals",
        (*headings, "fixed", "(age) [h]", "to failure", "known end"),
        (
            (
                *(f"{comparison[key]:g}" for key in ("failure", "lead_hours")),
                *(1e3 * comparison["advice"]["cost_rate"], comparison["advice"]["failures"]),
                *(1e3 * comparison["oracle"]["cost_rate"], comparison["oracle"]["failures"]),
                comparison["oracle"]["policy"],
                *(1e3 * comparison["fixed"]["cost_rate"], f"{comparison['fixed']['age']:g}"),
                *(1e3 * comparison[key]["cost_rate"] for key in ("to_failure", "known_end")),
            )
            for comparison in figures["cases"]
        ),
        digits=3,
    )


main = command(measure, "advice", rows, tables, width=150, lives=300, reference=1000)

if __name__ == "__main__":
    main()
