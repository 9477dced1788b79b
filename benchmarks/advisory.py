"""Cost of the advice over seeded lives, beside an oracle, fixed intervals and running to failure.

    python benchmarks/advisory.py [--lives N] [--others N] [--json FILE]

Each life to failure is followed test by test, with estimates drawn at the measured errors of the
estimator. After each test the tracker, which knows no law, predicts, and a policy decides: go on,
or remove the unit after the lead time. All policies see the same samples of the remaining life at
the same tests. The cost is that of all lives over the hours of all lives, relative to a removal.

- advice: as published (docs/prognosis.md, P18, P19); nothing in it is fitted to lives.
- oracle: the best of two families of policies, with their figures chosen in hindsight on these very
  lives: removal as soon as a quantile of the remaining life is nearer than the next chance by a
  margin, and age replacement at a given cost rate.
- fixed interval: removal at one age, the best on other lives of the same population.
- to failure: no removal before a failure.
- known end: a removal just before each failure, which nobody can do.

Prints a table and writes JSON.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
from numpy.typing import NDArray
from prognosis.estimates import drawn
from prognosis.lives import ScoredLife, lives_of
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from tables import target_table
from targets import Row
from trials import workers

from ema_monitor.prognosis.advice import Costs, Decision
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_sim.lives import LifeSettings

FAILURES: Final = (5.0, 10.0, 20.0)
"""Cost of a failure over that of a removal [-]."""
LEADS: Final = (0.0, 20.0, 50.0)
"""Lead times [h]."""
MOST_OVER_ORACLE: Final = 1.05
"""Largest cost of the advice over that of the oracle [-]."""

_INTERVAL: Final = LifeSettings().interval_hours
_QUANTILES: Final = (5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.3)
_MARGINS: Final = (0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
_RATES: Final = (5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 15e-3)
_AGES: Final = np.arange(100.0, 2500.0, 5.0)


@dataclass(frozen=True, eq=False)
class Course:
    """What is known after each test of a life, and when it ends.

    Attributes
    ----------
    hours
        Service hours of the tests with a known remaining life, ``(n,)`` [h].
    lives
        Samples of the remaining life in ascending order, ``(n, m)`` [h].
    missing
        Probability that a test gives no estimate, by Laplace's rule, ``(n,)`` [-].
    end
        Service hour of the failure [h].
    """

    hours: NDArray[np.float64]
    lives: NDArray[np.float32]
    missing: NDArray[np.float64]
    end: float


Policy = Callable[[Course], NDArray[np.float64]]
"""Hours from each test to the removal, ``(n,)`` [h]; NaN to go on."""


def follow(scored: ScoredLife) -> Course:
    """Return what the tracker predicts after each test of a life."""
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
    """Return the service hour at which a life ends [h]."""
    return scored.life().end_hours


def advice(costs: Costs) -> Policy:
    """Return the policy of the advice that is published."""

    def policy(course: Course) -> NDArray[np.float64]:
        until = np.full(len(course.hours), np.nan)
        for k, (hours, lives) in enumerate(zip(course.hours, course.lives, strict=True)):
            samples, missing = lives.astype(np.float64), float(course.missing[k])
            decision = Decision(costs, float(hours), _INTERVAL, samples, missing)
            removal = decision.remove()
            if removal.rate <= decision.wait().rate:
                until[k] = removal.removal_hours
                break
        return until

    return policy


def threshold(costs: Costs, quantile: float, margin: float) -> Policy:
    """Return the policy that removes when a quantile of the life is near by a margin [h]."""

    def policy(course: Course) -> NDArray[np.float64]:
        left = course.lives[:, int(quantile * course.lives.shape[1])] - margin
        is_near = left < _INTERVAL + costs.lead_time
        return np.where(is_near, np.maximum(left, costs.lead_time), np.nan)

    return policy


def replacement(costs: Costs, rate: float) -> Policy:
    """Return age replacement at a given cost rate [1/h], which expects no further test."""

    def policy(course: Course) -> NDArray[np.float64]:
        until = np.full(len(course.hours), np.nan)
        for k, row in enumerate(course.lives):
            lives = row.astype(np.float64)
            at = np.concatenate([[costs.lead_time], lives[lives > costs.lead_time]])
            fail = np.searchsorted(lives, at, "left")
            risk = fail / lives.size
            used = np.concatenate([[0.0], np.cumsum(lives)])[fail] / lives.size + (1 - risk) * at
            lost = costs.removal + (costs.failure - costs.removal) * risk - rate * used
            best = float(at[int(np.argmin(lost))])
            if best < _INTERVAL + costs.lead_time:
                until[k] = best
                break
        return until

    return policy


def outcome(courses: Sequence[Course], policy: Policy, costs: Costs) -> dict[str, float]:
    """Return cost rate, failures and mean hours of lives under a policy."""
    cost, hours, failures = 0.0, 0.0, 0
    for course in courses:
        until = policy(course)
        decided = np.flatnonzero(~np.isnan(until) & (course.hours < course.end))
        removed = np.inf
        if decided.size:
            removed = float(course.hours[decided[0]] + until[decided[0]])
        failed = removed >= course.end
        failures += failed
        cost += costs.failure if failed else costs.removal
        hours += min(removed, course.end)
    return {
        "cost_rate": cost / hours,
        "failures": int(failures),
        "mean_hours": hours / len(courses),
    }


def at_age(ends: NDArray[np.float64], age: float, costs: Costs) -> float:
    """Return the cost rate of removals at one age."""
    cost = np.where(ends <= age, costs.failure, costs.removal)
    return float(np.sum(cost) / np.sum(np.minimum(ends, age)))


def compare(
    courses: Sequence[Course], other_ends: NDArray[np.float64], costs: Costs
) -> dict[str, Any]:
    """Return the figures of all policies at some costs."""
    candidates: dict[str, Policy] = {
        f"quantile {quantile:g}, margin {margin:g} h": threshold(costs, quantile, margin)
        for quantile, margin in product(_QUANTILES, _MARGINS)
    } | {f"rate {rate:g}": replacement(costs, rate * costs.removal) for rate in _RATES}
    found = {name: outcome(courses, policy, costs) for name, policy in candidates.items()}
    name = min(found, key=lambda one: found[one]["cost_rate"])
    ends = np.array([course.end for course in courses])
    age = min(_AGES, key=lambda one: at_age(other_ends, one, costs))
    return {
        "failure": costs.failure,
        "lead_hours": costs.lead_time,
        "advice": outcome(courses, advice(costs), costs),
        "oracle": found[name] | {"policy": name},
        "fixed": {
            "cost_rate": at_age(ends, age, costs),
            "age": float(age),
            "failures": int(np.sum(ends <= age)),
        },
        "to_failure": {"cost_rate": float(costs.failure / np.mean(ends))},
        "known_end": {"cost_rate": float(costs.removal / np.mean(ends))},
    }


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return what was measured with its targets."""
    result = []
    for one in figures["cases"]:
        case = f"failure {one['failure']:g} removals, lead {one['lead_hours']:g} h"
        rate = one["advice"]["cost_rate"]
        over, share = rate / one["oracle"]["cost_rate"], rate / one["fixed"]["cost_rate"]
        limit = f"<= {MOST_OVER_ORACLE:g}"
        over_fixed = f"{case}: cost over the best fixed interval"
        result += [
            Row(f"{case}: cost over the oracle", limit, f"{over:.3f}", over <= MOST_OVER_ORACLE),
            Row(over_fixed, "< 1", f"{share:.3f}", share < 1.0),
        ]
    return result


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the tables."""
    table = Table(title=f"cost per 1,000 flight hours over {figures['lives']} lives, in removals")
    headings = ("failure", "lead [h]", "advice", "(failed)", "oracle", "(failed)", "its policy")
    for heading in (*headings, "fixed", "(age)", "to failure", "known end"):
        table.add_column(heading, justify="left" if heading == "its policy" else "right")
    for one in figures["cases"]:
        advised_, best, fixed = one["advice"], one["oracle"], one["fixed"]
        table.add_row(
            f"{one['failure']:g}",
            f"{one['lead_hours']:g}",
            f"{1e3 * advised_['cost_rate']:.3f}",
            f"{advised_['failures']}",
            f"{1e3 * best['cost_rate']:.3f}",
            f"{best['failures']}",
            best["policy"],
            f"{1e3 * fixed['cost_rate']:.3f}",
            f"{fixed['age']:g} h",
            f"{1e3 * one['to_failure']['cost_rate']:.3f}",
            f"{1e3 * one['known_end']['cost_rate']:.3f}",
        )
    console.print(table)
    console.print(target_table("targets", rows(figures)))


@click.command()
@click.option("--lives", default=300, show_default=True, type=click.IntRange(5))
@click.option("--others", default=1000, show_default=True, type=click.IntRange(5))
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(lives: int, others: int, output: Path | None) -> None:
    """Print the tables and write the JSON file."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with (
        Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True)) as progress,
        workers(progress) as pool,
    ):
        courses = pool.map("lives", follow, lives_of("advised", lives))
        ends = np.array(pool.map("other lives", end_of, lives_of("advised_others", others)))
    cases = [
        compare(courses, ends, Costs(removal=1.0, failure=failure, lead_time=lead))
        for failure, lead in product(FAILURES, LEADS)
    ]
    figures = {"lives": lives, "others": others, "cases": cases}
    show(Console(width=150), figures)
    if output:
        output.write_text(json.dumps(figures))


if __name__ == "__main__":
    main()
