"""Files that cannot be written: full, broken and read-only disks, deaths between two writes."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Final

from part import Case, Part

_HERE: Final = Path(__file__).parent
_TRIALS: Final = 300


def run(case: Case) -> None:
    """Let a call that changes files fail, or the process die in it, in many trials."""
    library = case.folder / "faulty_files.so"
    subprocess.run(
        [
            *("c++", "-std=c++17", "-O1", "-shared", "-fPIC"),
            *(str(_HERE / "faulty_files.cpp"), "-o", str(library), "-ldl"),
        ],
        check=True,
    )
    result = case.folder / "trials.json"
    subprocess.run(
        [
            *(sys.executable, str(_HERE / "file_trials.py")),
            *(str(case.seed), str(case.number), str(case.steps or _TRIALS), str(result)),
        ],
        env={**os.environ, "LD_PRELOAD": str(library), "PYTHONDONTWRITEBYTECODE": "1"},
        check=True,
    )
    found = json.loads(result.read_text())
    case.counts.update(found["counts"])
    case.failures += found["failures"]


PART: Final = Part(
    name="files",
    summary="nothing is lost but the open chunk or the current test; no half file is read",
    run=run,
    usual_s=60.0,
    limit_s=600.0,
    share=0.5,
)
