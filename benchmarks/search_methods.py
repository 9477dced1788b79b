"""Our population methods and those of others, run on a standard function until its target.

Needs the virtual environment that tools/peers.sh makes. All start from the same random points;
ours take the first of them as the start and draw the others themselves.
"""

import contextlib
import logging
import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
import pygad  # pyright: ignore[reportMissingImports] - only in .venv-peers, like the next
import pygmo  # pyright: ignore[reportMissingImports]
from numpy.typing import NDArray
from pymoo.algorithms.soo.nonconvex.de import DE  # pyright: ignore[reportMissingImports]
from pymoo.algorithms.soo.nonconvex.ga import GA  # pyright: ignore[reportMissingImports]
from pymoo.algorithms.soo.nonconvex.pso import PSO  # pyright: ignore[reportMissingImports]
from pymoo.core.problem import Problem  # pyright: ignore[reportMissingImports]
from pymoo.core.termination import NoTermination  # pyright: ignore[reportMissingImports]
from pymoo.optimize import minimize  # pyright: ignore[reportMissingImports]
from scipy.optimize import differential_evolution  # pyright: ignore[reportMissingImports]
from standard_functions import D, StandardFunction

from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import Termination, minimise
from ema_monitor.optimizers.interface import Hints

POPULATION: Final = 50
BUDGET: Final = 20_000
GENERATIONS: Final = BUDGET // POPULATION

# Those of the thesis, for all differential evolutions.
F: Final = 0.9
CR: Final = 0.95


class SearchOver(Exception):
    """The target is reached, or the next batch would pass the budget."""


class Search:
    """A function that counts and ends the search that asks it."""

    def __init__(self, function: StandardFunction, seed: int) -> None:
        self._function = function
        self.seed = seed
        self.first_points = np.random.default_rng(seed).random((POPULATION, D))
        self.evaluations = 0
        self.found_after = math.inf

    def costs(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Cost of points, ``(m, d)``; the first at the target ends the search.

        Raises
        ------
        SearchOver
            Then, and when the budget does not allow these points.
        """
        if self.evaluations + len(points) > BUDGET:
            raise SearchOver
        costs = self._function.values(points)
        there = np.flatnonzero(costs <= self._function.target)
        if len(there):
            self.found_after = float(self.evaluations + there[0] + 1)
            raise SearchOver
        self.evaluations += len(points)
        return costs


Run = Callable[[Search], object]


class Peer(NamedTuple):
    """A method of another package."""

    run: Run
    same_rules: bool
    """Whether it has the rules and settings of ours, so that it must need as many evaluations."""


def evaluations_to_target(run: Run, function: StandardFunction, seed: int) -> float:
    """Run a method; return its evaluations up to the first at the target, inf without any."""
    search = Search(function, seed)
    with contextlib.suppress(SearchOver):
        run(search)
    return search.found_after


def ours(algorithm: str) -> Run:
    """Our optimizer of this name, in our driver."""

    def run(search: Search) -> None:
        optimizer = ALGORITHMS[algorithm](
            search.first_points[0], np.random.default_rng(search.seed), Hints(budget=BUDGET)
        )
        never = Termination(budget=BUDGET, stall_generations=BUDGET)
        for _ in minimise(lambda points: np.sqrt(search.costs(points))[:, None], optimizer, never):
            pass

    return run


def scipy_evolution(search: Search) -> object:
    """scipy's best1bin, a generation at a time."""
    return differential_evolution(
        lambda columns: search.costs(np.atleast_2d(columns.T)),
        [(0.0, 1.0)] * D,
        strategy="best1bin",
        mutation=F,
        recombination=CR,
        init=search.first_points,  # pyright: ignore[reportArgumentType] - an array is documented
        maxiter=GENERATIONS,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=np.random.default_rng(search.seed),
    )


class _BoxProblem(Problem):
    """The function as pymoo wants it."""

    def __init__(self, search: Search) -> None:
        super().__init__(n_var=D, n_obj=1, xl=0.0, xu=1.0)
        self._search = search

    def _evaluate(self, x: NDArray[np.float64], out: dict[str, Any], *_: Any, **__: Any) -> None:
        out["F"] = self._search.costs(x)[:, None]


def pymoo(algorithm: type, **settings: Any) -> Run:
    """Run an algorithm of pymoo."""

    def run(search: Search) -> object:
        return minimize(
            _BoxProblem(search),
            algorithm(pop_size=POPULATION, sampling=search.first_points, **settings),
            NoTermination(),
            seed=search.seed,
        )

    return run


class _PointProblem:
    """The function as pygmo wants it."""

    def __init__(self, search: Search) -> None:
        self._search = search

    def __deepcopy__(self, memo: object) -> "_PointProblem":
        # pygmo copies its problems; the count must stay one.
        return self

    def fitness(self, x: NDArray[np.float64]) -> list[float]:
        return [float(self._search.costs(x[None])[0])]

    def get_bounds(self) -> tuple[list[float], list[float]]:
        return [0.0] * D, [1.0] * D


def pagmo(algorithm: Callable[..., Any], **settings: Any) -> Run:
    """Run an algorithm of pygmo for all generations that the budget allows."""

    def run(search: Search) -> object:
        population = pygmo.population(pygmo.problem(_PointProblem(search)))
        for point in search.first_points:
            population.push_back(point)
        made = algorithm(gen=GENERATIONS - 1, seed=search.seed, **settings)
        return pygmo.algorithm(made).evolve(population)

    return run


_SILENT: Final = logging.getLogger(f"{__name__}.pygad")
"""For pygad, which logs every exception that passes through it, the end of a search among them."""
_SILENT.disabled = True


def pygad_genetic(search: Search) -> object:
    """pygad's genetic algorithm, which mutates by up to an eighth of its initial range."""

    def fitness(_: Any, points: NDArray[np.float64], __: Any) -> NDArray[np.float64]:
        # It does not keep to a box by itself; a clipped point is what it would have evaluated.
        return -search.costs(np.clip(np.atleast_2d(points), 0.0, 1.0))

    return pygad.GA(
        num_generations=GENERATIONS,
        num_parents_mating=POPULATION // 2,
        fitness_func=fitness,
        fitness_batch_size=POPULATION,
        initial_population=search.first_points,
        random_mutation_min_val=-0.125,
        random_mutation_max_val=0.125,
        mutation_num_genes=1,
        random_seed=search.seed,
        suppress_warnings=True,
        logger=_SILENT,
    ).run()


FAMILIES: Final[dict[str, dict[str, Peer]]] = {
    "ga": {
        "pymoo GA": Peer(pymoo(GA), same_rules=False),
        "pygad GA": Peer(pygad_genetic, same_rules=False),
        "pygmo sga": Peer(pagmo(pygmo.sga), same_rules=False),
    },
    "pso": {
        "pymoo PSO": Peer(pymoo(PSO), same_rules=False),
        "pygmo pso": Peer(pagmo(pygmo.pso), same_rules=False),
        "pygmo pso_gen": Peer(pagmo(pygmo.pso_gen), same_rules=False),
    },
    "de": {
        "scipy best1bin": Peer(scipy_evolution, same_rules=True),
        # Without the polynomial mutation that pymoo adds to every tenth trial.
        "pymoo DE": Peer(pymoo(DE, variant="DE/best/1/bin", F=F, CR=CR, prob_mut=0.0), True),
        "pygmo de": Peer(pagmo(pygmo.de, variant=6, F=F, CR=CR, ftol=0.0, xtol=0.0), True),
    },
    "gwo": {
        "pygmo gwo": Peer(pagmo(pygmo.gwo), same_rules=True),
    },
}
"""Other packages' methods beside ours, by the name of ours."""
