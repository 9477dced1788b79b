"""A node that is killed takes nobody with it, and the others say that it has gone."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from ema_recording.reader import Bag

from .graph import Graph

pytestmark = pytest.mark.slow

NODES = ("recorder", "monitor", "actuator")


class Flights(Graph):
    """A graph whose recorder writes to a new bag each time it is started."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder
        self.bags: list[Path] = []

    def begin(self, name: str) -> None:
        if name == "recorder":
            self.bags.append(self._folder / f"flight_{len(self.bags)}")
            self.start(name, output=self.bags[-1])
        else:
            self.start(name)

    def wait_until_in_touch(self, names: tuple[str, ...], text: str) -> None:
        self.wait_for(
            lambda: all(text in self.status.get(f"/ema/{n}: peers", (1, "", {}))[1] for n in names),
            f"{', '.join(names)} to say {text!r}",
        )


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flights]:
    with Flights(tmp_path_factory.mktemp("flights")) as graph:
        yield graph


@pytest.fixture
def running(flights: Flights) -> Flights:
    """All nodes, in touch with each other: those that the test before left, and the others anew."""
    flights.status.clear()
    seen = len(flights.estimates)
    for name in NODES:
        if name not in flights.processes or flights.processes[name].poll() is not None:
            flights.begin(name)
    flights.wait_for(lambda: len(flights.estimates) > seen, "an estimate")
    flights.wait_until_in_touch(NODES, "2 in touch")
    return flights


# The recorder first: the bag of the next one lives through the other deaths.
@pytest.mark.parametrize("victim", NODES)
def test_killed_node_is_missed_and_may_come_back(running: Flights, victim: str):
    if victim == "recorder":
        # Two cycles of 1.7 s: of these a busy recorder loses what it has not written yet.
        seen = len(running.estimates)
        running.wait_for(lambda: len(running.estimates) > seen + 1, "two estimates")
    assert running.stop(victim, signal.SIGKILL) == -signal.SIGKILL
    others = tuple(name for name in NODES if name != victim)
    running.wait_until_in_touch(others, f"/ema/{victim}")
    assert all(running.processes[name].poll() is None for name in others)
    if victim != "actuator":
        cycle = int(running.status["/ema/actuator: simulation"][2]["cycle"])
        running.wait_for(
            lambda: int(running.status["/ema/actuator: simulation"][2]["cycle"]) > cycle + 1,
            "the actuator to go on",
        )
    if victim == "recorder":
        # What was recorded until then can be read.
        killed = Bag(running.bags[-1])
        assert killed.damage
        assert killed.topics["/ema/telemetry"].count > 100
        assert len(list(killed.messages())) > 100
    running.begin(victim)
    seen = len(running.estimates)
    running.wait_for(lambda: len(running.estimates) > seen + 1, "further estimates")
    assert running.estimates[-1].valid, running.estimates[-1].reason
    for name in others:
        running.wait_for(
            lambda name=name: running.status[f"/ema/{name}: peers"][0] == 0,
            f"{name} to be in touch again",
        )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_every_node(running: Flights, number: signal.Signals):
    for name in ("actuator", "monitor", "recorder"):
        process = running.processes[name]
        process.send_signal(number)
        process.send_signal(number)
        assert running.stop(name, number) == 0, running.log(name).read_text()
        assert "Traceback" not in running.log(name).read_text()
    assert Bag(running.bags[-1]).damage == ""
