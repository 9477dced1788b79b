"""Cases in processes of their own: started, watched, and killed when they take too long."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from part import Part

CASE: Final = Path(__file__).with_name("case.py")
_LAST_LINES: Final = 8


@dataclass
class Outcome:
    """How a case ended: its time [s], the memory of its largest process [MB], what was found."""

    took_s: float
    memory_mb: float
    result: dict[str, Any]


@dataclass
class RunningCase:
    """A case that runs in a group of processes of its own.

    Attributes
    ----------
    folder
        Where its output and what it leaves is; removed where nothing failed.
    """

    part: Part
    seed: int
    number: int
    folder: Path
    began_s: float = field(default_factory=time.monotonic)

    def __post_init__(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        (self.folder / "work").mkdir(parents=True)
        with (self.folder / "output.log").open("wb") as output:
            self._process = subprocess.Popen(
                [
                    *(sys.executable, str(CASE), self.part.name),
                    *("--seed", str(self.seed), "--case", str(self.number)),
                    *("--folder", str(self.folder / "work")),
                    *("--result", str(self.folder / "result.json")),
                ],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def poll(self) -> Outcome | None:
        """Return how it ended; None while it runs."""
        took_s = time.monotonic() - self.began_s
        pid, status, usage = os.wait4(self._process.pid, os.WNOHANG)
        is_late = not pid and took_s > self.part.limit_s
        if is_late:
            self._kill()
            pid, status, usage = os.wait4(self._process.pid, 0)
        if not pid:
            return None
        self._process.returncode = os.waitstatus_to_exitcode(status)
        self._kill()  # what it left running
        result = self._result()
        if is_late:
            result["failures"].append(
                f"it took more than {self.part.limit_s:g} s and was killed{self._last_lines()}"
            )
        elif self._process.returncode not in (0, 1) or (
            self._process.returncode and not result["failures"]
        ):
            code = self._process.returncode
            how = signal.Signals(-code).name if code < 0 else f"exit status {code}"
            result["failures"].append(f"its process ended by {how}{self._last_lines()}")
        if not result["failures"]:
            shutil.rmtree(self.folder, ignore_errors=True)
        return Outcome(took_s, usage.ru_maxrss / 1024.0, result)

    def stop(self) -> None:
        """Kill it."""
        self._kill()
        self._process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _kill(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def _result(self) -> dict[str, Any]:
        try:
            return json.loads((self.folder / "result.json").read_text())
        except (OSError, ValueError):
            return {"counts": {}, "worst": {}, "failures": []}

    def _last_lines(self) -> str:
        lines = (self.folder / "output.log").read_text(errors="replace").splitlines()
        return "".join(f"\n    {line[:200]}" for line in lines[-_LAST_LINES:])
