# SPDX-License-Identifier: Apache-2.0
"""Unit of computing time: a window of the yardstick, hand-written SIMD in C++, on one core.

Times in this unit are comparable between processors. Needs g++.
"""

import re
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent


def build(source: Path, *flags: str) -> Path:
    """Compile a C++ file. Return the path of the program, which is deleted with this process."""
    program = Path(_folder().name) / "_".join([source.stem, *flags])
    if not program.exists():
        subprocess.run(
            ["g++", "-std=c++17", "-O3", "-march=native", *flags, str(source), "-o", str(program)],
            check=True,
        )
    return program


def seconds_per_window() -> float:
    """Run the yardstick (20 repetitions, 50 ms). Return its shortest time per window [s]."""
    program = build(HERE / "yardstick" / "monitor_simd.cpp", "-ffast-math")
    printed = subprocess.run(
        [program], check=True, capture_output=True, text=True, encoding="utf-8"
    ).stdout
    match = re.search(r"ms/sim ([0-9.]+)", printed)
    if not match:
        raise ValueError(f"yardstick: expected its time after 'ms/sim', not {printed!r}")
    return 1e-3 * float(match[1])


@cache
def _folder() -> "tempfile.TemporaryDirectory[str]":
    return tempfile.TemporaryDirectory(prefix="yardstick-")
