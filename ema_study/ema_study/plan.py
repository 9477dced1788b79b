"""The runs of the study: those of the thesis, and a few under its printed stop rule."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final

from ema_study.cases import CASES, LEVELS, MULTIPLE
from ema_study.stop_rules import uncounted_populations

POPULATION: Final = 50
GENERATIONS: Final = 200
RUNS: Final = 10
"""Settings of the thesis's algorithms: population, largest number of generations, runs of each."""

ALGORITHMS: Final = ("ga", "pso", "de", "gwo")
"""The thesis's four algorithms, in the order of its tables."""

VARIANTS: Final = {"de": "de_thesis", "gwo": "gwo_thesis"}
"""The thesis's own code, errors included, by the algorithm that it implements."""

KEY: Final = ("model", "table", "algorithm", "run", "rule")
"""Fields that identify a run within a study."""

# Each fault has a table for each algorithm, low before high, then a summary.
_FIRST_TABLE = 11
_TABLES_OF_A_FAULT = 2 * len(ALGORITHMS) + 1

_DE_TABLES = {9: {"F": 0.5, "CR": 0.9}, 10: {"F": 0.9, "CR": 0.95}}
_MULTIPLE_TABLES = {56: ("fast_stop", "floor_corrected"), 57: ("stall_stop", "unchanged")}

# Table 8: fault, population and generations of its trials of GA by their number. The level of the
# fault is not printed: low is assumed. Trial 1 is left out: its generations are not printed.
_GA_TRIALS = {
    2: ("short circuit low", 100, 11),
    3: ("short circuit low", 100, 43),
    4: ("short circuit low", 100, 68),
    5: ("short circuit low", 100, 46),
    6: ("short circuit low", 100, 46),
    7: ("short circuit low", 20, 200),
    8: ("backlash low", 20, 200),
    9: ("backlash low", 40, 200),
    10: ("backlash low", 20, 200),
    11: ("short circuit low", 20, 143),
    12: ("gain low", 50, 200),
}


@dataclass(frozen=True)
class Job:
    """A run to be made, of a table of the thesis.

    ``level`` is that of the fault; of the multiple one, the study: "fast_stop" or "stall_stop".
    ``run`` counts from 1; in table 8 it is the number of the trial. ``settings`` are further ones
    of the optimizer.
    """

    model: str
    table: int
    algorithm: str
    case: str
    level: str
    run: int
    rule: str
    population: int = POPULATION
    max_generations: int = GENERATIONS
    settings: dict[str, float] = field(default_factory=dict)

    @property
    def key(self) -> tuple[object, ...]:
        """Values of ``KEY``."""
        return tuple(getattr(self, name) for name in KEY)

    @property
    def seed(self) -> int:
        """Seed of its random numbers, the same for every model and rule."""
        text = f"{self.table} {self.algorithm} {self.run}"
        return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4])

    @property
    def budget(self) -> int:
        """Largest number of evaluations, those of the starting population included."""
        return self.population * (self.max_generations + uncounted_populations(self.algorithm))


def plan(model: str, runs: int, *, with_trials: bool = True) -> list[Job]:
    """Return the jobs of the study with a model, the first run of every table first.

    ``runs`` of each algorithm and case; ``with_trials`` includes table 8.
    """
    jobs = [job for run in range(1, runs + 1) for job in _of_run(model, run)]
    # One run of each algorithm that the printed threshold concerns.
    jobs += [
        replace(job, rule="printed")
        for job in _of_run(model, 1)
        if job.rule == "floor_corrected" and job.table in (13, 14, 56)
    ]
    if with_trials:
        jobs += [
            Job(model, 8, "ga", case, "low", number, "all_generations", population, generations)
            for number, (case, population, generations) in _GA_TRIALS.items()
        ]
    return jobs


def _of_run(model: str, run: int) -> Iterator[Job]:
    """Yield the jobs of tables 9 to 57 with a running number."""
    for table, settings in _DE_TABLES.items():
        yield Job(
            model, table, "de", "friction low", "low", run, "all_generations", settings=settings
        )
    single = (case for case in CASES.values() if case.fault != MULTIPLE)
    for number, case in enumerate(single):
        fault, level = divmod(number, len(LEVELS))
        first = _FIRST_TABLE + fault * _TABLES_OF_A_FAULT + level * len(ALGORITHMS)
        for table, algorithm in enumerate(ALGORITHMS, first):
            for name in _with_variant(algorithm):
                yield Job(model, table, name, case.name, case.level, run, "floor_corrected")
    for table, (level, rule) in _MULTIPLE_TABLES.items():
        for algorithm in ALGORITHMS:
            for name in _with_variant(algorithm):
                yield Job(model, table, name, MULTIPLE, level, run, rule)


def _with_variant(algorithm: str) -> tuple[str, ...]:
    return (algorithm, VARIANTS[algorithm]) if algorithm in VARIANTS else (algorithm,)
