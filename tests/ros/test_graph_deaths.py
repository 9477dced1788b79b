"""A node that is killed takes nobody with it, and the others say that it has gone."""

import signal
from pathlib import Path

import pytest

from ema_recording.reader import Bag

from .graph import Graph

pytestmark = pytest.mark.slow


@pytest.fixture
def running(tmp_path: Path):
    with Graph() as graph:
        graph.start("recorder", output=tmp_path / "flight")
        graph.start("monitor")
        graph.start("actuator")
        graph.wait_for(lambda: graph.estimates, "an estimate")
        graph.wait_for(
            lambda: all(
                graph.status.get(f"{name}: peers", (1, "", {}))[1] == "2 in touch"
                for name in ("actuator", "monitor", "recorder")
            ),
            "the nodes to know each other",
        )
        yield graph


@pytest.mark.parametrize("victim", ["actuator", "monitor", "recorder"])
def test_killed_node_is_missed_and_may_come_back(running: Graph, victim: str, tmp_path: Path):
    assert running.stop(victim, signal.SIGKILL) == -signal.SIGKILL
    others = [name for name in ("actuator", "monitor", "recorder") if name != victim]
    for name in others:
        running.wait_for(
            lambda name=name: f"/ema/{victim}" in running.status[f"{name}: peers"][1],
            f"{name} to say that {victim} has gone",
        )
        assert running.processes[name].poll() is None
    if victim != "actuator":
        cycle = int(running.status["actuator: simulation"][2]["cycle"])
        running.wait_for(
            lambda: int(running.status["actuator: simulation"][2]["cycle"]) > cycle + 1,
            "the actuator to go on",
        )
    if victim == "recorder":
        # What was recorded until then can be read.
        killed = Bag(tmp_path / "flight")
        assert killed.damage
        assert killed.topics["/ema/telemetry"].count > 100
        assert len(list(killed.messages())) > 100
        running.start("recorder", output=tmp_path / "second")
    else:
        running.start(victim)
    seen = len(running.estimates)
    running.wait_for(lambda: len(running.estimates) > seen + 1, "further estimates")
    assert running.estimates[-1].valid, running.estimates[-1].reason
    for name in others:
        running.wait_for(
            lambda name=name: running.status[f"{name}: peers"][0] == 0,
            f"{name} to be in touch again",
        )
    for name in ("actuator", "monitor", "recorder"):
        assert running.stop(name) == 0, running.log(name).read_text()
    if victim != "recorder":
        assert Bag(tmp_path / "flight").damage == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_every_node(running: Graph, number: signal.Signals, tmp_path: Path):
    for name in ("actuator", "monitor", "recorder"):
        process = running.processes[name]
        process.send_signal(number)
        process.send_signal(number)
        assert running.stop(name, number) == 0, running.log(name).read_text()
        assert "Traceback" not in running.log(name).read_text()
    assert Bag(tmp_path / "flight").damage == ""
