# SPDX-License-Identifier: Apache-2.0
"""Update of an archive: estimates from bags, then health and life of units."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Final, Generic, TypeVar

from ema_archive.bag_task import DAMAGED, FAILED, INCOMPLETE, BagResult, BagTask, diagnose_bag
from ema_archive.commits import commit_bags, commit_units
from ema_archive.manifest import Manifest
from ema_archive.mending import mend
from ema_archive.settings import estimation_software, prognosis_software
from ema_archive.sources import Listed, full_url, list_bags
from ema_archive.unit_task import UnitEntry, UnitResult, follow_unit
from ema_core.tasks import Outcome, WorkerLostError, Workers

_MOST_LISTED: Final = 20_000
_MOST_BATCHED: Final = 2000
_MOST_FOLLOWED: Final = 50
_BATCH_S: Final = 5.0
_OTHER_SOFTWARE: Final = (
    "the software of the worker differs from this command: install the same version everywhere"
)


Result = TypeVar("Result")

Follow = Callable[[str, int, int, int], None]
"""Progress callback with "bags" or "units", number done, total number, and number failed."""


@dataclass
class RunTally:
    """Counts of a run."""

    bags: int = 0
    """Number of processed bags."""
    damaged: int = 0
    """Number of unreadable bags."""
    incomplete: int = 0
    """Number of incomplete bags."""
    failed: int = 0
    """Number of temporarily unreadable bags."""
    units: int = 0
    """Number of units whose health and life were updated."""
    followed: int = 0
    """Number of windows processed for these units."""
    not_followed: dict[str, str] = field(default_factory=dict)
    """Units whose health and life could not be updated, with the reason."""
    mended: list[str] = field(default_factory=list)
    """Messages about repaired defects of the tables."""


class _Batch(Generic[Result]):
    """Batch of results, which is committed after a few seconds or when it is large."""

    def __init__(self, commit: Callable[[Sequence[Result]], None], most: int) -> None:
        self._commit, self._most = commit, most
        self._results: list[Result] = []
        self._began_s = time.monotonic()

    def add(self, result: Result) -> None:
        """Add a result; commit the batch if it is due."""
        self._results.append(result)
        is_late = time.monotonic() > self._began_s + _BATCH_S
        if is_late or len(self._results) >= self._most:
            self.commit()

    def commit(self) -> None:
        """Commit the batch. Results that could not be written are recomputed later."""
        results, self._results = self._results, []
        self._commit(results)
        self._began_s = time.monotonic()


def scan(
    manifest: Manifest, sources: Sequence[str], follow: Callable[[int], None] = lambda _: None
) -> int:
    """List and record the bags of an archive's sources and of new sources; return their number.

    Raises
    ------
    ValueError, OSError
        As in `list_bags`; entries already recorded remain.
    """
    every = list(dict.fromkeys([*manifest.sources, *(full_url(source) for source in sources)]))
    number, count = manifest.next_scan, 0
    listed: list[Listed] = []
    for source in every:
        for bags in list_bags(source, manifest.archive.resolve()):
            listed += bags
            count += len(bags)
            if len(listed) >= _MOST_LISTED:
                manifest.note(listed, number)
                listed = []
            follow(count)
    # Only after all listings have succeeded: bags of an unreachable store do not become missing.
    manifest.end_scan(number, every, listed)
    return count


def run(
    manifest: Manifest,
    workers: Workers,
    follow: Follow = lambda *_: None,
    diagnose: Callable[[BagTask], BagResult] = diagnose_bag,
) -> RunTally:
    """Process the due bags and units of an archive.

    Results are committed within five seconds, or when the run ends with an exception. Damaged rows
    are recomputed.

    Raises
    ------
    ValueError
        If the manifest is damaged.
    OSError
        If the archive cannot be written, or a calibration cannot be read.
    ClusterLostError
        If the workers are unreachable.
    """
    tally = RunTally(mended=mend(manifest))
    run_bags(manifest, workers, tally, follow, diagnose)
    run_units(manifest, workers, tally, follow)
    return tally


def run_bags(
    manifest: Manifest,
    workers: Workers,
    tally: RunTally,
    follow: Follow = lambda *_: None,
    diagnose: Callable[[BagTask], BagResult] = diagnose_bag,
) -> None:
    """Process the due bags. Arguments are as in `run`, plus the tally to update."""
    settings = manifest.settings
    total = manifest.find_due(settings)
    follow("bags", 0, total, 0)
    if not total:
        return
    gathered = _Batch[BagResult](
        lambda results: commit_bags(manifest, results, settings), _MOST_BATCHED
    )
    tasks = (BagTask(*bag, settings) for bag in manifest.due(settings))
    try:
        # Close the generator, so that another run may use the workers.
        with closing(workers.run(diagnose, tasks)) as outcomes:
            for outcome in outcomes:
                result = _bag_result(outcome)
                tally.bags += 1
                tally.damaged += result.state == DAMAGED
                tally.incomplete += result.state == INCOMPLETE
                tally.failed += result.state == FAILED
                gathered.add(result)
                follow("bags", tally.bags, total, tally.damaged + tally.incomplete + tally.failed)
    finally:
        gathered.commit()


def _bag_result(outcome: Outcome) -> BagResult:
    task, error = outcome.item, outcome.error
    if error is None and outcome.value.software == estimation_software():
        return outcome.value
    text = _OTHER_SOFTWARE if error is None else f"{type(error).__name__}: {error}"
    # A bag that kills its worker has no result: the machine may have run out of memory.
    return BagResult(task, FAILED, str(error) if isinstance(error, WorkerLostError) else text)


def run_units(
    manifest: Manifest, workers: Workers, tally: RunTally, follow: Follow = lambda *_: None
) -> None:
    """Process the due units. Arguments are as in `run`, plus the tally to update."""
    settings = manifest.settings
    entries = manifest.units_due(settings)
    follow("units", 0, len(entries), 0)
    if not entries:
        return
    gathered = _Batch[tuple[UnitEntry, UnitResult]](
        lambda results: commit_units(manifest, results), _MOST_FOLLOWED
    )
    tasks = (manifest.unit_task(entry, settings) for entry in entries)
    try:
        with closing(workers.run(follow_unit, tasks)) as outcomes:
            for outcome in outcomes:
                entry, result = outcome.item.entry, outcome.value
                if outcome.error is not None or result.software != prognosis_software():
                    # The remaining units are processed; this unit stays due.
                    error = outcome.error
                    text = f"{type(error).__name__}: {error}" if error else _OTHER_SOFTWARE
                    tally.not_followed[entry.unit] = text
                    continue
                gathered.add((entry, result))
                tally.units += 1
                tally.followed += result.followed
                follow("units", tally.units, len(entries), 0)
    finally:
        gathered.commit()
