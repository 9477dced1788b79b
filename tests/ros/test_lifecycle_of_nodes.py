"""Each real node in a process of its own: every transition, and signals in every state."""

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

from ema_cli.processes.bringup import NODES, program

from ..waiting import wait_for
from .graph import Graph
from .test_bridge_node import JOINT_STATE

CONFIGURE, CLEAN_UP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
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
    assert managed.stop(node, signal.SIGINT) == 0, managed.log(node).read_text()
    managed.has_no_error(node)
