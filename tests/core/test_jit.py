# SPDX-License-Identifier: Apache-2.0
"""Compilation of the kernels: the cache follows the sources, and options are as documented."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ema_core import source_digest as source_digest_module

PROBE = "ema_probe_kernels"


def test_digest_follows_the_sources_that_a_module_imports(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / PROBE
    (folder / "deep").mkdir(parents=True)

    def digest(inner: str, **additional: str) -> str:
        """Return the digest of a module that imports a module with the given source."""
        sources = {"__init__": "", "outer": f"from {PROBE} import (\n    inner,\n)\n"}
        for name, text in {**sources, "inner": inner, **additional}.items():
            (folder / f"{name}.py").write_text(text)
        source_digest_module._source.cache_clear()
        return source_digest_module.source_digest([f"{PROBE}.outer"])

    before = digest("FACTOR = 1\n")
    assert digest("FACTOR = 1\n", other="FACTOR = 2\n") == before
    (folder / "deep" / "kernels.py").write_text("FACTOR = 2\n")
    changed = digest(f"from {PROBE}.deep.kernels import FACTOR\n")
    (folder / "deep" / "kernels.py").write_text("FACTOR = 3\n")
    assert before != changed != digest(f"from {PROBE}.deep.kernels import FACTOR\n") != before


INNER = """
from ema_core._jit import kernel

@kernel()
def factor():
    return {factor}
"""
OUTER = """
from ema_core._jit import kernel
from ema_monitor.inner import factor

@kernel()
def scaled(x):
    return factor() * x

print(scaled(1.0), sum(scaled.stats.cache_hits.values()))
"""


class Kernels:
    """A package with a kernel that calls a kernel of another file, run in separate processes."""

    def __init__(self, root: Path) -> None:
        self.folder = root / "ema_monitor"
        self.cache = root / "cache"
        self.folder.mkdir()
        (self.folder / "__init__.py").write_text("")
        (self.folder / "outer.py").write_text(OUTER)
        self._environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(root), *filter(None, sys.path)]),
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(self.cache),
        }

    def run(self, factor: float = 2.0) -> tuple[list[float], str]:
        """Write the called kernel with a factor, and run the calling kernel in a new process.

        Returns a list of the result and the number of cache hits, and the log.
        """
        (self.folder / "inner.py").write_text(INNER.format(factor=factor))
        done = subprocess.run(
            [sys.executable, "-c", "import ema_monitor.outer"],
            env=self._environment,
            capture_output=True,
            text=True,
            check=True,
            timeout=100,
        )
        return [float(word) for word in done.stdout.split()], done.stderr

    def files(self, suffix: str) -> list[Path]:
        """Return the cache files of the calling kernel."""
        return [item for item in self.cache.rglob(f"*{suffix}") if "scaled" in item.name]


@pytest.fixture
def kernels(tmp_path: Path) -> Kernels:
    return Kernels(tmp_path)


@pytest.mark.slow
def test_kernel_is_compiled_again_if_its_callee_changes_or_a_cache_file_is_damaged(kernels):
    """numba's own cache would miss a change in another file.

    Each step runs in a new process, because a process keeps modules and digest.
    """
    assert kernels.run() == ([2.0, 0.0], "")
    [index], [data] = kernels.files(".nbi"), kernels.files(".nbc")
    whole = data.read_bytes()
    middle = len(whole) // 2
    changed = whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
    for path, damaged in ((index, index.read_bytes()[:40]), (data, changed), (data, b"")):
        path.write_bytes(damaged)
        result, log = kernels.run()
        assert result == [2.0, 0.0]
        assert f"{path} is damaged: the kernel is recompiled" in log
    assert kernels.run() == ([2.0, 1.0], "")  # unchanged: not compiled again
    assert kernels.run(3.0) == ([3.0, 0.0], "")


@pytest.mark.slow
def test_kernels_are_compiled_if_nothing_can_be_cached(kernels):
    kernels.cache.write_text("no folder")
    result, log = kernels.run()
    assert result == [2.0, 0.0]
    assert log.count("is not writable: kernels are compiled at each start") == 1
