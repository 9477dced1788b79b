#!/usr/bin/env python3
"""Feed inputs to one target, guided by the branches of the code that they reach.

    python campaign/fuzz_one.py TARGET FILE...                # those inputs, one after the other
    python campaign/fuzz_one.py TARGET --seed 1 --runs 1000   # as many new ones

An input has failed when it raises what is not documented, takes more than a second of processor
time, or adds more than 500 MB to the memory of the process. It is left in the folder `--found`.
"""

import argparse
import json
import logging
import mmap
import os
import struct
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any, Final

import atheris

ROOT: Final = Path(__file__).resolve().parents[1]
MOST_S: Final = 1.0
"""Processor time of an input [s]."""
MOST_MB: Final = 500.0
"""Memory that an input may add [MB]."""

_PACKAGES: Final = ("ema_core", "ema_monitor", "ema_inputs", "ema_recording", "ema_ros")
_LIBRARIES: Final = ("rosbags", "mcap")
_HANGS_S: Final = 60
_FOUND: Final = struct.Struct("<Qdd")


def _compiled() -> list[str]:
    """Return the modules whose functions numba compiles: it cannot read instrumented code."""
    found = []
    for package in _PACKAGES:
        folder = ROOT / package
        for path in (folder / package).rglob("*.py"):
            text = path.read_text()
            if "_jit" in text or "numba" in text:
                found.append(".".join(path.relative_to(folder).with_suffix("").parts))
    return found


def _memory_mb(name: str) -> float:
    """Return the memory that is used now (VmRSS) or was at most (VmHWM) [MB]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) / 1024.0
    raise LookupError(name)


def _forget_peak() -> None:
    """Let the largest use of memory be counted from now on (proc(5), clear_refs)."""
    Path("/proc/self/clear_refs").write_text("5")


class _Found:
    """Number of inputs, longest time [s] and most memory [MB] of one, shared by two processes."""

    def __init__(self) -> None:
        self._shared = mmap.mmap(-1, _FOUND.size)

    def note(self, took_s: float, grown_mb: float) -> None:
        """Add an input."""
        inputs, worst_s, worst_mb = _FOUND.unpack_from(self._shared)
        figures = inputs + 1, max(worst_s, took_s), max(worst_mb, grown_mb)
        _FOUND.pack_into(self._shared, 0, *figures)

    def told(self) -> dict[str, float]:
        """Return the figures by name."""
        return dict(
            zip(("inputs", "worst_s", "worst_mb"), _FOUND.unpack_from(self._shared), strict=True)
        )


def main() -> None:
    """Feed the inputs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("target")
    parser.add_argument("inputs", nargs="*", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--found", type=Path, default=Path())
    given = parser.parse_args()
    exclude = _compiled()
    instrument: Any = atheris.instrument_imports  # pyright: ignore[reportAttributeAccessIssue]
    with instrument(include=[*_PACKAGES, *_LIBRARIES], exclude=exclude):
        from fuzz_targets import FOLDER, TARGETS
    target = TARGETS[given.target]
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    found = _Found()

    def attack(data: bytes) -> None:
        _forget_peak()
        before_mb, before_s = _memory_mb("VmRSS"), time.process_time()
        target.attack(data)
        took_s, grown_mb = time.process_time() - before_s, _memory_mb("VmHWM") - before_mb
        found.note(took_s, grown_mb)
        if took_s > MOST_S:
            raise AssertionError(f"an input of {len(data)} bytes took {took_s:.2f} s")
        if grown_mb > MOST_MB:
            raise AssertionError(f"an input of {len(data)} bytes took {grown_mb:.0f} MB")

    def mutate(data: bytes, most_bytes: int, seed: int) -> bytes:
        assert target.mutate is not None
        if seed % 2:
            return atheris.Mutate(data, most_bytes)
        return target.mutate(data, seed)[:most_bytes]

    with tempfile.TemporaryDirectory() as folder:
        corpus = Path(folder) / "corpus"
        corpus.mkdir()
        for number, seed in enumerate(target.seeds()):
            (corpus / f"{number:03d}").write_bytes(seed)
        words = Path(folder) / "words"
        words.write_text("".join(f'"{_escaped(word)}"\n' for word in target.words))
        arguments = [str(path) for path in given.inputs] or [
            str(corpus),
            f"-runs={given.runs}",
            f"-seed={given.seed}",
        ]
        options = [
            f"-max_len={target.most_bytes}",
            *([f"-dict={words}"] if target.words else []),
            f"-artifact_prefix={given.found}/",
            f"-timeout={_HANGS_S}",
            "-rss_limit_mb=2500",
            "-print_final_stats=1",
            "-verbosity=0",
        ]
        # What fuzzes ends its process by itself, without any clean-up.
        child = os.fork()
        if not child:
            mutator = {"custom_mutator": mutate} if target.mutate else {}
            atheris.Setup([sys.argv[0], *arguments, *options], attack, **mutator)
            atheris.Fuzz()
        _, status = os.waitpid(child, 0)
    FOLDER.cleanup()
    print(json.dumps(found.told()))
    sys.exit(os.waitstatus_to_exitcode(status))


def _escaped(word: str) -> str:
    return "".join(f"\\x{byte:02x}" for byte in word.encode())


if __name__ == "__main__":
    main()
