"""The folder of a study: its runs, one a line, so that it can be interrupted at any time."""

import fcntl
import json
import os
from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Final

from ema_core.source_digest import source_digest
from ema_study.plan import Job
from ema_study.result import RunResult, as_frame

_NUMERICS: Final = (
    "ema_core",
    "ema_sim.actuator",
    "ema_sim.effects",
    "ema_sim.field_oriented",
    "ema_sim.motor",
    "ema_sim.reference",
    "ema_monitor.calibration.alignment",
    "ema_monitor.calibration.calibration",
    "ema_monitor.calibration.columns",
    "ema_monitor.calibration.files",
    "ema_monitor.model.threads",
    "ema_monitor.model.deviations",
    "ema_monitor.model.measured",
    "ema_monitor.model.drives",
    "ema_monitor.model.field_oriented",
    "ema_monitor.model.readings",
    "ema_monitor.identification.fitness",
    "ema_monitor.calibration.fit",
    "ema_monitor.model.monitor_model",
    "ema_monitor.model.kernel",
    "ema_monitor.identification.knowledge",
    "ema_monitor.identification.objective",
    "ema_monitor.identification.relations",
    "ema_monitor.identification.uncertainty",
    "ema_monitor.optimizers",
    "ema_monitor.windows.band",
    "ema_monitor.windows.control_law",
    "ema_monitor.windows.travel",
    "ema_monitor.windows.window",
    "ema_study.cases",
    "ema_study.models",
    "ema_study.plan",
    "ema_study.result",
    "ema_study.run",
    "ema_study.stop_rules",
)
"""Packages and modules that the result of a run depends on."""


class RunStore(AbstractContextManager["RunStore", None]):
    """Runs of a study in a folder, for one process at a time.

    Each run is a line of ``runs.jsonl``, on disk before `add` returns. A line that was cut off by
    the end of a process is dropped when the folder is opened again.

    Parameters
    ----------
    folder
        Made where it is missing.

    Raises
    ------
    ValueError
        When another process has it open, its runs were made by other models or algorithms than the
        present ones, or it is damaged.
    OSError
        When it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._path = folder / "runs.jsonl"
        self._lock = (folder / ".lock").open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._lock.close()
            raise ValueError(f"{folder} is in use by another study") from error
        try:
            self.results = self._read()
        except BaseException:
            self.close()
            raise

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the folder."""
        self._lock.close()

    def missing(self, jobs: Iterable[Job]) -> list[Job]:
        """Return the jobs without a run."""
        made = {result.job.key for result in self.results}
        return [job for job in jobs if job.key not in made]

    def add(self, result: RunResult) -> None:
        """Write a run to disk."""
        content = {"version": numerics_version(), **asdict(result)}
        with self._path.open("a") as file:
            file.write(json.dumps(content, allow_nan=False) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self.results.append(result)

    def export(self) -> None:
        """Write ``runs.csv``, a row a run, and ``runs.json``, which has the curves as well."""
        frame = as_frame(self.results)
        (self.folder / "runs.json").write_text(frame.to_json(orient="records", indent=1))
        frame.drop(columns=["costs", "errors_percent"], errors="ignore").to_csv(
            self.folder / "runs.csv", index=False
        )

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
        version = content.pop("version")
    except (ValueError, AttributeError, TypeError, KeyError) as error:
        raise ValueError(f"{where} is damaged: expected a run with its version") from error
    if version != numerics_version():
        raise ValueError(
            f"{where} is a run of other models or algorithms than the present ones (version "
            f"{version}, expected {numerics_version()}): use another folder"
        )
    try:
        return RunResult(job=Job(**content.pop("job")), **content)
    except (TypeError, KeyError) as error:
        raise ValueError(f"{where} is damaged: {error}") from error


@cache
def numerics_version() -> str:
    """Return a digest of all sources that a run depends on, and of the libraries they use."""
    return source_digest(_NUMERICS)
