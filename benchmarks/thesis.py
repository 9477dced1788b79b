"""What the thesis's four algorithms achieved, from its tables 11 to 57."""

from typing import Final, NamedTuple

from ema_study.cases import CASES, MULTIPLE
from ema_study.plan import ALGORITHMS
from ema_study.printed import printed_runs
from ema_study.sources import counted

_PRECISION_STUDY: Final = "stall_stop"

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


class Result(NamedTuple):
    """Mean error of an algorithm's ten runs [%] and their mean time [s]."""

    error_percent: float
    time_s: float


def results() -> dict[str, dict[str, Result]]:
    """Return the mean of each algorithm's runs, by case and algorithm.

    The multiple case is that of its study of precision.
    """
    runs = counted(printed_runs())
    found: dict[str, dict[str, Result]] = {}
    for name, case in CASES.items():
        level = _PRECISION_STUDY if name == MULTIPLE else case.level
        of_case = runs[(runs["fault"] == case.fault) & (runs["level"] == level)]
        means = of_case.groupby("algorithm")[list(Result._fields)].mean().to_dict("index")
        found[name] = {
            algorithm: Result(means[algorithm]["error_percent"], means[algorithm]["time_s"])
            for algorithm in ALGORITHMS
        }
    return found


def best_percent(by_algorithm: dict[str, Result]) -> float:
    """Return the error of the best algorithm of a case [%]."""
    return min(result.error_percent for result in by_algorithm.values())
