"""A node that is killed takes nobody with it, and the others say that it has gone."""

import signal
from pathlib import Path

import pytest

from ema_bags.reader import Bag

from .graph import Graph

pytestmark = pytest.mark.slow

NODES = ("recorder", "monitor", "actuator")


class Flights(Graph):
    """A graph whose recorder writes to a new bag each time it is started."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder
        self.bags: list[Path] = []

    def begin(self, *names: str) -> None:
        for name in names:
            if name == "recorder":
                self.bags.append(self._folder / f"flight_{len(self.bags)}")
                self.start(name, output=self.bags[-1])
            else:
                self.start(name)

    def wait_for_peers(self, name: str, *texts: str) -> None:
        self.wait_for(
            lambda: all(
                text in self.status.get(f"/ema/{name}: peers", ("", ""))[1] for text in texts
            ),
            f"{name} to say {texts}",
        )


def test_killed_nodes_are_missed_and_may_come_back_and_signals_end_all(tmp_path: Path):
    with Flights(tmp_path) as graph:
        graph.begin(*NODES)
        graph.wait_for(lambda: graph.estimates, "an estimate")
        graph.wait_for_peers("actuator", "2 in touch")
        for victim in ("recorder", "monitor"):
            assert graph.stop(victim, signal.SIGKILL) == -signal.SIGKILL
        graph.wait_for_peers("actuator", "/ema/monitor", "/ema/recorder")
        assert graph.processes["actuator"].poll() is None
        # What was recorded until then can be read.
        killed = Bag(graph.bags[-1])
        assert killed.damage
        assert len(list(killed.messages())) > 100
        seen = len(graph.estimates)
        graph.begin("recorder", "monitor")
        graph.wait_for(lambda: len(graph.estimates) > seen, "a further estimate")
        assert graph.estimates[-1].valid, graph.estimates[-1].reason
        graph.wait_for_peers("actuator", "2 in touch")
        for name, number in zip(NODES, (signal.SIGINT, signal.SIGTERM, signal.SIGINT), strict=True):
            graph.processes[name].send_signal(number)
            assert graph.stop(name, number) == 0, graph.log(name).read_text()
            assert "Traceback" not in graph.log(name).read_text()
        assert Bag(graph.bags[-1]).damage == ""
