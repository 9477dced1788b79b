# SPDX-License-Identifier: Apache-2.0
"""Storage of a study's runs, one line per run, so that a study can be interrupted at any time."""

import fcntl
import json
import os
from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import asdict
from functools import cache
from pathlib import Path

from ema_core.source_digest import source_digest
from ema_study.plan import Job
from ema_study.run import RunResult, as_frame


class RunStore(AbstractContextManager["RunStore", None]):
    """Runs of a study in a folder, for one process at a time.

    Each run is a line of ``runs.jsonl``, on disk before `add` returns. If a process ended while it
    wrote a line, the incomplete line is dropped when the folder is opened again.

    Raises
    ------
    ValueError
        If another process uses the folder, its runs were made by a different version of models
        or algorithms, or a line is damaged.
    OSError
        If the folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._path = folder / "runs.jsonl"
        self._lock = (folder / ".lock").open("w", encoding="utf-8")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.results = self._read()
        except BlockingIOError as error:
            self._lock.close()
            raise ValueError(f"{folder} is in use by another process") from error
        except BaseException:
            self._lock.close()
            raise

    def __exit__(self, *_: object) -> None:
        self._lock.close()

    def missing(self, jobs: Iterable[Job]) -> list[Job]:
        """Return the jobs that have no stored run."""
        made = {result.job.key for result in self.results}
        return [job for job in jobs if job.key not in made]

    def add(self, result: RunResult) -> None:
        """Append a run to ``runs.jsonl`` and flush it to disk. Raises OSError."""
        content = {"version": numerics_version(), **asdict(result)}
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(content, allow_nan=False) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self.results.append(result)

    def export(self) -> None:
        """Write ``runs.csv`` with one row per run, without convergence curves."""
        frame = as_frame(self.results).drop(columns=["costs", "errors_percent"], errors="ignore")
        frame.to_csv(self.folder / "runs.csv", index=False)

    def _read(self) -> list[RunResult]:
        lines = self._path.read_bytes().splitlines(keepends=True) if self._path.exists() else []
        complete = [line for line in lines if line.endswith(b"\n")]
        results = [_result(line, f"{self._path}, line {n}") for n, line in enumerate(complete, 1)]
        if len(complete) < len(lines):
            os.truncate(self._path, sum(map(len, complete)))
        return results


def _result(line: bytes, where: str) -> RunResult:
    try:
        content = json.loads(line)
        version, job = content.pop("version"), content.pop("job")
        if version == numerics_version():
            return RunResult(job=Job(**job), **content)
    except (ValueError, AttributeError, TypeError, KeyError) as error:
        raise ValueError(f"{where} is damaged: expected a run with its version") from error
    raise ValueError(
        f"{where} was made by a different version of models or algorithms ({version}, expected "
        f"{numerics_version()}): use another folder"
    )


@cache
def numerics_version() -> str:
    """Return a digest of all source code and libraries that a run depends on."""
    return source_digest(["ema_study.run"])
