#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Run the node tests repeatedly, the last runs under CPU load.

    tools/soak.py [--runs 20] [--busy 10] [--processes 8] [--limit 3600] [PYTEST ARGUMENTS...]

Prints a line per run with its result, its duration and the last line of pytest. A run that exceeds
the limit is killed with all its processes. The exit code is 1 if a run fails.
"""

import argparse
import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
DEFAULT: Final = ("-n", "2", "--dist", "loadfile", "tests/ros")


def _spin() -> None:
    while True:
        pass


@contextlib.contextmanager
def busy(count: int) -> Iterator[None]:
    """Run ``count`` busy processes during the block, to load the processors."""
    processes = [multiprocessing.Process(target=_spin, daemon=True) for _ in range(count)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def run(arguments: list[str], limit_s: float, log: Path) -> tuple[bool, str]:
    """Run pytest once and return whether it passed, and its last line of output."""
    with log.open("w", encoding="utf-8") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", "-q", *arguments],
            cwd=ROOT,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            code = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return False, f"HUNG: killed after {limit_s:g} s"
    lines = [
        line for line in log.read_text(errors="replace", encoding="utf-8").splitlines() if line
    ]
    return code == 0, lines[-1] if lines else "no output"


def main() -> int:
    """Run the tests repeatedly, print a line per run, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=20, help="number of runs (%(default)s)")
    parser.add_argument(
        "--busy", type=int, default=10, help="number of runs under CPU load (%(default)s)"
    )
    parser.add_argument(
        "--processes", type=int, default=8, help="number of busy processes (%(default)s)"
    )
    parser.add_argument(
        "--limit", type=float, default=3600.0, help="time limit of a run [s] (%(default)g)"
    )
    options, arguments = parser.parse_known_args()
    logs = Path(tempfile.mkdtemp(prefix="soak_"))
    print(f"output of each run in {logs}", flush=True)
    failed = 0
    for number in range(1, options.runs + 1):
        is_loaded = number > options.runs - options.busy
        load = options.processes if is_loaded else 0
        began_s = time.monotonic()
        with busy(load):
            passed, line = run(arguments or [*DEFAULT], options.limit, logs / f"{number}.log")
        failed += not passed
        took_s = time.monotonic() - began_s
        verdict = "passed" if passed else "FAILED"
        print(f"{number:3d}  {load} busy  {verdict}  {took_s:6.0f} s  {line}", flush=True)
    print(f"{options.runs - failed} of {options.runs} runs passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
