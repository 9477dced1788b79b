"""Accuracy and honesty of the remaining life over lives by laws that the tracker does not have.

    ../tools/peers.sh python -m prognosis.foreign_laws [--lives N] [--constant N] [--held-out]
        [--no-peers] [--json FILE]

Lives (foreign_lives.py) are by six laws that the tracker was developed with, or by six others with
--held-out. No law is known. On the same estimates: straight lines through all and through the last
60 tests, a quadratic, an exponential with bootstrap, a Gaussian process, progpy's particle filter
with the law and rate of the type, and an oracle that knows the law, its figures and the state.
Prints tables and writes JSON.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from trials import command, workers

from prognosis.fits import FITS, SIMPLE_FITS, oracle
from prognosis.foreign_lives import SEED, ForeignCase, constant_lives, lives_of
from prognosis.laws import DEVELOPMENT, HELD_OUT
from prognosis.predictors import law_unknown
from prognosis.scores import LifeScore, summary

try:
    from prognosis.particle_filter import particle_filter
except ImportError:
    particle_filter = None

TRACKER: Final = "law unknown"
METHODS: Final[Mapping[str, Any]] = {
    TRACKER: law_unknown,
    **FITS,
    **({"progpy": particle_filter} if particle_filter else {}),
    "oracle": oracle,
}

LEAST_ACCURACY: Final = 0.72
COVERAGE: Final = (0.85, 0.95)
COVERAGE_OF_KIND: Final = (0.80, 0.97)
MOST_BEYOND: Final = 0.06


def scored(methods: Sequence[str], case: ForeignCase) -> dict[str, LifeScore]:
    """Score a life by some methods."""
    life = case.life()
    measurements = case.measurements(life)
    left = life.end_hours - life.start_hours
    told = [one for one in measurements if one.hours >= life.start_hours]
    result = {}
    for name in methods:
        # progpy's filter knows of no repair: it begins with it.
        made = METHODS[name](life, told if name == "progpy" else measurements)
        since = made.since(life.start_hours)
        result[name] = LifeScore.of(case.kind, case.number, left, since)
    return result


def reported(case: ForeignCase) -> int:
    """Return after how many tests of a constant life a remaining life is told."""
    life = case.life()
    made = METHODS[TRACKER](life, case.measurements(life))
    return int(np.sum(np.isfinite(made.median)))


def figures_of(
    cases: Sequence[ForeignCase], scores: Sequence[Mapping[str, LifeScore]]
) -> dict[str, Any]:
    """Return the figures of each method: of all lives, by law and by variation."""
    result: dict[str, Any] = {}
    for name in scores[0]:
        of_it = list(zip(cases, [one[name] for one in scores], strict=True))
        parts = {"all": [score for _, score in of_it]}
        for case, score in of_it:
            parts.setdefault(case.kind, []).append(score)
        for case, score in of_it:
            parts.setdefault(f"with {case.variation}", []).append(score)
        result[name] = {part: summary(found) for part, found in parts.items()}
    return result


def show(console: Console, figures: Mapping[str, Any]) -> None:
    """Print the tables."""
    methods = figures["methods"]
    ours = methods[TRACKER]
    table = Table("lives", *methods, title=f"accuracy over the second half of life, {TRACKER}")
    for kind in ours:
        rows = [f"{of_it[kind]['cra']:.3f}" for of_it in methods.values()]
        table.add_row(kind, *rows)
    console.print(table)
    table = Table("lives", *methods, title="alpha-lambda at 0.75 / coverage / 5 % beyond the truth")
    for kind in ours:
        table.add_row(kind, *(_honesty(of_it[kind]) for of_it in methods.values()))
    console.print(table)
    judged = [kind for kind in ours if kind != "all" and not kind.startswith("with ")]
    fits = [methods[name] for name in SIMPLE_FITS if name in methods]
    behind = [kind for kind in judged if any(fit[kind]["cra"] >= ours[kind]["cra"] for fit in fits)]
    low, high = COVERAGE_OF_KIND
    uncovered = [kind for kind in judged if not low <= ours[kind]["coverage"] <= high]
    table = Table("what", "target", "measured")
    table.add_row("accuracy", f">= {LEAST_ACCURACY}", f"{ours['all']['cra']:.3f}")
    above = ", ".join(behind) or "none" if fits else "not run"
    table.add_row("kinds not above each simple fit", "none", above)
    table.add_row("coverage", f"{COVERAGE[0]} to {COVERAGE[1]}", f"{ours['all']['coverage']:.3f}")
    table.add_row(f"kinds not covered {low} to {high}", "none", ", ".join(uncovered) or "none")
    table.add_row(
        "5 % quantile beyond the truth, second half",
        f"<= {MOST_BEYOND}",
        f"{ours['all']['beyond_late']:.3f}",
    )
    table.add_row("update [ms]", "<= 20", f"{1e3 * ours['all']['seconds']:.1f}")
    for name, of_it in figures["constant"].items():
        table.add_row(f"constant lives, {name}: told a life", "0", f"{of_it[0]} of {of_it[1]}")
    console.print(table)


def _honesty(one: Mapping[str, Any]) -> str:
    return f"{one['alpha_lambda']['0.75']:.2f} / {one['coverage']:.2f} / {one['beyond_late']:.2f}"


def measure(
    progress: Progress, lives: int, constant: int, held_out: bool, no_peers: bool
) -> dict[str, Any]:
    """Score lives of each law, and constant lives.

    With --held-out the laws are those kept out of development, for one run; with --no-peers the
    tracker is scored alone.
    """
    cases = lives_of(HELD_OUT if held_out else DEVELOPMENT, lives)
    with workers(progress) as pool:
        by = partial(scored, [TRACKER] if no_peers else list(METHODS))
        scores = pool.map("lives by foreign laws", by, cases)
        told = pool.map("constant lives", reported, constant_lives(constant))
    return {
        "seed": SEED,
        "held_out": held_out,
        "methods": figures_of(cases, scores),
        "constant": {
            name: (sum(tests > 0 for tests in of_it), len(of_it))
            for name, of_it in (("steady", told[::2]), ("with a wave", told[1::2]))
        },
        "lives": [{name: asdict(score) for name, score in one.items()} for one in scores],
    }


main = command(measure, show, 185, lives=30, constant=300, held_out=False, no_peers=False)

if __name__ == "__main__":
    main()
