# SPDX-License-Identifier: Apache-2.0
"""Jobs of the study: the thesis's runs, and a few runs with its printed stop rule."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final

from ema_study.cases import MULTIPLE
from ema_study.printed import GENERATIONS, POPULATION, printed_runs, printed_table
from ema_study.stop_rules import uncounted_populations

RUNS: Final = 10
"""Number of runs of each algorithm and fault in the thesis."""

VARIANTS: Final = {"de": "de_thesis", "gwo": "gwo_thesis"}
"""Variants that use the thesis's own code, including its errors, keyed by algorithm."""

KEY: Final = ("model", "table", "algorithm", "run", "rule")
"""Fields that identify a run within a study."""

_SETTINGS: Final = {9: {"F": 0.5, "CR": 0.9}, 10: {"F": 0.9, "CR": 0.95}}
_RULES: Final = {9: "all_generations", 10: "all_generations", 57: "unchanged"}


@dataclass(frozen=True)
class Job:
    """A run of the study, as input of ``ema_study.run.run_job``."""

    model: str
    """One of ``ema_study.models.MODELS``."""
    table: int
    """Number of its table in the thesis."""
    algorithm: str
    case: str
    """One of ``ema_study.cases.CASES``."""
    level: str
    """Level of the fault; for the multiple fault, the study: "fast_stop" or "stall_stop"."""
    run: int
    """Number of the run, from 1; in table 8, the number of the trial."""
    rule: str
    """Stop rule, as in ``ema_study.stop_rules.stop_rule``."""
    population: int = POPULATION
    max_generations: int = GENERATIONS
    settings: dict[str, float] = field(default_factory=dict)
    """Further settings of the optimizer."""

    @property
    def key(self) -> tuple[object, ...]:
        """Values of the fields in ``KEY``."""
        return tuple(getattr(self, name) for name in KEY)

    @property
    def seed(self) -> int:
        """Random seed, equal for all models and rules."""
        text = f"{self.table} {self.algorithm} {self.run}"
        return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4])

    @property
    def budget(self) -> int:
        """Largest number of evaluations, including the starting population."""
        return self.population * (self.max_generations + uncounted_populations(self.algorithm))


def plan(model: str, runs: int, *, with_trials: bool = True) -> list[Job]:
    """Return the jobs of the study with a model, beginning with the first run of every table.

    There are ``runs`` jobs for each algorithm and case. ``with_trials`` includes table 8.
    """
    jobs = [job for run in range(1, runs + 1) for job in _of_run(model, run)]
    # One run of each algorithm whose stop rule uses the printed threshold.
    jobs += [
        replace(job, rule="printed")
        for job in _of_run(model, 1)
        if job.rule == "floor_corrected" and job.table in (13, 14, 56)
    ]
    if with_trials:
        # The level of the faults is not printed: low is assumed. If no fault is printed, a short
        # circuit is assumed. Trial 1 is left out: its generations are not printed.
        trials = printed_table("trials").dropna(subset="generations").reset_index()
        for trial in trials.fillna({"fault": "short circuit"}).to_dict("records"):
            case, run = f"{trial['fault']} low", trial["trial"]
            sizes = trial["population"], int(trial["generations"])
            jobs.append(Job(model, 8, "ga", case, "low", run, "all_generations", *sizes))
    return jobs


def _of_run(model: str, run: int) -> Iterator[Job]:
    """Yield the jobs with run number ``run`` of tables 9 to 57."""
    columns = ["table", "algorithm", "fault", "level"]
    runs = printed_runs().drop_duplicates(columns[:2])[columns]
    for table, algorithm, fault, level in runs.to_numpy().tolist():
        case = MULTIPLE if fault == MULTIPLE else f"{fault.replace('_', ' ')} {level}"
        rule = _RULES.get(table, "floor_corrected")
        names = [algorithm]
        if table not in _SETTINGS and algorithm in VARIANTS:
            names.append(VARIANTS[algorithm])
        for name in names:
            settings = _SETTINGS.get(table, {})
            yield Job(model, table, name, case, level, run, rule, settings=settings)
