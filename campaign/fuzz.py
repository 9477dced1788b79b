"""Inputs that others may have written: fuzzed, guided by the branches of the code they reach."""

import json
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from part import Case, Goal, Part

TARGETS: Final = {
    "bag": 4_000,
    "message": 40_000,
    "schema": 10_000,
    "description": 60_000,
    "calibration": 4_000,
    "mapping": 30_000,
    "settings": 100_000,
    "metadata": 30_000,
    "history": 2_000,
    "lines": 100_000,
    "growth": 1_000,
    "table": 4_000,
}
"""Targets (`fuzz_targets`), with the number of inputs in a case: about a minute on an idle
machine."""

INPUTS: Final = 1_000_000
"""Inputs that are asked of a campaign, of all targets together."""

ONE: Final = Path(__file__).with_name("fuzz_one.py")
_RAISED: Final = re.compile(r"=== Uncaught Python exception: ===\n(.*?)(?:\n==\d|\Z)", re.DOTALL)
_SHOWN_LINES: Final = 6


def run(case: Case) -> None:
    """Feed inputs to the target whose turn it is."""
    name = list(TARGETS)[case.number % len(TARGETS)]
    runs = min(case.steps or TARGETS[name], TARGETS[name])
    seed = (case.seed * 1_000_003 + case.number) % (2**31 - 1) + 1
    done = subprocess.run(
        [
            *(sys.executable, str(ONE), name),
            *("--seed", str(seed), "--runs", str(runs), "--found", str(case.folder)),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        check=False,
    )
    last = done.stdout.splitlines()[-1:]
    found = json.loads(last[0]) if last and last[0].startswith('{"inputs"') else {"inputs": 0}
    case.count(f"inputs of {name}", int(found["inputs"]))
    case.measure("longest input [s of processor]", found.get("worst_s", 0.0))
    case.measure("most memory of an input [MB]", found.get("worst_mb", 0.0))
    if done.returncode or found["inputs"] < runs:
        files = ", ".join(str(path) for path in case.folder.iterdir()) or "no file"
        case.fail(f"{name} after {found['inputs']} inputs: {_words(done.stdout)}\n    {files}")


def _words(output: str) -> str:
    """Return what was raised, with the last places of the traceback."""
    raised = _RAISED.search(output)
    lines = [line for line in (raised[1] if raised else output).splitlines() if "^^^" not in line]
    return "\n    ".join(lines[-1:] + lines[-_SHOWN_LINES:-1])


def goals(counts: Mapping[str, int]) -> list[Goal]:
    """Inputs of all targets, and targets that had any."""
    inputs = {name: counts.get(f"inputs of {name}", 0) for name in TARGETS}
    fed = sum(count > 0 for count in inputs.values())
    return [Goal("inputs", INPUTS, sum(inputs.values())), Goal("targets", len(TARGETS), fed)]


PART: Final = Part(
    name="fuzz",
    summary="no input raises, takes 1 s or 500 MB",
    run=run,
    usual_s=60.0,
    limit_s=1800.0,
    share=1.0,
    goals=goals,
)
