"""Our population methods beside independent implementations, on standard functions.

    tools/peers.sh python benchmarks/optimizer_peers.py [--seeds N] [--functions A,B]
        [--json FILE]

Eight dimensions, populations of 50, 20,000 evaluations. Counted are the evaluations up to the
first at the target; a run without one counts as infinitely late in the median. A cell is this
median and the share of the runs that reached it.

Comparable is what reaches it at most 0.25 less often (with 20 seeds, one and a half standard
deviations of the difference of two shares of a half), and needs at most 1.5 times the evaluations
of each peer with the same rules and settings. No peer follows Matlab's genetic algorithm or
particle swarm: these are held to the median of the peers, with twice its evaluations allowed.
Where half of a peer's runs reach the target, half of ours must.

Prints tables, writes JSON and fails unless ours is comparable.
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
"""How many times the evaluations of a peer with the same rules ours may need."""
OTHER_RULES_RATIO_BAND: Final = 2.0
"""How many times the evaluations of the median of peers with rules of their own."""

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
    """Evaluations and successful runs of a method on a function."""

    median_evaluations: float | None
    """Up to the target; None where half of the runs or more did not reach it."""
    share: float
    """Of the runs that reached it."""

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
class FamilyComparison:
    """Our method of a family and its peers on one function."""

    family: str
    function: str
    ours: Figures
    peers: dict[str, Figures]

    def ratio(self, *peers: str) -> float:
        """Our median over the median of those of the peers; NaN where neither is finite."""
        medians = [self.peers[peer].median_evaluations or math.inf for peer in peers]
        theirs = statistics.median(medians)
        if not math.isfinite(theirs):
            return math.nan if self.ours.median_evaluations is None else 0.0
        return (self.ours.median_evaluations or math.inf) / theirs

    def misses(self) -> list[str]:
        """What is not comparable, in words."""
        same = [name for name in self.peers if FAMILIES[self.family][name].same_rules]
        others = [name for name in self.peers if name not in same]
        found = [miss for name in same for miss in self._miss(name, RATIO_BAND, name)]
        if others:
            found += self._miss("the median of the peers", OTHER_RULES_RATIO_BAND, *others)
        return found

    def _miss(self, what: str, band: float, *peers: str) -> list[str]:
        found = []
        share = statistics.median(self.peers[peer].share for peer in peers)
        if self.ours.share < share - SHARE_BAND:
            found.append(f"share {self.ours.share:.0%}, {what} {share:.0%}")
        if (ratio := self.ratio(*peers)) > band:
            found.append(f"{ratio:.2f} times the evaluations of {what}")
        return found


def compare(family: str, function: str, seeds: int) -> FamilyComparison:
    """Run ours and the peers of a family on a function."""

    def figures(run: Any) -> Figures:
        target = FUNCTIONS[function]
        return Figures.of([evaluations_to_target(run, target, seed) for seed in range(seeds)])

    peers = {name: figures(peer.run) for name, peer in FAMILIES[family].items()}
    return FamilyComparison(family, function, figures(ours(family)), peers)


def table_of(family: str, comparisons: list[FamilyComparison]) -> Table:
    """Return the table of a family."""
    table = Table(box=box.SIMPLE_HEAD, title=f"{family}: evaluations to the target, share of runs")
    table.add_column("function", no_wrap=True)
    table.add_column("target", justify="right")
    for name in ("ours", *FAMILIES[family], "ours / median\nof peers"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("comparable")
    for c in comparisons:
        ratio = c.ratio(*c.peers)
        table.add_row(
            c.function,
            f"{FUNCTIONS[c.function].target:g}",
            str(c.ours),
            *map(str, c.peers.values()),
            f"{ratio:.2f}" if 0.0 < ratio < math.inf else "-",
            "; ".join(c.misses()) or "yes",
        )
    return table


def _finite(ratio: float) -> float | None:
    return ratio if math.isfinite(ratio) else None


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
    """Print a table for each family, write the JSON file and fail unless ours is comparable."""
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
                asdict(c) | {"ratio": _finite(c.ratio(*c.peers)), "misses": c.misses()}
                for c in comparisons
            ],
        }
        output.write_text(json.dumps(results, indent=2))
    raise SystemExit(1 if missed else 0)


if __name__ == "__main__":
    main()
