# SPDX-License-Identifier: Apache-2.0
"""Tables of the thesis that the study can repeat: numbers, titles and runs."""

from collections.abc import Iterator
from functools import cache
from itertools import groupby
from typing import Final

from ema_study.cases import KIND_NAMES, MULTIPLE, SINGLE_FAULTS
from ema_study.plan import Job, plan
from ema_study.printed import (
    MULTIPLE_RELIABILITY,
    OVERVIEWS,
    PRECISION_STUDY,
    SINGLE_RELIABILITY,
    SPEED_STUDY,
    SUMMARIES,
    TRIALS,
    printed_runs,
)

NUMBERS: Final = tuple(range(TRIALS, MULTIPLE_RELIABILITY + 1))
"""Numbers of the tables in the thesis."""

_TITLES: Final = {
    TRIALS: "Calibration of GA",
    9: "Friction low, DE with F = 0.5 and CR = 0.9",
    10: "Friction low, DE with F = 0.9 and CR = 0.95",
    SPEED_STUDY: "Multiple fault, study of speed",
    PRECISION_STUDY: "Multiple fault, study of precision",
    58: "Mean error [%] by algorithm, level and fault",
    59: "Mean time [s] by algorithm, level and fault",
    SINGLE_RELIABILITY: "Reliability coefficient, single faults",
    MULTIPLE_RELIABILITY: "Reliability coefficient, multiple fault",
} | {
    number: f"{KIND_NAMES[fault].capitalize()}, mean over the algorithms"
    for number, fault in SUMMARIES.items()
}
_FIRST_OF_STATISTICS: Final = 11


@cache
def _run_tables() -> dict[int, tuple[str, str, str]]:
    """Return fault, level and first algorithm of the tables of runs, keyed by table number."""
    runs = printed_runs().drop_duplicates("table")[["table", "fault", "level", "algorithm"]]
    return {number: (fault, level, name) for number, fault, level, name in runs.to_numpy().tolist()}


def title_of(number: int) -> str:
    """Return the title of a table.

    Raises
    ------
    ValueError
        If the study cannot repeat the table.
    """
    if number in _TITLES:
        return _TITLES[number]
    fault, level, algorithm = _run_tables()[checked(number)]
    return f"{KIND_NAMES[fault].capitalize()} {level}, {algorithm.upper()}"


def checked(number: int) -> int:
    """Return ``number`` if the study can repeat this table.

    Raises
    ------
    ValueError
        If the study cannot repeat the table.
    """
    if number not in NUMBERS:
        raise ValueError(
            f"table {number}: expected {NUMBERS[0]} to {NUMBERS[-1]}, the tables with results of "
            "the thesis's algorithms"
        )
    return number


def table_titles() -> Iterator[tuple[str, str]]:
    """Yield numbers and title of each table; tables of the same fault and level are combined."""
    runs = _run_tables()

    def key(number: int) -> str:
        return title_of(number) if number in _TITLES else " ".join(runs[number][:2])

    for _, group in groupby(NUMBERS, key):
        first, *further = group
        title = title_of(first)
        if further:
            names = ", ".join(runs[number][2].upper() for number in further)
            yield f"{first} to {further[-1]}", f"{title}, {names}"
        else:
            yield str(first), title


def jobs_of(number: int, model: str, runs: int) -> list[Job]:
    """Return the jobs whose results are needed for a table.

    Parameters
    ----------
    number
        Number of the table.
    model
        Model of the monitor, one of ``ema_study.models.MODELS``.
    runs
        Number of runs of each algorithm and fault; table 8 has one run for each trial.

    Raises
    ------
    ValueError
        If the study cannot repeat the table.
    """
    needed = _tables_behind(checked(number))
    jobs = plan(model, runs, with_trials=number == TRIALS)
    return [job for job in jobs if job.table in needed and job.rule != "printed"]


def _tables_behind(number: int) -> set[int]:
    """Return the tables of runs from which a table is computed."""
    if number == MULTIPLE_RELIABILITY:
        return {SPEED_STUDY, PRECISION_STUDY}
    if number in SUMMARIES:
        faults: tuple[str, ...] = (SUMMARIES[number],)
    elif number in OVERVIEWS or number == SINGLE_RELIABILITY:
        faults = SINGLE_FAULTS
    else:
        return {number}
    return {
        table
        for table, (fault, _, _) in _run_tables().items()
        if table >= _FIRST_OF_STATISTICS and fault in faults and fault != MULTIPLE
    }
