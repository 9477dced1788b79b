"""Our population methods beside independent implementations, on standard functions.

    tools/peers.sh python tests/benchmarks/optimizer_peers.py [--seeds N] [--functions A,B]
        [--json FILE]

Eight dimensions, populations of 50, 20,000 evaluations. Counted are the evaluations up to the
first at the target; a run without one counts as infinitely late in the median. A cell is this
median and the share of the runs that got there.

Comparable is what gets there at most 0.25 less often (with 20 seeds, one and a half standard
deviations of the difference of two shares of a half), and needs at most 1.5 times the evaluations
where both medians are finite; grey wolves reach some targets too seldom to have one. Peers with
the same rules and settings are judged one by one. Those with rules of their own are judged by the
median of their shares alone, for information: no peer follows Matlab's genetic algorithm or
particle swarm. Every miss is printed.

Prints tables, writes JSON and fails unless ours is comparable to each peer of the same rules.
"""

import json
import math
import statistics
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import click
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table
from search_methods import BUDGET, FAMILIES, POPULATION, evaluations_to_target, ours
from standard_functions import FUNCTIONS, D

SHARE_BAND: Final = 0.25
"""How much less often than a peer ours may reach the target."""
RATIO_BAND: Final = 1.5
"""How many times the evaluations of a peer ours may need."""

RULES: Final = {
    "ga": "pymoo: simulated binary crossover, polynomial mutation, parents and children compete "
    "to survive; pygad: steady-state selection, one gene mutated by up to 1/8; pygmo: exponential "
    "crossover, polynomial mutation of 2 %",
    "pso": "pymoo: adaptive coefficients, leader of the whole swarm, best particle perturbed; "
    "pygmo: constriction, neighbours in a ring",
    "de": "all: best/1/bin, F 0.9, CR 0.95, whole generations; a component outside is put between "
    "the best individual and the wall by ours and pymoo, drawn anew by scipy and pygmo, which "
    "takes longer on Rosenbrock",
    "gwo": "pygmo: Mirjalili 2014, as ours",
}
"""What the peers of a family do, printed under its table."""


@dataclass(frozen=True)
class Figures:
    """How a method fared on a function."""

    median_evaluations: float | None
    """Up to the target; None where half of the runs or more did not get there."""
    share: float
    """Of the runs that got there."""

    @classmethod
    def of(cls, evaluations: list[float]) -> "Figures":
        # Of an even number the upper one: no mean with infinity.
        middle = statistics.median_high(evaluations)
        share = statistics.fmean(map(math.isfinite, evaluations))
        return cls(middle if math.isfinite(middle) else None, share)

    def __str__(self) -> str:
        median = "-" if self.median_evaluations is None else f"{self.median_evaluations:.0f}"
        return f"{median} {self.share:4.0%}"


@dataclass(frozen=True)
class Comparison:
    """A family on a function."""

    family: str
    function: str
    ours: Figures
    peers: dict[str, Figures]

    def ratio(self, *peers: str) -> float | None:
        """Our median over the median of those of the peers; None where one is infinite."""
        medians = [self.peers[peer].median_evaluations or math.inf for peer in peers]
        theirs = statistics.median(medians)
        if self.ours.median_evaluations is None or not math.isfinite(theirs):
            return None
        return self.ours.median_evaluations / theirs

    def misses(self) -> list[str]:
        """What is not comparable to the peers of the same rules, in words."""
        found = []
        for name, figures in self.peers.items():
            if not FAMILIES[self.family][name].same_rules:
                continue
            if self.ours.share < figures.share - SHARE_BAND:
                found.append(f"share {self.ours.share:.0%}, {name} {figures.share:.0%}")
            ratio = self.ratio(name)
            if ratio is not None and ratio > RATIO_BAND:
                found.append(f"{ratio:.2f} times the evaluations of {name}")
        return found

    def remarks(self) -> list[str]:
        """What falls short of the peers with rules of their own, in words."""
        others = [
            figures.share
            for name, figures in self.peers.items()
            if not FAMILIES[self.family][name].same_rules
        ]
        if others and self.ours.share < statistics.median(others) - SHARE_BAND:
            return [
                f"share {self.ours.share:.0%}, median of the peers {statistics.median(others):.0%}"
            ]
        return []


def compare(family: str, function: str, seeds: int) -> Comparison:
    """Run ours and the peers of a family on a function."""

    def figures(run: Any) -> Figures:
        target = FUNCTIONS[function]
        return Figures.of([evaluations_to_target(run, target, seed) for seed in range(seeds)])

    peers = {name: figures(peer.run) for name, peer in FAMILIES[family].items()}
    return Comparison(family, function, figures(ours(family)), peers)


def table_of(family: str, comparisons: list[Comparison]) -> Table:
    """Return the table of a family."""
    table = Table(box=box.SIMPLE_HEAD, title=f"{family}: evaluations to the target, share of runs")
    table.add_column("function", no_wrap=True)
    table.add_column("target", justify="right")
    for name in ("ours", *FAMILIES[family], "ours / median\nof peers"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("comparable")
    for c in comparisons:
        ratio = c.ratio(*c.peers)
        notes = c.misses() or c.remarks()
        table.add_row(
            c.function,
            f"{FUNCTIONS[c.function].target:g}",
            str(c.ours),
            *map(str, c.peers.values()),
            "-" if ratio is None else f"{ratio:.2f}",
            "; ".join(notes) or "yes",
        )
    return table


def functions_named(_: click.Context, __: click.Parameter, names: str) -> list[str]:
    """Split and check the names of functions."""
    chosen = names.split(",")
    for name in chosen:
        if name not in FUNCTIONS:
            raise click.BadParameter(f"{name!r}: expected some of {', '.join(FUNCTIONS)}")
    return chosen


@click.command()
@click.option("--seeds", type=click.IntRange(2), default=20, show_default=True)
@click.option(
    "--functions",
    default=",".join(FUNCTIONS),
    show_default=True,
    callback=functions_named,
    help="Names with commas between.",
)
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(seeds: int, functions: list[str], output: Path | None) -> None:
    """Print a table for each family, write the JSON file and judge."""
    console = Console(width=140)
    pairs = [(family, function) for family in FAMILIES for function in functions]
    progress = track(pairs, "families and functions", console=Console(stderr=True))
    comparisons = [compare(family, function, seeds) for family, function in progress]
    for family in FAMILIES:
        console.print(table_of(family, [c for c in comparisons if c.family == family]))
        console.print(f"{RULES[family]}\n", highlight=False)
    missed = [c for c in comparisons if c.misses()]
    for c in missed:
        console.print(f"not comparable: {c.family} on {c.function}: {'; '.join(c.misses())}")
    if output:
        results = {
            "dimensions": D,
            "population": POPULATION,
            "budget": BUDGET,
            "seeds": seeds,
            "targets": {function: FUNCTIONS[function].target for function in functions},
            "comparisons": [
                asdict(c)
                | {"ratio": c.ratio(*c.peers), "misses": c.misses(), "remarks": c.remarks()}
                for c in comparisons
            ],
        }
        output.write_text(json.dumps(results, indent=2))
    raise SystemExit(1 if missed else 0)


if __name__ == "__main__":
    main()
