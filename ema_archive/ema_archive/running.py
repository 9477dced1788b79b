"""Bring an archive up to date: bags to estimates, then units to health and life."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from ema_archive.bag_task import DAMAGED, DONE, FAILED, INCOMPLETE, BagResult, BagTask, diagnose_bag
from ema_archive.manifest import Manifest
from ema_archive.partitions import (
    STAMPS,
    TABLES,
    month_of,
    path_of,
    read_unit,
    replace_rows,
    write_health,
    write_table,
)
from ema_archive.settings import ArchiveSettings, estimation_software, prognosis_software
from ema_archive.sources import full_url, list_bags
from ema_archive.tables import PARTITIONED, WHOLE
from ema_archive.unit_task import UnitTask, follow_unit
from ema_core.files import complete_file
from ema_core.tasks import Outcome, WorkerLostError, Workers

_MOST_GATHERED: Final = 2000
_GATHERED_S: Final = 5.0
_ROWS: Final = 50_000
_OTHER_SOFTWARE: Final = (
    "the worker has other software than this command: install the same version on all machines"
)


Follow = Callable[[str, int, int, int], None]
"""Called with "bags" or "units", how many are done, of how many, and how many of them failed."""


@dataclass
class RunTally:
    """What a run did.

    Attributes
    ----------
    bags, damaged, incomplete, failed
        Bags that were done; of these those that cannot be read, can be read only in part, or could
        not be read.
    units, followed
        Units whose health and life was found, and how many of their windows were followed for it.
    not_followed
        Units whose health and life could not be found, with the reason.
    mended
        Defects of the tables, in words.
    """

    bags: int = 0
    damaged: int = 0
    incomplete: int = 0
    failed: int = 0
    units: int = 0
    followed: int = 0
    not_followed: dict[str, str] = field(default_factory=dict)
    mended: list[str] = field(default_factory=list)


def scan(
    manifest: Manifest, sources: Sequence[str], follow: Callable[[int], None] = lambda _: None
) -> int:
    """List the bags of the sources of an archive, including new sources; return their number.

    The tables that are one file each are then as the archive is.

    Raises
    ------
    ValueError, OSError
        As in `list_bags`; entries noted before remain.
    """
    every = list(dict.fromkeys([*manifest.sources, *(full_url(source) for source in sources)]))
    number, count = manifest.next_scan, 0
    for source in every:
        for bags in list_bags(source, manifest.archive.resolve()):
            manifest.note(bags, number)
            count += len(bags)
            follow(count)
    # Only now: where a store is out of reach, its bags are not gone.
    manifest.end_scan(number, every)
    write_summaries(manifest)
    return count


def run(
    manifest: Manifest,
    workers: Workers,
    follow: Follow = lambda *_: None,
    diagnose: Callable[[BagTask], BagResult] = diagnose_bag,
) -> RunTally:
    """Process the due bags and units of an archive.

    What is done is in the tables within five seconds, also when the run is ended by an exception.
    Files of the tables that are missing or damaged are made anew.

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
    follow: Follow = lambda *_: None,
    diagnose: Callable[[BagTask], BagResult] = diagnose_bag,
) -> None:
    """Process the due bags; arguments are as in `run`, with the tally to count in."""
    settings = manifest.settings
    total = manifest.find_due(settings)
    follow("bags", 0, total, 0)
    gathered: list[BagResult] = []
    began = time.monotonic()
    tasks = (BagTask(*bag, settings) for bag in manifest.due(settings))
    try:
        # Closed, so that another run may use the workers.
        with closing(workers.run(diagnose, tasks)) as outcomes:
            for outcome in outcomes:
                result = _bag_result(outcome)
                tally.bags += 1
                tally.damaged += result.state == DAMAGED
                tally.incomplete += result.state == INCOMPLETE
                tally.failed += result.state == FAILED
                gathered.append(result)
                if len(gathered) >= _MOST_GATHERED or time.monotonic() > began + _GATHERED_S:
                    written, gathered = gathered, []
                    write_results(manifest, written, settings)
                    began = time.monotonic()
                follow("bags", tally.bags, total, tally.damaged + tally.incomplete + tally.failed)
    finally:
        # After a full disk none is left: results that could not be written are computed again.
        write_results(manifest, gathered, settings)


def _bag_result(outcome: Outcome) -> BagResult:
    task, error = outcome.item, outcome.error
    if error is None and outcome.value.software == estimation_software():
        return outcome.value
    words = _OTHER_SOFTWARE if error is None else f"{type(error).__name__}: {error}"
    # A bag that ends its worker has no result: the machine may have run out of memory.
    return BagResult(task, FAILED, str(error) if isinstance(error, WorkerLostError) else words)


def write_results(
    manifest: Manifest, results: Sequence[BagResult], settings: ArchiveSettings
) -> None:
    """Put the rows of bags into the tables, each file as a whole, then note them as done.

    After a kill between both they are done again, in the place of these.
    """
    if not results:
        return
    kept = [one for one in results if one.state not in (FAILED, DAMAGED)]
    moved = manifest.moved(kept)
    # Without rows: those that they have are taken away.
    left = [BagResult(BagTask(url, "", "", settings), DONE) for url in moved]
    parts = {(one.task.url, part.model, part.unit): part for one in kept for part in one.units}
    places = manifest.begin([*kept, *left])
    for (model, unit, month), urls in sorted(places.items()):
        parts_of_unit = [part for url in sorted(urls) if (part := parts.get((url, model, unit)))]
        for table, stamp in STAMPS.items():
            rows = [row for part in parts_of_unit for row in getattr(part, table)]
            rows = [row for row in rows if month_of(row[stamp]) == month]
            path = path_of(manifest.archive, table, model, unit, month)
            replace_rows(path, table, urls, rows)
    manifest.commit(results, settings, moved, places)


def run_units(
    manifest: Manifest, workers: Workers, tally: RunTally, follow: Follow = lambda *_: None
) -> None:
    """Process the due units; arguments are as in `run`, with the tally to count in."""
    settings = manifest.settings
    entries = manifest.units_due(settings)
    follow("units", 0, len(entries), 0)
    tasks = (
        UnitTask(
            entry,
            settings,
            **{name: read_unit(manifest.archive, name, entry.unit) for name in PARTITIONED},
            kept=manifest.kept_history(entry.unit),
            lost=manifest.lost_after(entry.unit),
        )
        for entry in entries
    )
    for outcome in workers.run(follow_unit, tasks):
        entry, result = outcome.item.entry, outcome.value
        if outcome.error is not None or result.software != prognosis_software():
            # The others are followed all the same; this one stays due.
            error = outcome.error
            words = f"{type(error).__name__}: {error}" if error else _OTHER_SOFTWARE
            tally.not_followed[entry.unit] = words
            continue
        manifest.begin_unit(entry.unit)
        write_health(manifest.archive, entry.model, entry.unit, result.health)
        manifest.commit_unit(entry, result)
        tally.units += 1
        tally.followed += result.followed
        follow("units", tally.units, len(entries), 0)


def write_summaries(manifest: Manifest) -> None:
    """Write the tables that are one file each, as the archive is.

    Raises
    ------
    OSError
        When they cannot be written; those before stay.
    """
    folder = manifest.archive / TABLES
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in WHOLE if name != "bags"}
    for model, unit, summary in manifest.units():
        for name, table_rows in summary.items():
            rows[name] += [row | {"model": model, "unit": unit} for row in table_rows]
    for name, table_rows in rows.items():
        path = folder / f"{name}.parquet"
        write_table(path, pa.Table.from_pylist(table_rows, WHOLE[name]))
        manifest.note_table(path)
    # In parts: millions of bags need not be held in memory.
    schema = WHOLE["bags"]
    with (
        complete_file(folder / "bags.parquet") as partial,
        pq.ParquetWriter(partial, schema, compression="zstd") as writer,
    ):
        bags = manifest.bags()
        while page := bags.fetchmany(_ROWS):
            table_rows = [dict(zip(schema.names, row, strict=True)) for row in page]
            table_rows = [row | {"is_there": bool(row["is_there"])} for row in table_rows]
            writer.write_table(pa.Table.from_pylist(table_rows, schema))
    manifest.note_table(folder / "bags.parquet")
