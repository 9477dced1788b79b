# SPDX-License-Identifier: Apache-2.0
"""Cleanup of processes that a crashed or killed worker of xdist left behind."""

import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Kill all processes that a worker started and did not end."""
    marks = (
        f"PYTEST_XDIST_TESTRUNUID={node.workerinput['testrunuid']}\0".encode(),
        f"PYTEST_XDIST_WORKER={node.workerinput['workerid']}\0".encode(),
    )
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # of another user, or just ended
            environment = (folder / "environ").read_bytes() + b"\0"
            if all(mark in environment for mark in marks):
                os.kill(int(folder.name), signal.SIGKILL)
