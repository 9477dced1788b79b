# SPDX-License-Identifier: Apache-2.0
"""Benefit of each mechanism of growth: the prognosis without it, on the same lives.

    python -m prognosis.ablation [--own-laws N] [--wrong N] [--repaired N] [--developed N]
        [--held-out N] [--unseen N] [--thin N]

Lives to failure follow laws that the tracker has ("own"), laws that it was developed with, among
them waves and S-shaped growth ("developed"), and laws that were not used in development ("held
out", "unseen"). There are N own lives, and N lives of each other law; the tracker does not know
which law applies. Two sets alter own lives: one of 25 estimates is wrong by far more than its sigma
("wrong estimates"), or the unit is repaired and lives again ("repaired"). One of every --thin tests
is used.

Each mechanism is switched off separately, by an argument of the tracker's constructor. The fleet
prior is switched on instead. Its fleet consists of units of the own lives, so it differs in kind
from the units of the other sets. Damage is judged on lives whose duty changes (``duty.py``).

A change is the mean over lives of the difference from the full model on the same estimates, with a
standard error by bootstrap over lives. A mechanism is beneficial if the result without it is worse
by more than the standard error. "Too long" is the share of predictions in the second half of life
whose 5 % quantile exceeds the truth. Constant lives, half of them with a wave, should have no
predicted life at all.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from script import Figures, Workers, command
from targets import grid

from ema_core.faults import COMPONENTS, HIGHEST, INDICES
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.fleet_growth import FleetGrowth
from ema_monitor.prognosis.growth.check import PredictionCheck
from ema_monitor.prognosis.growth.fleet_prior import grid_digest
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.mechanisms import MECHANISMS, Mechanisms
from ema_monitor.prognosis.growth.outliers import OutlierDetector
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import FleetPrior, TrackerSettings
from prognosis import duty, foreign_lives, lives
from prognosis.estimates import drawn
from prognosis.fleet_prior import unit_of
from prognosis.laws import SETS
from prognosis.metrics import cumulative_relative_accuracy

FULL: Final = "full"
FLEET: Final = "with a fleet of the own lives"
EVERY: Final = 3
"""Number of tests from one scored prediction to the next."""
_DUTY_EVERY: Final = 4
SAMPLES: Final = 500
"""Samples of a scored prediction."""
DRAWS: Final = 2000
"""Draws of the bootstrap."""
WRONG: Final = 0.04
"""Probability of a wrong estimate, in lives with wrong estimates."""
WRONG_BY: Final = (0.1, 0.5)
"""Smallest and largest error of a wrong estimate, as a share of the limit (log-uniform)."""

Array = NDArray[np.float64]


class UsesAll(OutlierDetector):
    """An outlier detector that withholds no test."""

    def judge(self, measurement: Measurement, mean: Array, variance: Array, tests: Any) -> Any:
        nothing = np.zeros(len(mean), dtype=bool)
        return [], nothing, nothing.copy()


class WidensNothing(PredictionCheck):
    """A prediction check that does not widen the intervals."""

    def widening(self) -> Array:
        return np.ones_like(super().widening())


def tracker(settings: TrackerSettings, mechanisms: Mechanisms = MECHANISMS) -> Tracker:
    """Return a tracker with the default limits and the given settings and mechanisms."""
    return Tracker(HealthLimits(), settings, mechanisms)


def _without_law(name: str) -> Mechanisms:
    return Mechanisms(laws=tuple(law for law in MECHANISMS.laws if law != name))


VARIANTS: Final[Mapping[str, Callable[[TrackerSettings], Tracker]]] = {
    FULL: tracker,
    "steady rates": partial(tracker, mechanisms=Mechanisms(wandering=1.0)),
    "wandering rates": partial(tracker, mechanisms=Mechanisms(wandering=0.0)),
    "waves": partial(tracker, mechanisms=Mechanisms(wave=0.0)),
    "jumps": partial(tracker, mechanisms=_without_law("jumps")),
    "logistic": partial(tracker, mechanisms=_without_law("logistic")),
    "change for good": partial(tracker, mechanisms=Mechanisms(changed=(1.0, 1.0))),
    "outliers": lambda settings: Tracker(HealthLimits(), settings, outliers=UsesAll(settings)),
    "check that widens": lambda settings: Tracker(
        HealthLimits(), settings, check=WidensNothing(settings)
    ),
}
"""Constructors of trackers, by the name of the mechanism that is switched off."""


class Score(NamedTuple):
    """Scores of a life."""

    accuracy: float  # cumulative relative accuracy over the second half of life [-]
    inside: int  # number of 90 % intervals that contain the truth
    intervals: int  # number of 90 % intervals
    too_long: int  # number of intervals above the truth in the second half of life
    late: int  # number of intervals in the second half of life


class WrongEstimates(NamedTuple):
    """An own life in which some estimates are wrong, although their sigmas are as usual."""

    case: lives.ScoredLife


class Repaired(NamedTuple):
    """A unit that is repaired after 60 % of an own life, and then lives the life again."""

    case: lives.ScoredLife


Scored = lives.ScoredLife | foreign_lives.ForeignCase | WrongEstimates | Repaired


def _life(case: Scored) -> tuple[list[Measurement], float, float]:
    """Return the estimates of a life, the hour at which its scoring starts, and its end [h]."""
    if isinstance(case, foreign_lives.ForeignCase):
        foreign = case.life()
        return case.measurements(foreign), foreign.start_hours, foreign.end_hours
    if isinstance(case, WrongEstimates):
        measurements, start, end = _life(case.case)
        rng = case.case.rng(2)
        return [_maybe_wrong(measurement, rng) for measurement in measurements], start, end
    if isinstance(case, Repaired):
        measurements, start, end = _life(case.case)
        repair = 0.6 * end
        before = [item for item in measurements if item.hours < repair]
        return [*before, *(_later(item, repair) for item in measurements)], repair, repair + end
    life = case.life()
    return drawn(case, life), 0.0, life.end_hours


def _later(measurement: Measurement, hours: float) -> Measurement:
    """Return a measurement whose test is ``hours`` later."""
    later = measurement.hours + hours
    return Measurement(later, measurement.faults, measurement.covariance, measurement.unobservable)


def _maybe_wrong(measurement: Measurement, rng: np.random.Generator) -> Measurement:
    """Return a measurement that has, with probability `WRONG`, a wrong component."""
    is_wrong, component = rng.random() < WRONG, int(rng.integers(len(COMPONENTS)))
    share = np.exp(rng.uniform(*np.log(WRONG_BY))) * rng.choice((-1.0, 1.0))
    if not is_wrong:
        return measurement
    faults = measurement.faults.copy()
    faults[INDICES[component]] += share * HealthLimits().of(COMPONENTS[component])
    return replace(measurement, faults=np.clip(faults, 0.0, HIGHEST))


def scores_of(case: Scored, fleet: FleetPrior | None, thin: int) -> dict[str, Score]:
    """Return the scores of a life by variant of the tracker."""
    measurements, start, end = _life(case)
    measurements = measurements[::thin]
    settings = TrackerSettings(samples=SAMPLES)
    made = {name: make(settings) for name, make in VARIANTS.items()}
    made[FLEET] = tracker(TrackerSettings(samples=SAMPLES, fleet=fleet))
    return {name: _score(variant, measurements, start, end) for name, variant in made.items()}


def _score(
    tracker: Tracker, measurements: Sequence[Measurement], start: float, end: float
) -> Score:
    rows = []
    for number, measurement in enumerate(measurements):
        tracker.update(measurement)
        if measurement.hours >= start and number % EVERY == EVERY - 1:
            life = tracker.predict().overall
            rows.append((measurement.hours, life.hours_05, life.hours_50, life.hours_95))
    hours, low, median, high = np.array(rows).reshape(-1, 4).T
    left, is_predicted = end - hours, np.isfinite(low)
    late = is_predicted & (hours - start >= 0.5 * (end - start))
    return Score(
        cumulative_relative_accuracy(hours - start, median, end - start),
        int(np.sum(is_predicted & (low <= left) & (left <= high))),
        int(np.sum(is_predicted)),
        int(np.sum(late & (low > left))),
        int(np.sum(late)),
    )


def reported(case: foreign_lives.ForeignCase, thin: int) -> dict[str, bool]:
    """Return by variant whether it predicts a remaining life for a unit with constant faults."""
    life = case.life()
    measurements = case.measurements(life)[::thin]
    settings = TrackerSettings(samples=100)
    return {name: _reports(make(settings), measurements) for name, make in VARIANTS.items()}


def _reports(tracker: Tracker, measurements: Sequence[Measurement]) -> bool:
    for measurement in measurements:
        tracker.update(measurement)
        if tracker.predict().overall.known:
            return True
    return False


def by_damage(seed: int) -> dict[str, tuple[list[float], list[bool]]]:
    """Return accuracies and coverage flags over all kinds of duty, by damage and by hours."""
    result = {}
    for growth_per in ("damage", "hours"):
        each = [duty.scores((kind, growth_per, seed), every=_DUTY_EVERY) for kind in duty.KINDS]
        accuracy, covered = zip(*each, strict=True)
        result[growth_per] = [*chain(*accuracy)], [*chain(*covered)]
    return result


def measure(
    pool: Workers,
    own_laws: int,
    wrong: int,
    repaired: int,
    developed: int,
    held_out: int,
    unseen: int,
    constant: int,
    fleet: int,
    duties: int,
    thin: int,
) -> Figures:
    """Score lives with each mechanism of growth switched off."""
    limits = HealthLimits()
    units = pool.map("fleet", unit_of, lives.lives_of("fleet", fleet))
    evidence = {str(number): unit for number, unit in enumerate(units)}
    prior = FleetGrowth(grid_digest(limits), evidence).prior(limits)
    cases: dict[str, list[Scored]] = {
        "own": [*lives.lives_of("growing", own_laws)],
        "wrong estimates": [*map(WrongEstimates, lives.lives_of("growing", wrong))],
        "repaired": [*map(Repaired, lives.lives_of("growing", repaired))],
        "developed": [*foreign_lives.lives_of(SETS["development"], developed)],
        "held out": [*foreign_lives.lives_of(SETS["held out"], held_out)],
        "unseen": [*foreign_lives.lives_of(SETS["unseen"], unseen)],
    }
    scores = {
        name: pool.map(f"{name} lives", partial(scores_of, fleet=prior, thin=thin), set_cases)
        for name, set_cases in cases.items()
    }
    still = foreign_lives.constant_lives(constant)
    constant_reports = pool.map("constant lives", partial(reported, thin=thin), still)
    return {
        "scores": scores,
        "constant": {name: sum(entry[name] for entry in constant_reports) for name in VARIANTS},
        "constant_lives": constant,
        "duty": pool.map("lives by duty", by_damage, range(duties)),
    }


def _figures(scores: Array) -> Array:
    """Return accuracy, coverage and share of too long intervals, ``(..., 3)``, over n lives.

    ``scores``, ``(..., n, 5)``, has the fields of ``Score``.
    """
    accuracy = np.nanmean(scores[..., 0], axis=-1)
    sums = scores[..., 1:].sum(axis=-2)
    inside, intervals, too_long, late = np.moveaxis(sums, -1, 0)
    covered = inside / np.maximum(intervals, 1)
    return np.stack([accuracy, covered, too_long / np.maximum(late, 1)], axis=-1)


def _changes(full: Array, without: Array) -> tuple[Array, Array]:
    """Return the change of ``_figures`` without a mechanism, and its bootstrap standard error."""
    rng = np.random.default_rng(0)
    drawn_lives = rng.integers(len(full), size=(DRAWS, len(full)))
    changes = _figures(without[drawn_lives]) - _figures(full[drawn_lives])
    return _figures(without) - _figures(full), changes.std(axis=0)


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print."""
    sets = {
        name: {key: np.array([score[key] for score in set_scores], float) for key in set_scores[0]}
        for name, set_scores in figures["scores"].items()
        if set_scores
    }
    constant, names = figures["constant"], ("accuracy", "coverage", "too long")
    for name, scores in sets.items():
        yield grid(
            f"{name}, {len(scores[FULL])} lives: change without each, ± standard error",
            ("without", *names, "constant lives\nwith a life"),
            (
                (key, *_cells(scores[FULL], scored), constant.get(key, ""))
                for key, scored in scores.items()
            ),
            digits=3,
        )
    if figures["duty"]:
        yield _duty_table(figures["duty"])


def _cells(full: Array, scores: Array) -> list[str]:
    if scores is full:
        return [f"{value:.3f}" for value in _figures(full)]
    change, error = _changes(full, scores)
    return [f"{by:+.3f} ± {of:.3f}" for by, of in zip(change, error, strict=True)]


def _duty_table(lives_by_duty: Sequence[Any]) -> Table:
    by = {
        key: np.array([[np.mean(part) for part in entry[key]] for entry in lives_by_duty], float)
        for key in ("damage", "hours")
    }
    full, changes = by["damage"].mean(axis=0), by["hours"] - by["damage"]
    error = changes.std(axis=0, ddof=1) / np.sqrt(len(changes))
    without = zip(changes.mean(axis=0), error, strict=True)
    rows = [
        (FULL, *(f"{value:.3f}" for value in full)),
        ("damage", *(f"{by:+.3f} ± {of:.3f}" for by, of in without)),
    ]
    title = f"duty that changes: {len(changes)} lives of each of {len(duty.KINDS)} kinds"
    return grid(title, ("without", "accuracy", "coverage"), rows)


main = command(
    measure,
    "ablation",
    tables=tables,
    own_laws=30,
    wrong=30,
    repaired=30,
    developed=6,
    held_out=7,
    unseen=14,
    constant=20,
    fleet=30,
    duties=4,
    thin=2,
)

if __name__ == "__main__":
    main()
