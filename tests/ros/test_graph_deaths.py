# SPDX-License-Identifier: Apache-2.0
"""A killed node does not disturb the other nodes, which report that it has gone."""

import signal
from pathlib import Path

import pytest

from ema_bags.reader import Bag

from .graph import Graph


@pytest.mark.slow
def test_killed_nodes_are_reported_may_restart_and_signals_end_all(tmp_path: Path):
    def wait_for_peers(*texts: str) -> None:
        name = "/ema/actuator: peers"
        graph.wait_for(lambda: all(graph.reports(name, text) for text in texts), f"{name}: {texts}")

    with Graph(tmp_path / "graph") as graph:
        graph.start("recorder", output=tmp_path / "killed")
        graph.start("monitor")
        graph.start("actuator")
        graph.wait_for(lambda: graph.estimates, "an estimate")
        wait_for_peers("in contact with 2 nodes")
        for victim in ("recorder", "monitor"):
            graph.kill(victim)
        wait_for_peers("/ema/monitor", "/ema/recorder")
        # The recording can be read up to the kill.
        killed = Bag(tmp_path / "killed")
        assert killed.damage
        assert len(list(killed.messages())) > 100
        seen = len(graph.estimates)
        graph.start("recorder", output=tmp_path / "ended")
        graph.start("monitor")
        graph.wait_for(lambda: len(graph.estimates) > seen, "a further estimate")
        assert graph.estimates[-1].valid, graph.estimates[-1].reason
        wait_for_peers("in contact with 2 nodes")
        for name, number in (
            ("recorder", signal.SIGINT),
            ("monitor", signal.SIGTERM),
            ("actuator", signal.SIGINT),
        ):
            # A launcher may send a signal twice.
            graph.processes[name].send_signal(number)
            assert graph.stop(name, number) == 0, graph.log(name).read_text()
        assert graph.failures() == []
        assert Bag(tmp_path / "ended").damage == ""
