# SPDX-License-Identifier: Apache-2.0
"""Accuracy and coverage of the remaining life, on lives by the foreign laws of laws.py.

    python -m prognosis.foreign_laws [--lives N] [--constant N] [--laws SET] [--json FILE]

Lives (foreign_lives.py) follow the laws of a set in laws.py: "development" (six laws that the
tracker was developed with), "held out", "seen" or "unseen". The tracker does not know the law. It
is compared on the same estimates with straight lines through all and through the last 60 tests, a
quadratic, an exponential with bootstrap, and an oracle that knows the law, its parameters and its
state.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_least, at_most, grid, none_of

from prognosis.fits import FITS, oracle
from prognosis.foreign_lives import SEED, ForeignCase, constant_lives, lives_of
from prognosis.laws import SETS
from prognosis.predictors import law_unknown
from prognosis.scores import LifeScore, summary

TRACKER: Final = "law unknown"
METHODS: Final[Mapping[str, Any]] = {TRACKER: law_unknown, **FITS, "oracle": oracle}

LEAST_ACCURACY: Final = 0.72
COVERAGE: Final = (0.85, 0.95)
COVERAGE_OF_KIND: Final = (0.80, 0.97)
MOST_BEYOND: Final = 0.06
LONGEST_MS: Final = 20.0


def scored(case: ForeignCase) -> dict[str, LifeScore]:
    """Return the scores of a life by method."""
    life = case.life()
    measurements = case.measurements(life)
    left = life.end_hours - life.start_hours
    result = {}
    for name, predict in METHODS.items():
        since = predict(life, measurements).since(life.start_hours)
        result[name] = LifeScore.of(case.kind, left, since)
    return result


def reported(case: ForeignCase) -> int:
    """Return the number of tests of a constant life with a predicted remaining life."""
    life = case.life()
    made = METHODS[TRACKER](life, case.measurements(life))
    return int(np.sum(np.isfinite(made.median)))


def figures_of(cases: Sequence[ForeignCase], scores: Sequence[LifeScore]) -> Figures:
    """Return the scores of a method for all lives, by law and by variation."""
    pairs = list(zip(cases, scores, strict=True))
    parts = {"all": list(scores)}
    for name_of in (lambda case: case.kind, lambda case: f"with {case.variation}"):
        for case, score in pairs:
            parts.setdefault(name_of(case), []).append(score)
    return {part: summary(results) for part, results in parts.items()}


def measure(pool: Workers, lives: int, constant: int, *, laws: str) -> Figures:
    """Score lives by each law of a set, and count predictions for lives without growth.

    Run the sets "held out" and "unseen" only once, at the end.
    """
    cases = lives_of(SETS[laws], lives)
    scores = pool.map("lives by foreign laws", scored, cases)
    constant_reports = pool.map("constant lives", reported, constant_lives(constant))
    return {
        "seed": SEED,
        "laws": laws,
        "methods": {name: figures_of(cases, [entry[name] for entry in scores]) for name in METHODS},
        "constant": {"steady": constant_reports[::2], "with a wave": constant_reports[1::2]},
        "lives": [{name: asdict(score) for name, score in entry.items()} for entry in scores],
    }


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    methods = figures["methods"]
    ours = methods[TRACKER]
    every = ours["all"]
    kinds = [kind for kind in ours if kind != "all" and not kind.startswith("with ")]
    yield at_least("lives by foreign laws: accuracy", every["cra"], LEAST_ACCURACY)
    fits = [methods[name] for name in FITS]
    behind = [kind for kind in kinds if any(fit[kind]["cra"] >= ours[kind]["cra"] for fit in fits)]
    named = ", ".join(behind) or "none"
    yield none_of("  kinds not above each simple fit", len(behind), named)
    low, high = COVERAGE
    covered = every["coverage"]
    what = "  coverage of the 90 % interval"
    yield Row(what, f"{low} to {high}", f"{covered:.3f}", low <= covered <= high)
    low, high = COVERAGE_OF_KIND
    outside = [kind for kind in kinds if not low <= ours[kind]["coverage"] <= high]
    named = ", ".join(outside) or "none"
    yield none_of(f"  kinds not covered {low} to {high}", len(outside), named)
    beyond = every["beyond_late"]
    what = "  5 % quantile beyond the truth, second half"
    yield at_most(what, beyond, MOST_BEYOND, f"{beyond:.3f}")
    yield at_most("  update [ms]", 1e3 * every["seconds"], LONGEST_MS)
    for name, constant_reports in figures["constant"].items():
        count = sum(tests > 0 for tests in constant_reports)
        what = f"  constant lives, {name}: with a predicted life"
        yield none_of(what, count, f"{count} of {len(constant_reports)}")


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print below the targets."""
    methods = figures["methods"]
    yield grid(
        f"accuracy over the second half of life, {TRACKER}",
        ("lives", *methods),
        (
            (kind, *(by_kind[kind]["cra"] for by_kind in methods.values()))
            for kind in methods[TRACKER]
        ),
        digits=3,
    )
    keys = ("alpha_lambda_0.75", "coverage", "beyond_late")
    yield grid(
        "alpha-lambda at 0.75 / coverage / 5 % beyond the truth",
        ("lives", *methods),
        (
            (
                kind,
                *(
                    " / ".join(f"{by_kind[kind][key]:.2f}" for key in keys)
                    for by_kind in methods.values()
                ),
            )
            for kind in methods[TRACKER]
        ),
    )


main = command(
    measure,
    "lives by foreign laws",
    rows,
    tables,
    width=185,
    lives=30,
    constant=300,
    laws="development",
)

if __name__ == "__main__":
    main()
