"""Bring an archive up to date: bags to estimates, then units to health and life."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from ema_archive.bag_task import DAMAGED, DONE, FAILED, BagResult, BagTask, diagnose_bag
from ema_archive.manifest import Manifest
from ema_archive.partitions import read_state, read_unit, replace_rows, write_health, write_state
from ema_archive.provenance import estimation_software, prognosis_software
from ema_archive.settings import ArchiveSettings
from ema_archive.sources import full_url, list_bags
from ema_archive.summaries import write_summaries
from ema_archive.unit_records import UnitEntry
from ema_archive.unit_task import UnitResult, UnitTask, follow_unit
from ema_core.tasks import Outcome, WorkerLostError, Workers

_MOST_GATHERED: Final = 2000
_GATHERED_S: Final = 5.0
_OTHER_SOFTWARE: Final = (
    "the worker has other software than this command: install the same version on all machines"
)


@dataclass(frozen=True)
class RunProgress:
    """How far a run is.

    Attributes
    ----------
    what
        "bags" or "units".
    done, total
        How many are done, of how many.
    failures
        How many of those done could not be used.
    """

    what: str
    done: int
    total: int
    failures: int = 0


Follow = Callable[[RunProgress], None]


@dataclass
class RunTally:
    """What a run did.

    Attributes
    ----------
    bags, damaged, failed
        Bags that were done; of these those that cannot, or could not, be read.
    units, followed
        Units whose health and life was found, and how many of their windows were followed for it.
    not_followed
        Units whose health and life could not be found, with the reason.
    mended
        What was wrong with the tables, in words.
    """

    bags: int = 0
    damaged: int = 0
    failed: int = 0
    units: int = 0
    followed: int = 0
    not_followed: dict[str, str] = field(default_factory=dict)
    mended: list[str] = field(default_factory=list)


def scan(
    manifest: Manifest, sources: Sequence[str], follow: Callable[[int], None] = lambda _: None
) -> int:
    """List the bags of the sources of an archive, those given anew included; return how many.

    Parameters
    ----------
    follow
        Called with the number of bags so far.

    Raises
    ------
    ValueError, OSError
        As of `list_bags`; what was noted before stays.
    """
    every = list(dict.fromkeys([*manifest.sources, *(full_url(source) for source in sources)]))
    number, found = manifest.next_scan, 0
    for source in every:
        for bags in list_bags(source, manifest.archive.resolve()):
            manifest.note(bags, number)
            found += len(bags)
            follow(found)
    # Only now: where a store is out of reach, its bags are not gone.
    manifest.end_scan(number, every)
    return found


def run(
    manifest: Manifest,
    workers: Workers,
    follow: Follow = lambda _: None,
    diagnose: Callable[[BagTask], BagResult] = diagnose_bag,
) -> RunTally:
    """Do what is to be done in an archive.

    What is done is in the tables within five seconds, also when the run is ended by an exception.
    Files of the tables that are missing or damaged are made anew.

    Parameters
    ----------
    follow
        Called after each bag and each unit.
    diagnose
        What is done with a bag.

    Raises
    ------
    OSError
        When the archive cannot be written; or a calibration cannot be read.
    ClusterLostError
        When the workers are out of reach.
    """
    tally = RunTally(mended=manifest.mend())
    try:
        run_bags(manifest, workers, tally, follow, diagnose)
        run_units(manifest, workers, tally, follow)
    finally:
        write_summaries(manifest)
    return tally


def run_bags(
    manifest: Manifest,
    workers: Workers,
    tally: RunTally,
    follow: Follow = lambda _: None,
    diagnose: Callable[[BagTask], BagResult] = diagnose_bag,
) -> None:
    """Do the bags that are to be done; arguments as of `run`, and what to count in."""
    settings = manifest.settings
    total = manifest.find_due(settings)
    follow(RunProgress("bags", 0, total))
    gathered: list[BagResult] = []
    began = time.monotonic()
    tasks = (
        BagTask(url, mark, settings.calibration or beside, settings)
        for url, mark, beside in manifest.due(settings)
    )
    try:
        # Closed, so that another run may use the workers.
        with closing(workers.run(diagnose, tasks)) as outcomes:
            for outcome in outcomes:
                result = _bag_result(outcome)
                tally.bags += 1
                tally.damaged += result.state == DAMAGED
                tally.failed += result.state == FAILED
                gathered.append(result)
                if len(gathered) >= _MOST_GATHERED or time.monotonic() > began + _GATHERED_S:
                    written, gathered = gathered, []
                    write_results(manifest, written, settings)
                    began = time.monotonic()
                follow(RunProgress("bags", tally.bags, total, tally.damaged + tally.failed))
    finally:
        # After a full disk none is left: what could not be written is done again.
        write_results(manifest, gathered, settings)


def _bag_result(outcome: Outcome) -> BagResult:
    task, error = outcome.item, outcome.error
    if error is None:
        result: BagResult = outcome.value
        if result.software != estimation_software():
            return BagResult(task, FAILED, _OTHER_SOFTWARE)
        return result
    if isinstance(error, WorkerLostError):
        # Of the bag nothing is known: the machine may have run out of memory.
        return BagResult(task, FAILED, str(error))
    return BagResult(task, FAILED, f"{type(error).__name__}: {error}")


def write_results(
    manifest: Manifest, results: Sequence[BagResult], settings: ArchiveSettings
) -> None:
    """Put the rows of bags into the tables, each file as a whole, then note them as done.

    After a kill between both they are done again, in the place of these.
    """
    if not results:
        return
    kept = [one for one in results if one.state != FAILED]
    moved = manifest.moved(kept)
    # Without rows: those that they have are taken away.
    left = [BagResult(BagTask(url, "", "", settings), DONE) for url in moved]
    parts = {(one.task.url, part.model, part.unit): part for one in kept for part in one.units}
    archive, files = manifest.archive, []
    for place, urls in sorted(manifest.begin([*kept, *left]).items()):
        model, unit, month = place
        found = [part for url in sorted(urls) if (part := parts.get((url, model, unit)))]
        for table in ("estimates", "usage"):
            rows = [row for part in found for row in part.rows(table, month)]
            files.append(replace_rows(archive, table, place, urls, rows))
    manifest.note_files(files)
    manifest.commit(results, settings, moved)


def run_units(
    manifest: Manifest, workers: Workers, tally: RunTally, follow: Follow = lambda _: None
) -> None:
    """Follow the units that are to be followed; arguments as of `run`, and what to count in."""
    settings = manifest.settings
    due = manifest.units_due(settings)
    follow(RunProgress("units", 0, len(due)))
    entries = {entry.unit: entry for entry in due}
    tasks = (_unit_task(manifest.archive, entry, settings) for entry in due)
    for outcome in workers.run(follow_unit, tasks):
        unit = outcome.item.unit
        if outcome.error is not None:
            # The others are followed all the same; this one stays due.
            words = f"{type(outcome.error).__name__}: {outcome.error}"
            tally.not_followed[unit] = words
            continue
        result: UnitResult = outcome.value
        if result.software != prognosis_software():
            tally.not_followed[unit] = _OTHER_SOFTWARE
            continue
        entry = entries[unit]
        manifest.begin_unit(entry)
        file = write_health(manifest.archive, entry.model, entry.unit, result.health)
        manifest.note_files([file])
        write_state(manifest.archive, entry.unit, result.kept)
        manifest.commit_unit(entry, result)
        tally.units += 1
        tally.followed += result.repeated
        follow(RunProgress("units", tally.units, len(due)))


def _unit_task(archive: Path, entry: UnitEntry, settings: ArchiveSettings) -> UnitTask:
    return UnitTask(
        entry.unit,
        entry.actuator_id,
        entry.serial_number,
        entry.source,
        settings,
        read_unit(archive, "estimates", entry.unit),
        read_unit(archive, "usage", entry.unit),
        read_unit(archive, "health", entry.unit),
        read_state(archive, entry.unit),
    )
