# SPDX-License-Identifier: Apache-2.0
"""Accuracy and coverage of the remaining useful life, on lives by laws that the tracker has.

    python -m prognosis.own_laws [--lives N] [--constant N] [--whole N] [--real N] [--json FILE]

Lives have estimates drawn with the measured errors of the estimator (estimator_errors.jsonl). The
tests of --real lives are simulated and identified one by one. The seeds are fixed and were not used
for tuning. The tracker knows the laws and typical rates, or no law. It is compared on the same
estimates with an oracle, which knows everything but the future noise. This is the limit of
predictability. Lives of --whole are scored by the remaining life in their health messages, by fault
limit or requirement, whichever is reached first.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Final

import cases
import numpy as np
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_most, grid, none_of, percent, untargeted
from trials import ACTUATOR, HEALTHY_WINDOWS, noisy_window

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.prognosis.growth.measurement import Measurement
from prognosis.estimates import drawn
from prognosis.lives import SEED, ScoredLife, estimate_of, lives_of
from prognosis.predictors import SETTINGS, Predictor, law_known, law_unknown, oracle
from prognosis.scores import LAMBDAS, WITHOUT_DIFFUSION, LifeScore, by_kind, summary
from prognosis.whole import reports, score_whole

METHODS: Final[Mapping[str, Predictor]] = {
    "law known": law_known,
    "law unknown": law_unknown,
    "oracle": oracle,
}

TARGETS: Final = {"law known": (0.90, 0.95), "law unknown": (0.80, 0.85)}
"""Least cumulative relative accuracy and least pass rate of the alpha-lambda test [-]."""
COVERAGE: Final = (0.85, 0.95)
LONGEST_S: Final = 0.02
BY_MESSAGE: Final = ("lives", "cra", "coverage", "seconds")
BESIDE: Final = "oracle"
"""Method for comparison: no tracker can reach an accuracy that the oracle misses."""

_TITLES: Final = {"drawn": "drawn estimates", "real": "estimator in the loop"}


@dataclass(frozen=True, eq=False)
class Job:
    """A life to score; with a calibration its tests are simulated and identified one by one."""

    scored: ScoredLife
    calibration: Calibration | None = None

    def scores(self) -> dict[str, LifeScore]:
        """Return the scores of each method's predictions, by method."""
        life, scored = self.scored.life(), self.scored
        calibration = self.calibration
        measurements = self.identified(calibration) if calibration else drawn(scored, life)
        return {
            name: LifeScore.of(scored.kind, life.end_hours, predict(life, measurements))
            for name, predict in METHODS.items()
        }

    def identified(self, calibration: Calibration) -> list[Measurement]:
        """Return the valid estimates of the tests, each with a warm start from the previous one."""
        life = self.scored.life()
        measurements, last = [], None
        for test, (hours, window) in enumerate(zip(life.hours, life.windows, strict=True)):
            estimate = estimate_of(self.scored.case(life, test), window, calibration, last)
            if estimate is not None and estimate.valid:
                last = np.array(estimate.faults)
                measurements.append(Measurement.of(estimate, float(hours)))
        return measurements


def measure(pool: Workers, lives: int, constant: int, whole: int, real: int) -> Figures:
    """Score lives of each kind."""
    healthy = cases.healthy(HEALTHY_WINDOWS, "calibration") if real else []
    windows = pool.map("healthy windows", noisy_window, healthy)
    calibration = calibrate_model(windows, ACTUATOR) if real else None
    in_the_loop = [Job(scored, calibration) for scored in lives_of("real", real)]
    by_source = {
        "drawn": pool.map("lives", Job.scores, [Job(life) for life in lives_of("growing", lives)]),
        "real": pool.map("lives in the loop", Job.scores, in_the_loop),
    }
    by_message = pool.map("with requirements", score_whole, lives_of("growing", whole))
    constant_reports = pool.map("constant lives", reports, lives_of("constant", constant))
    return {
        "seed": SEED,
        **{
            case: {name: by_kind([score[name] for score in scores]) for name in scores[0]}
            for case, scores in by_source.items()
            if scores
        },
        # A message has quantiles only.
        "whole": {
            name: {key: summary([entry[name] for entry in by_message])[key] for key in BY_MESSAGE}
            for name in SETTINGS
            if by_message
        },
        "constant": {
            name: {
                "lives": len(constant_reports),
                "reported": sum(
                    entry.has_life or (entry.failing and entry.meets) for entry in case_reports
                ),
                "rightly_failing": sum(entry.failing and not entry.meets for entry in case_reports),
                "failing": sum(not entry.meets for entry in case_reports),
            }
            for name in SETTINGS
            for case_reports in [[entry[name] for entry in constant_reports]]
        },
    }


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    for case, name in product(("drawn", "real"), TARGETS):
        if case in figures:
            yield from _accuracy_rows(figures[case], case, name)
    for name, entry in figures["whole"].items():
        what = f"{entry['lives']} lives, by limit or requirement, {name}: accuracy, coverage"
        yield untargeted(what, f"{entry['cra']:.3f}, {entry['coverage']:.3f}")
    for name, entry in figures["constant"].items():
        what = f"{entry['lives']} lives of constant faults, {name}: with a predicted life"
        yield none_of(what, entry["reported"])
        what = "  with a requirement that fails from the first test on: reported"
        yield untargeted(what, f"{entry['rightly_failing']} of {entry['failing']}")
    spent = {f"by fault limits, {name}": figures["drawn"][name]["all"] for name in TARGETS}
    if figures["whole"]:
        spent["with requirements and health, law unknown"] = figures["whole"]["law unknown"]
    for what, entry in spent.items():
        milliseconds = 1e3 * entry["seconds"]
        what = f"update {what}, processor time, median [ms]"
        yield at_most(what, milliseconds, 1e3 * LONGEST_S, f"{milliseconds:.1f}")


def _accuracy_rows(by_method: Figures, case: str, name: str) -> Iterator[Row]:
    least, rate = TARGETS[name]
    lives = f"{by_method[name]['all']['lives']} lives, {_TITLES[case]}, {name}"
    accuracy = "cumulative relative accuracy"
    passing = "alpha-lambda (20 %) at 0.75, pass rate"
    for what, part, key, low, high in (
        (f"{lives}: {accuracy}", "all", "cra", least, 1.0),
        (f"  {passing}", "all", "alpha_lambda_0.75", rate, 1.0),
        (f"  {WITHOUT_DIFFUSION}: {accuracy}", WITHOUT_DIFFUSION, "cra", least, 1.0),
        (f"    {passing}", WITHOUT_DIFFUSION, "alpha_lambda_0.75", rate, 1.0),
        ("  coverage of the 90 % interval", "all", "coverage", *COVERAGE),
    ):
        value = by_method[name][part][key]
        beside = f"{by_method['oracle'][part][key]:.3f}"
        if part == "all":
            yield Row(
                what, f"{low:.2f} to {high:.2f}", f"{value:.3f}", low <= value <= high, beside
            )
        else:
            yield Row(what, "", f"{value:.3f}", None, beside)


def tables(figures: Figures) -> Iterator[Table | str]:
    """Yield the tables to print below the targets."""
    shares = ("coverage", "horizon_share", "convergence_share", "first_share")
    for case, title in _TITLES.items():
        by_method = figures.get(case, {})
        yield grid(
            title,
            (
                *("fault", "lives", "predictor", "accuracy", "on event\ntime", "none\n%"),
                *(f"a-l %\n{at:g}" for at in LAMBDAS),
                *("covers\n%", "horizon\n%", "converg.\n%", "first\n%", "ms"),
            ),
            (
                (
                    *(kind.replace("_", " "), entry["lives"], name, entry["cra"]),
                    *(entry["cra_event_time"], percent(entry["unknown_share"], 1)),
                    *(percent(entry[f"alpha_lambda_{at:g}"]) for at in LAMBDAS),
                    *(percent(entry[share]) for share in shares),
                    f"{1e3 * entry['seconds']:.2f}",
                )
                for kind in next(iter(by_method.values()), ())
                for name, by_kind_of_fault in by_method.items()
                for entry in [by_kind_of_fault[kind]]
            ),
            digits=3,
        )
    yield (
        "accuracy: mean over lives and the tests in their second half of 1 - |r* - r| / r*, r the "
        "median of the remaining life and r* the truth; no prediction counts 0. On event time: by "
        "1 - |r* - r| / EoL. a-l: lives in which at least half of the probability is within 20 % "
        "of r* at that share of the time from the first prediction to the end. horizon, first: "
        "medians, of the whole life; convergence: of the time from first prediction to end.\n"
        "The oracle knows faults, laws and rates exactly: what it misses is due to the noise of "
        "the growth to come and to no tracker.\n"
    )


main = command(
    measure,
    "prognosis",
    rows,
    tables,
    width=185,
    beside=BESIDE,
    lives=300,
    constant=100,
    whole=50,
    real=20,
)

if __name__ == "__main__":
    main()
