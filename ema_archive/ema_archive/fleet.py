# SPDX-License-Identifier: Apache-2.0
"""Summary of a fleet for page and report, from the tables of an archive."""

import math
import re
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from statistics import NormalDist
from threading import Timer
from typing import Any, Final, NamedTuple

import duckdb
import numpy as np

from ema_archive.query import opened
from ema_archive.store import FILE

MOST_ROWS: Final = 1000
"""Largest number of units, and of models, in a summary."""

_MOST_STEPS: Final = 500
_CONFIDENCE: Final = 0.9
_Z: Final = NormalDist().inv_cdf(0.5 + _CONFIDENCE / 2.0)

Row = dict[str, Any]


@dataclass(frozen=True)
class FleetSummary:
    """State of a fleet. Rows are mappings with plain values; unknown values are None."""

    bags: Row
    """Numbers of all bags, and of unreadable, incomplete, temporarily unreadable and unprocessed
    bags; addresses of up to three unread bags."""
    levels: Row
    """Numbers of units in total and at each level, median health index, and time of the latest
    test."""
    worst: list[Row]
    """Units from the view ``worst_first``, worst first."""
    models: list[Row]
    """Number of units by model and level, with medians of health index, known remaining life [h]
    and service hours."""
    ages: list[Row]
    """Number of units by class of service hours."""
    survival: list[Row]
    """Survival curve as up to 500 ``SurvivalStep`` items."""
    lives: int
    """Number of observed lives."""
    failures: int
    """Number of lives that ended in ERROR."""
    longest_age: float
    """Longest observed age [h]."""
    calibrations: list[Row]
    """Number of units by age of the calibration at the latest test."""
    recent: list[Row]
    """Number of units tested in recent days."""
    months: list[Row]
    """Numbers of tested units, known units, windows and valid windows, for each month of the last
    three years."""


def fleet_summary(archive: Path, most: int = 20, limit_s: float = 60.0) -> FleetSummary:
    """Return the summary of a fleet.

    Parameters
    ----------
    archive
        Folder of the archive.
    most
        Number of units and models to list, up to ``MOST_ROWS``.
    limit_s
        Time limit of the query [s].

    Raises
    ------
    ValueError
        If there is no archive, ``most`` is out of range, a table is damaged, or the query takes
        longer than ``limit_s``.
    """
    if not 1 <= most <= MOST_ROWS:
        raise ValueError(f"most = {most}: expected 1 to {MOST_ROWS}")
    text = files("ema_archive").joinpath("fleet_queries.sql").read_text(encoding="utf-8")
    _, *parts = re.split(r"^-- name: (\w+)$", text, flags=re.MULTILINE)
    end_s, summary = time.monotonic() + limit_s, {}
    with opened(archive) as db:
        for name, query in zip(parts[::2], parts[1::2], strict=True):
            timer = Timer(max(end_s - time.monotonic(), 0.0), db.interrupt)
            timer.start()
            try:
                answer = db.execute(query, {"most": most} if "$most" in query else None)
                names = [column[0] for column in answer.description or []]
                rows = answer.fetchall()
                summary[name] = [_plain(dict(zip(names, row, strict=True))) for row in rows]
            except duckdb.InterruptException:
                end_s = 0.0
            finally:
                timer.cancel()
            if time.monotonic() > end_s:
                raise ValueError(f"the summary takes more than {limit_s:g} s")
    [summary["levels"]], [summary["bags"]] = summary["levels"], summary["bags"]
    lives = summary.pop("lives")
    columns = ([life[name] for life in lives] for name in ("from_age", "to_age", "has_failed"))
    steps = [_plain(step._asdict()) for step in survival(*columns)]
    # Thin out the steps to the number that a figure can show, and keep the last step.
    every = max(1, math.ceil(len(steps) / _MOST_STEPS))
    summary["months"].reverse()
    return FleetSummary(
        **summary,
        survival=steps[::-every][::-1],
        lives=len(lives),
        failures=sum(life["has_failed"] for life in lives),
        longest_age=max((life["to_age"] for life in lives), default=0.0),
    )


def state_of_archive(archive: Path) -> tuple[int, ...]:
    """Return a token that changes when the content of an archive, and so its summary, may change.

    Raises
    ------
    OSError
        If there is no archive.
    """
    status = [(archive / FILE).stat()]
    with suppress(FileNotFoundError):
        # Changes left by a killed run.
        status.append((archive / f"{FILE}.wal").stat())
    return tuple(value for stat in status for value in (stat.st_mtime_ns, stat.st_ino))


def _plain(row: Row) -> Row:
    """Return a row as JSON values: times as strings, and None for NaN and infinity."""

    def plain(value: Any) -> Any:
        if isinstance(value, datetime):
            return f"{value.isoformat(timespec='seconds')}Z"
        if isinstance(value, dict):
            return _plain(value)
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {name: plain(value) for name, value in row.items()}


class SurvivalStep(NamedTuple):
    """Step of a survival curve: share of units [-] that survive an age [h], and its 90 % interval.

    The share is constant until the next step. ``at_risk`` units were observed just before the age,
    and ``failed`` of them failed.
    """

    age: float
    at_risk: int
    failed: int
    share: float
    lower: float
    upper: float


def survival(
    from_age: Sequence[float], to_age: Sequence[float], has_failed: Sequence[bool]
) -> list[SurvivalStep]:
    """Return the product-limit (Kaplan-Meier) estimate of the survival curve.

    Units count from the age at which they were first observed (left truncation), because earlier
    failures could not be observed and would bias the share. The share is conditional on survival to
    the first failure at which the number of units at risk is at least the square root of the number
    of all units: earlier, one failure among few units would dominate the share (Lai and Ying 1991).
    The interval follows from Greenwood's variance of log(-log share) and stays within 0 and 1. If
    no unit is left, the share is 0 and its interval is unknown.

    Units with equal first and last age [h] have no observation time and are ignored.
    """
    begin, end = np.asarray(from_age, dtype=float), np.asarray(to_age, dtype=float)
    is_failure = np.asarray(has_failed, dtype=bool) & (end > begin)
    ages, failures = np.unique(end[is_failure], return_counts=True)
    # Units observed before the age, minus units that left before it.
    watched = np.searchsorted(np.sort(begin), ages) - np.searchsorted(np.sort(end), ages)
    enough = watched >= math.sqrt(np.sum(end > begin))
    first = int(np.argmax(enough)) if enough.any() else ages.size
    ages, watched, failures = ages[first:], watched[first:], failures[first:]
    steps, share, variance = [], 1.0, 0.0
    for age, at_risk, failed in zip(
        ages.tolist(), watched.tolist(), failures.tolist(), strict=True
    ):
        share *= 1.0 - failed / at_risk
        lower = upper = math.nan
        if share > 0.0:
            variance += failed / (at_risk * (at_risk - failed))
            spread = _Z * math.sqrt(variance) / abs(math.log(share))
            lower, upper = share ** math.exp(spread), share ** math.exp(-spread)
        steps.append(SurvivalStep(age, at_risk, failed, share, lower, upper))
    return steps
