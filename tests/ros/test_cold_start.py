# SPDX-License-Identifier: Apache-2.0
"""After a first start without compiled kernels, all windows are answered."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from .graph import Graph

ACTIVE = "/ema/monitor: lifecycle"


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """A graph without nodes."""
    with Graph(tmp_path / "graph") as graph:
        yield graph


@pytest.fixture
def start_cold(graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Return a function that starts a monitor with an empty cache and waits until it compiles."""

    def start() -> None:
        with monkeypatch.context() as cold:
            cold.setenv("NUMBA_CACHE_DIR", str(tmp_path))
            graph.start("monitor")
        graph.wait_for(
            lambda: any("compiling kernels" in text for text in graph.reported.get(ACTIVE, ())),
            "the compilation in the status",
        )

    return start


@pytest.mark.long
def test_first_windows_with_an_empty_cache_are_all_answered(graph: Graph, start_cold):
    # Windows come every 2 s from the start; compilation takes ten times as long.
    graph.start("actuator", pause_s=0.3)
    graph.wait_for(lambda: "/ema/actuator: simulation" in graph.status, "the actuator")
    start_cold()
    assert graph.estimates == []
    graph.wait_for(lambda: len(graph.estimates) >= 4, "estimates")
    whole = [item for item in graph.estimates if "gap" not in item.reason]
    assert [item.window for item in graph.estimates] == list(range(len(graph.estimates)))
    assert [item.reason for item in whole[1:] if not item.valid] == []
    assert graph.status["/ema/monitor: input"].values["windows dropped"] == "0"
    log = graph.log("monitor").read_text()
    assert "compiling kernels, once for this version: " in log
    assert log.index("compiling kernels") < log.index("configured") < log.index("active")


@pytest.mark.slow
def test_monitor_ends_on_request_while_it_compiles(graph: Graph, start_cold):
    start_cold()
    asked_s = time.monotonic()
    assert graph.stop("monitor", signal.SIGINT) == 0
    # Compilation takes several times as long.
    assert time.monotonic() - asked_s < 10.0
    assert graph.failures() == []
