"""Which software a result follows from: all that its task imports, but for what runs it."""

import subprocess
import sys

import pytest

from ema_archive import provenance

RUNS_IT = {
    "ema_archive.partitions",
    "ema_archive.provenance",
    "ema_archive.settings",
    "ema_archive.sources",
}
"""Modules that say where rows lie, or whose values are part of the settings' identity."""


@pytest.mark.parametrize(
    ("task", "covered", "packages"),
    [
        (
            "bag_task",
            provenance._ESTIMATION,
            ("ema_core", "ema_bags", "ema_ros", "ema_archive"),
        ),
        ("unit_task", provenance._PROGNOSIS, ("ema_core", "ema_archive", "ema_monitor.prognosis")),
    ],
)
def test_digest_covers_what_a_task_imports(task, covered, packages):
    script = f"import sys, ema_archive.{task}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    imported = {
        name
        for name in done.stdout.split()
        if any(name.startswith(f"{package}.") for package in packages)
    }
    assert imported
    assert {
        name
        for name in imported - RUNS_IT
        if not any(name == one or name.startswith(f"{one}.") for one in covered)
    } == set()
