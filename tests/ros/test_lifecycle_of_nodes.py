"""Each real node in a process of its own: every transition, and signals in every state."""

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

from ema_cli.processes.bringup import NODES, program

from ..waiting import DEADLINE_S, wait_for
from .graph import Graph
from .test_bridge_node import JOINT_STATE

CONFIGURE, CLEAN_UP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
WAYS = {"unconfigured": [], "inactive": [CONFIGURE], "active": [CONFIGURE, ACTIVATE]}
SHUTDOWN = {
    "unconfigured": Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
    "inactive": Transition.TRANSITION_INACTIVE_SHUTDOWN,
    "active": Transition.TRANSITION_ACTIVE_SHUTDOWN,
}
SAMPLE = Path(__file__).parents[2] / "bags" / "faulty_flap.mcap"


class Managed(Graph):
    """Nodes that wait for a manager, which a test is."""

    def start_waiting(self, node: str, name: str, folder: Path) -> None:
        """Start one of ``NODES`` under a name of its own, unconfigured."""
        mapping = folder / "mapping.yaml"
        mapping.write_text(yaml.safe_dump(JOINT_STATE))
        own = {
            "bridge": {"mapping_file": mapping},
            "monitor": {"history_folder": folder / "history"},
            "player": {"bag": SAMPLE, "stay": "true"},
            "recorder": {"output": folder / name, "overwrite": "true"},
            "dashboard": {"port": 0},
        }.get(node, {})
        words = [f"{key}:={value}" for key, value in own.items()]
        given = [word for item in ("autostart:=false", *words) for word in ("-p", item)]
        remapped = ["-r", f"__node:={name}"]
        self.start_other(name, [program(node), "--ros-args", *remapped, *given])

    def change(self, name: str, number: int) -> bool:
        """Ask a node for a transition; return whether it was made."""
        request = ChangeState.Request(transition=Transition(id=number))
        return self._called(ChangeState, f"/ema/{name}/change_state", request).success

    def state(self, name: str) -> str:
        """Return the state that a node tells."""
        answer = self._called(GetState, f"/ema/{name}/get_state", GetState.Request())
        return answer.current_state.label

    def end(self, name: str, number: signal.Signals) -> None:
        """Send a signal; the node has to end without an error."""
        assert self.stop(name, number) == 0, self.log(name).read_text()
        self.has_no_error(name)

    def has_no_error(self, name: str) -> None:
        """Look for errors in what a node has said."""
        said = self.log(name).read_text()
        assert not any(word in said for word in ("Traceback", "[ERROR]", "[FATAL]")), said

    def _called(self, kind: Any, service: str, request: Any) -> Any:
        client = self.node.create_client(kind, service)
        try:
            self.wait_for(client.service_is_ready, service)
            future = client.call_async(request)
            self.wait_for(future.done, f"the answer of {service}")
            return future.result()
        finally:
            self.node.destroy_client(client)


@pytest.fixture
def managed() -> Iterator[Managed]:
    """A graph without nodes."""
    with Managed() as graph:
        yield graph


@pytest.fixture
def begun(managed: Managed, tmp_path: Path) -> Callable[[str], list[str]]:
    """Start a node three times, and bring each to another state; return their names."""

    def begin(node: str) -> list[str]:
        names = []
        for state in WAYS:
            names.append(f"{node}_{state}")
            managed.start_waiting(node, names[-1], tmp_path)
        for name, (state, way) in zip(names, WAYS.items(), strict=True):
            for number in way:
                assert managed.change(name, number), managed.log(name).read_text()
            assert managed.state(name) == state
        return names

    return begin


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("node", NODES)
def test_signal_ends_each_node_in_each_state(managed, begun, node: str, number: signal.Signals):
    for name in begun(node):
        managed.end(name, number)


@pytest.mark.long
@pytest.mark.parametrize("node", NODES)
def test_shutdown_by_the_service_ends_each_node_in_each_state(managed, begun, node: str):
    for name, state in zip(begun(node), WAYS, strict=True):
        assert managed.change(name, SHUTDOWN[state])
        process = managed.processes.pop(name)
        assert process.wait(DEADLINE_S) == 0, managed.log(name).read_text()
        managed.has_no_error(name)


@pytest.mark.long
@pytest.mark.parametrize("node", NODES)
def test_each_node_goes_round_twice_and_refuses_what_is_impossible(managed, tmp_path, node: str):
    managed.start_waiting(node, node, tmp_path)
    impossible = {
        "unconfigured": [ACTIVATE, DEACTIVATE, CLEAN_UP, SHUTDOWN["active"], 200],
        "inactive": [CONFIGURE, DEACTIVATE, SHUTDOWN["unconfigured"]],
        "active": [CONFIGURE, ACTIVATE, CLEAN_UP, SHUTDOWN["inactive"]],
    }
    steps = [
        *((CONFIGURE, "inactive"), (ACTIVATE, "active"), (DEACTIVATE, "inactive")),
        *((ACTIVATE, "active"), (DEACTIVATE, "inactive"), (CLEAN_UP, "unconfigured")),
    ]
    assert managed.state(node) == "unconfigured"
    for number, state in steps * 2:
        assert managed.change(node, number), managed.log(node).read_text()
        assert managed.state(node) == state
        for other in impossible[state]:
            assert not managed.change(node, other), (state, other)
        assert managed.state(node) == state
    wait_for(lambda: "is not possible in state" in managed.log(node).read_text(), "the warning")
    managed.end(node, signal.SIGINT)
