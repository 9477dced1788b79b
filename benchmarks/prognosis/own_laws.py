"""Accuracy and honesty of the remaining useful life over lives by laws that the tracker has.

    ../tools/peers.sh python -m prognosis.own_laws [--lives N] [--constant N] [--repaired N]
        [--otherwise N] [--whole N] [--real N] [--json FILE]

Lives have estimates drawn with the measured errors of the estimator (estimator_errors.jsonl); those
of --real are simulated and identified test by test. Their seeds are fixed, and nothing was tuned on
them. The tracker knows the laws and typical rates, or no law at all; over lives of --otherwise,
whose laws are not those of the type, the law it is given is wrong. It is compared, on the same
estimates and in the same process, with a linear trend through the latest of them, NASA's progpy,
and an oracle to which only the noise of the future is unknown: more than that nobody can predict.
Lives of --whole are scored by their health messages, by fault limit or requirement, whichever is
first.
Prints tables and writes JSON.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any, Final

import cases
import numpy as np
from exactness import HEALTHY_WINDOWS, noisy_window
from rich.progress import Progress
from trials import ACTUATOR, Workers, command, workers

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_sim.lives import SimulatedLife
from prognosis.estimates import drawn
from prognosis.lives import SEED, ScoredLife, estimate_of, lives_of
from prognosis.own_tables import show
from prognosis.predictors import (
    PREDICTORS,
    SETTINGS,
    Predictor,
    law_known,
    law_unknown,
    linear_trend,
    oracle,
)
from prognosis.scores import LifeScore, by_kind
from prognosis.whole import Reports, reports, score_whole, seconds, whole_figures

try:
    from prognosis.particle_filter import particle_filter
except ImportError as error:
    raise SystemExit(
        f"own_laws.py compares with progpy ({error}); it is in the peers' environment: "
        "../tools/peers.sh python -m prognosis.own_laws"
    ) from None

METHODS: Final[Mapping[str, Predictor]] = {
    "law known": law_known,
    "law unknown": law_unknown,
    "linear trend": linear_trend,
    "progpy": particle_filter,
    "oracle": oracle,
}

TIMED: Final = 10
"""Lives whose updates with requirements are timed."""

Scores = dict[str, LifeScore]


@dataclass(frozen=True, eq=False)
class InTheLoop:
    """A life to be simulated and identified test by test."""

    scored: ScoredLife
    calibration: Calibration


def score_drawn(scored: ScoredLife) -> Scores:
    """Score a life with drawn estimates."""
    life = scored.life()
    return _scores(scored, life, drawn(scored, life))


def score_real(job: InTheLoop) -> Scores:
    """Score a life with the simulator and the estimator in the loop."""
    life = job.scored.life()
    measurements, last = [], None
    for test, (hours, window) in enumerate(zip(life.hours, life.windows, strict=True)):
        estimate = estimate_of(job.scored.case(life, test), window, job.calibration, last)
        if estimate is not None and estimate.valid:
            last = np.array(estimate.faults)
            measurements.append(Measurement.of(estimate, float(hours)))
    return _scores(job.scored, life, measurements)


def score_repaired(scored: ScoredLife) -> Scores:
    """Score a life with drawn estimates from its repair on; progpy's filter knows of no repair."""
    life = scored.life()
    measurements = drawn(scored, life)
    left_hours = life.end_hours - life.repair_hours
    return {
        name: LifeScore.of(
            scored.kind,
            scored.number,
            left_hours,
            predict(life, measurements).since(life.repair_hours),
        )
        for name, predict in PREDICTORS.items()
    }


def score_otherwise(scored: ScoredLife) -> Scores:
    """Score a life whose laws are not those of the type: the known law is wrong."""
    life = scored.life()
    made = _scores(scored, life, drawn(scored, life), PREDICTORS)
    return {"wrong law" if name == "law known" else name: score for name, score in made.items()}


def trend_reports(scored: ScoredLife) -> Reports:
    """Return what the linear trend reports of a constant life."""
    life = scored.life()
    made = linear_trend(life, drawn(scored, life))
    return Reports(len(made.hours), int(np.sum(np.isfinite(made.median))), 0, 0)


def _scores(
    scored: ScoredLife,
    life: SimulatedLife,
    measurements: Sequence[Measurement],
    methods: Mapping[str, Predictor] = METHODS,
) -> Scores:
    result = {}
    for name, predict in methods.items():
        made = predict(life, measurements)
        result[name] = LifeScore.of(scored.kind, scored.number, life.end_hours, made)
    return result


def measure(
    progress: Progress,
    lives: int,
    constant: int,
    repaired: int,
    otherwise: int,
    whole: int,
    real: int,
) -> dict[str, Any]:
    """Score lives of each kind, so many of each."""
    with workers(progress) as pool:
        return _measured(pool, lives, constant, repaired, otherwise, whole, real)


def _measured(
    pool: Workers, growing: int, constant: int, repaired: int, otherwise: int, whole: int, real: int
) -> dict[str, Any]:
    durations: dict[str, float] = {}
    figures: dict[str, Any] = {"seed": SEED, "durations_s": durations}
    for case, count, score in (
        ("drawn", growing, score_drawn),
        ("repaired", repaired, score_repaired),
        ("otherwise", otherwise, score_otherwise),
    ):
        lives = lives_of("growing" if case == "drawn" else case, count)
        if lives:
            with _timed(case, durations):
                scores = pool.map(f"lives, {case}", score, lives)
                figures[case], figures[f"{case}_lives"] = _figures(scores)
    with _timed("constant", durations):
        lives = lives_of("constant", constant)
        of_lives = pool.map("constant lives", reports, lives)
        trends = pool.map("their linear trends", trend_reports, lives)
        figures["constant"] = {
            name: constant_figures(
                [meets for meets, _ in of_lives], [by_case[name] for _, by_case in of_lives]
            )
            for name in SETTINGS
        }
        figures["constant"]["linear trend"] = constant_figures([True] * len(lives), trends)
    if whole:
        with _timed("whole", durations):
            scores = pool.map("with requirements", score_whole, lives_of("growing", whole))
            figures["whole"] = {
                name: whole_figures([score[name] for score in scores]) for name in SETTINGS
            }
    if real:
        with _timed("real", durations):
            healthy = cases.healthy(HEALTHY_WINDOWS, "calibration")
            calibration = calibrate_model(
                pool.map("healthy windows", noisy_window, healthy), ACTUATOR
            )
            jobs = [InTheLoop(scored, calibration) for scored in lives_of("real", real)]
            scores = pool.map("lives in the loop", score_real, jobs)
            figures["real"], figures["real_lives"] = _figures(scores)
    with _timed("time", durations):
        spent = pool.map("time with requirements", seconds, lives_of("growing", TIMED))
        later = np.concatenate([one[1:] for one in spent])
        figures["whole_update"] = {
            "lives": len(spent),
            "median_s": float(np.median(later)),
            "p95_s": float(np.quantile(later, 0.95)),
            "first_median_s": float(np.median([one[0] for one in spent])),
        }
    return figures


def constant_figures(meets: Sequence[bool], made: Sequence[Reports]) -> dict[str, Any]:
    """Return what was reported of constant lives, each of which meets all requirements or not."""
    wrong = [good and one.failing > 0 for good, one in zip(meets, made, strict=True)]
    return {
        "lives": len(made),
        "reported": sum(
            one.by_faults + one.by_requirements > 0 or failing
            for one, failing in zip(made, wrong, strict=True)
        ),
        "by_faults": sum(one.by_faults > 0 for one in made),
        "by_requirements": sum(one.by_requirements > 0 for one in made),
        "wrongly_reported_failing": sum(wrong),
        "failing": sum(not good for good in meets),
        "rightly_reported_failing": sum(
            one.failing > 0 and not good for good, one in zip(meets, made, strict=True)
        ),
        "tests": sum(one.tests for one in made),
        "tests_with_report": sum(one.by_faults + one.by_requirements for one in made),
    }


@contextmanager
def _timed(name: str, durations: dict[str, float]) -> Iterator[None]:
    started = time.perf_counter()
    yield
    durations[name] = time.perf_counter() - started


def _figures(scores: Sequence[Scores]) -> tuple[dict[str, Any], dict[str, Any]]:
    of_each = {name: [life[name] for life in scores] for name in scores[0]}
    return (
        {name: by_kind(of_one) for name, of_one in of_each.items()},
        {name: [asdict(score) for score in of_one] for name, of_one in of_each.items()},
    )


main = command(
    measure,
    show,
    185,
    lives=300,
    constant=100,
    repaired=50,
    otherwise=100,
    whole=50,
    real=20,
)

if __name__ == "__main__":
    main()
