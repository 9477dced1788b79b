"""What the thesis's four algorithms achieved, from its tables 11 to 57."""

import csv
import statistics
from collections.abc import Iterable
from importlib import resources
from typing import Final, NamedTuple

RUNS: Final = resources.files("ema_study") / "thesis_runs.csv"
"""All 500 runs that the thesis prints."""

ALGORITHMS: Final = ("ga", "pso", "de", "gwo")

MEAN_LOW_PERCENT: Final = 0.71
"""Mean error of its best algorithm, particle swarm, over the five small faults [%]."""

MEAN_HIGH_PERCENT: Final = 1.76
"""The same over the five large faults [%]."""

FASTEST_TIME_S: Final = 97.0
"""Mean time of its fastest study, the multiple case by particle swarm [s]."""

LONGEST_TIME_S: Final = 2900.0
"""Mean time of its slowest study, the multiple case by grey wolves [s]."""

SWARM_TIME_S: Final = 2600.0
"""Time of 200 generations of 50 particles [s]."""

_FIRST_COMPARISON = 11
_PRECISION_STUDY = "stall_stop"


class Result(NamedTuple):
    """Mean error of an algorithm's ten runs [%] and their mean time [s]."""

    error_percent: float
    time_s: float


def results() -> dict[str, dict[str, Result]]:
    """Return the mean of each algorithm's runs, by case and algorithm.

    The multiple case is that of its study of precision.
    """
    runs: dict[str, dict[str, list[Result]]] = {}
    with RUNS.open() as file:
        for row in csv.DictReader(file):
            if int(row["table"]) < _FIRST_COMPARISON:
                continue
            if row["fault"] != "multiple":
                case = f"{row['fault'].replace('_', ' ')} {row['level']}"
            elif row["level"] == _PRECISION_STUDY:
                case = "multiple"
            else:
                continue
            run = Result(float(row["error_percent"]), float(row["time_s"]))
            runs.setdefault(case, {}).setdefault(row["algorithm"], []).append(run)
    return {
        case: {name: _mean(items) for name, items in by_algorithm.items()}
        for case, by_algorithm in runs.items()
    }


def best_percent(by_algorithm: dict[str, Result]) -> float:
    """Return the error of the best algorithm of a case [%]."""
    return min(result.error_percent for result in by_algorithm.values())


def _mean(runs: Iterable[Result]) -> Result:
    return Result(*(statistics.fmean(column) for column in zip(*runs, strict=True)))
