"""The folder of a study: its runs, one a line, so that it can be interrupted at any time."""

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import asdict
from functools import cache
from inspect import getsourcefile
from pathlib import Path
from typing import Final

import ema_core
import ema_monitor
import ema_sim
from ema_study import cases, models, plan, run, stop_rules
from ema_study.plan import Job
from ema_study.record import Record, as_frame

_RUNS: Final = "runs.jsonl"
_VERSION: Final = "version"


class RunStore:
    """Runs of a study in a folder.

    Each run is a line of ``runs.jsonl``, on disk before the next one is told of. A line that was
    cut off by the end of a process is dropped when the folder is opened again.

    Parameters
    ----------
    folder
        Made where it is missing.

    Raises
    ------
    ValueError
        When its runs were made by other models or algorithms than the present ones, or it is
        damaged.
    OSError
        When it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._path = folder / _RUNS
        self.records: list[Record] = []
        lines = self._path.read_bytes().splitlines(keepends=True) if self._path.exists() else []
        complete = [line for line in lines if line.endswith(b"\n")]
        for number, line in enumerate(complete, 1):
            try:
                content = json.loads(line)
                version = content.pop(_VERSION)
                self.records.append(Record(**content))
            except (AttributeError, KeyError, TypeError, ValueError) as error:
                raise ValueError(f"{self._path} is damaged in line {number}: {error}") from error
            if version != numerics_version():
                raise ValueError(
                    f"{self._path} holds runs of other models or algorithms than the present "
                    f"ones (version {version}, expected {numerics_version()}): give another folder"
                )
        if len(complete) < len(lines):
            os.truncate(self._path, sum(map(len, complete)))

    def missing(self, jobs: Iterable[Job]) -> list[Job]:
        """Return the jobs that have no run yet."""
        there = {(r.model, r.table, r.algorithm, r.run, r.rule) for r in self.records}
        return [job for job in jobs if job.key not in there]

    def add(self, record: Record) -> None:
        """Write a run to disk."""
        line = json.dumps({_VERSION: numerics_version(), **asdict(record)}) + "\n"
        with self._path.open("a") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
        self.records.append(record)

    def export(self) -> None:
        """Write ``runs.csv``, a row a run, and ``runs.json``, which has the curves as well."""
        frame = as_frame(self.records)
        (self.folder / "runs.json").write_text(frame.to_json(orient="records", indent=1))
        frame.drop(columns=["costs", "errors_percent"], errors="ignore").to_csv(
            self.folder / "runs.csv", index=False
        )


@cache
def numerics_version() -> str:
    """Return a digest of all sources that a run may depend on."""
    digest = hashlib.sha256()
    sources = [Path(getsourcefile(m) or "") for m in (cases, models, plan, run, stop_rules)]
    for package in (ema_core, ema_sim, ema_monitor):
        sources += sorted(Path(package.__path__[0]).rglob("*.py"))
    for source in sources:
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]
