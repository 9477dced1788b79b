"""Remaining life of units whose faults drive each other, with and without the filters for it.

    python benchmarks/driven_wear.py [--lives N] [--held-out] [--json FILE]

Two faults of a unit grow; the rate of one, or of both, depends on the level of the other. No law is
known; the remaining life is that of the unit. Levels y are in shares of the limit. The laws of
``HELD_OUT`` are of other forms than the filters', and kept out of development. In lives with
unrelated faults nothing drives anything: they show what it costs to think of drivers.

Prints a table; writes JSON.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
from foreign_lives import CORRELATION
from numpy.typing import NDArray
from prognosis_estimates import error_model
from prognosis_lives import LIMITS
from prognosis_predictors import tracked
from prognosis_scores import LifeScore, summary
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table
from trials import workers

from ema_core.faults import ECCENTRICITY_PHASE, FAULT_NAMES, HIGHEST, healthy_faults
from ema_monitor.prognosis.growth.settings import TrackerSettings

SEED: Final = 18_044
STEP_H: Final = 2.5
LONGEST_H: Final = 20_000.0
_NOISES: Final = (0.1, 0.4)
_MISSING: Final = 0.1

WITH, WITHOUT = "with drivers", "without"
Rates = Callable[[NDArray[np.float64]], tuple[float, float]]
"""Growth of both levels in life's own time, by the levels, in shares of the limits."""


@dataclass(frozen=True)
class Pair:
    """Two faults and how they grow.

    Attributes
    ----------
    names
        The driver, and what it drives.
    draw
        Returns the rates of one life.
    """

    names: tuple[str, str]
    draw: Callable[[np.random.Generator], Rates]


def _play_drives(rng: np.random.Generator) -> Rates:
    own, other, c = rng.uniform(0.6, 1.0), rng.uniform(0.0, 0.15), rng.uniform(1.0, 2.5)
    return lambda y: (own, other + c * y[0])


def _both_drive(rng: np.random.Generator) -> Rates:
    a, b = rng.uniform(0.05, 0.3, 2)
    c, d = rng.uniform(1.0, 3.0, 2)
    return lambda y: (a + c * y[1], b + d * y[0])


def _unrelated(rng: np.random.Generator) -> Rates:
    a, b = rng.uniform(0.4, 1.0, 2)
    bend, other = rng.uniform(0.0, 4.0, 2)
    return lambda y: (a * (1.0 + bend * y[0]), b * (1.0 + other * y[1]))


def _square(rng: np.random.Generator) -> Rates:
    a, b = rng.uniform(0.1, 0.3, 2)
    c, d = rng.uniform(2.0, 5.0, 2)
    return lambda y: (a + c * y[1] ** 2, b + d * y[0] ** 2)


def _beyond(rng: np.random.Generator) -> Rates:
    own, other = rng.uniform(0.6, 1.0), rng.uniform(0.05, 0.2)
    c, from_level = rng.uniform(2.0, 5.0), rng.uniform(0.2, 0.4)
    return lambda y: (own, other + c * max(float(y[0]) - from_level, 0.0))


DEVELOPMENT: Final[Mapping[str, Pair]] = {
    "play drives friction": Pair(("backlash", "friction"), _play_drives),
    "play and friction drive each other": Pair(("backlash", "friction"), _both_drive),
    "unrelated play and friction": Pair(("backlash", "friction"), _unrelated),
}
HELD_OUT: Final[Mapping[str, Pair]] = {
    "eccentricity and friction, by squares": Pair(("eccentricity", "friction"), _square),
    "friction drives play beyond a level": Pair(("friction", "backlash"), _beyond),
    "unrelated eccentricity and friction": Pair(("eccentricity", "friction"), _unrelated),
}


@dataclass(frozen=True)
class PairCase:
    """A life by its kind and number."""

    kind: str
    number: int

    def scores(self) -> dict[str, LifeScore]:
        """Return the scores of the tracker with and without drivers."""
        rng = np.random.default_rng([SEED, *self.kind.encode(), self.number])
        pair = {**DEVELOPMENT, **HELD_OUT}[self.kind]
        hours, shares = _grown(pair.draw(rng), rng)
        most = shares.max(axis=1)
        over = int(np.argmax(most >= 1.0))
        part = (1.0 - most[over - 1]) / (most[over] - most[over - 1])
        end = float(hours[over - 1] + part * (hours[over] - hours[over - 1]))
        tests = np.cumsum(rng.uniform(5.0, 20.0, int(end / 5.0) + 1))
        tests = tests[(tests < end) & (rng.random(tests.size) >= _MISSING)]
        vectors = np.tile(healthy_faults(), (tests.size, 1))
        vectors[:, ECCENTRICITY_PHASE] = rng.random()
        for name, share in zip(pair.names, shares.T, strict=True):
            column = FAULT_NAMES.index(name)
            vectors[:, column] += LIMITS[name] * np.interp(tests, hours, share)
        vectors = np.clip(vectors, 0.0, HIGHEST)
        measurements = error_model().draw_correlated(tests, vectors, CORRELATION, rng)
        return {
            name: LifeScore.of(self.kind, self.number, end, tracked(measurements, settings))
            for name, settings in (
                (WITH, TrackerSettings()),
                (WITHOUT, replace(TrackerSettings(), driven_probability=0.0)),
            )
        }


def _grown(rates: Rates, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return hours and levels of a life that ends after some 900 to 2,300 h, ``(n,)``, ``(n, 2)``.

    Both faults share the noise of their growth, as they share their load.
    """
    noise = rng.uniform(*_NOISES)
    sigma = np.sqrt(np.log1p(np.expm1(noise**2) * 10.0 / STEP_H))
    life = rng.uniform(900.0, 2300.0)
    scale, y = 1.0 / (life * _speed(rates)), np.zeros(2)
    levels = [y]
    while y.max() < 1.0 and len(levels) * STEP_H < LONGEST_H:
        factor = np.exp(sigma * rng.standard_normal() - 0.5 * sigma**2)
        y = y + factor * scale * STEP_H * np.array(rates(y))
        levels.append(y)
    if y.max() < 1.0:
        raise RuntimeError(f"no limit is reached within {LONGEST_H:g} h")
    return STEP_H * np.arange(len(levels), dtype=np.float64), np.array(levels)


def _speed(rates: Rates) -> float:
    """Return one over the time of the rates until a level is at its limit [-]."""
    y, time = np.zeros(2), 0.0
    while y.max() < 1.0:
        y = y + 1e-3 * np.array(rates(y))
        time += 1e-3
    return 1.0 / time


@click.command()
@click.option("--lives", default=20, show_default=True, type=click.IntRange(1), help="of each kind")
@click.option("--held-out", is_flag=True, help="the laws kept out of development; run once")
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(lives: int, held_out: bool, output: Path | None) -> None:
    """Print the table and write the JSON file."""
    kinds = HELD_OUT if held_out else DEVELOPMENT
    cases = [PairCase(kind, number) for kind in kinds for number in range(lives)]
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with (
        Progress(*columns, console=Console(stderr=True)) as progress,
        workers(progress) as pool,
    ):
        found = pool.map("lives", PairCase.scores, cases)
    rows = []
    for kind in kinds:
        mine = [one for case, one in zip(cases, found, strict=True) if case.kind == kind]
        gain = np.array([one[WITH].cra - one[WITHOUT].cra for one in mine])
        for name in (WITH, WITHOUT):
            figures = summary([one[name] for one in mine])
            rows.append(
                {
                    "lives": kind,
                    "tracker": name,
                    "accuracy": figures["cra"],
                    "coverage": figures["coverage"],
                    "beyond": figures["beyond_late"],
                    "gain": float(gain.mean()),
                    "its error": float(gain.std() / np.sqrt(max(gain.size - 1, 1))),
                    "update ms": 1e3 * figures["seconds"],
                }
            )
    table = Table(*rows[0], title=f"law unknown, {lives} lives of each kind")
    for row in rows:
        table.add_row(*(v if isinstance(v, str) else f"{v:.3f}" for v in row.values()))
    Console(width=120).print(table)
    if output:
        output.write_text(json.dumps({"seed": SEED, "held_out": held_out, "rows": rows}))


if __name__ == "__main__":
    main()
