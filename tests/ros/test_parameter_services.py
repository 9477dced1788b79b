"""Each parameter of each real node, by its services and from another process."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from ema_cli.processes.bringup import NODES

from .test_lifecycle_of_nodes import Managed


class Client:
    """The parameters of one node in another process."""

    def __init__(self, graph: Managed, node: str) -> None:
        self._graph = graph
        self._client = AsyncParameterClient(graph.node, f"/ema/{node}")
        graph.wait_for(self._client.services_are_ready, f"the services of {node}")
        self.names = [
            name for name in self._answer(self._client.list_parameters()).result.names if name
        ]

    def _answer(self, future: Any) -> Any:
        self._graph.wait_for(future.done, "the answer")
        return future.result()

    def values(self) -> dict[str, Any]:
        """Return all values by name."""
        answer = self._answer(self._client.get_parameters(self.names))
        return dict(zip(self.names, map(parameter_value_to_python, answer.values), strict=True))

    def descriptors(self) -> dict[str, ParameterDescriptor]:
        """Return what is said of each."""
        answer = self._answer(self._client.describe_parameters(self.names))
        return dict(zip(self.names, answer.descriptors, strict=True))

    def set_each(self, values: dict[str, Any]) -> dict[str, tuple[bool, str]]:
        """Set parameters, each for itself; return whether it was done, else why not."""
        wanted = [Parameter(name, value=value) for name, value in values.items()]
        answer = self._answer(self._client.set_parameters(wanted))
        found = [(one.successful, one.reason) for one in answer.results]
        return dict(zip(values, found, strict=True))


@pytest.fixture
def managed() -> Iterator[Managed]:
    with Managed() as graph:
        yield graph


@pytest.mark.slow
def test_each_parameter_is_told_set_and_refused_with_its_reason(managed, tmp_path: Path):
    for node in NODES:
        managed.start_waiting(node, node, tmp_path)
    for node in NODES:
        client = Client(managed, node)
        before, descriptors = client.values(), client.descriptors()
        assert len(before) > 5
        # That of use_sim_time is up to rclpy.
        assert [n for n, item in descriptors.items() if not item.description] == ["use_sim_time"]
        # A list of nothing has no type that a client could give it.
        same = {name: value for name, value in before.items() if value is not None}
        for name, (done, reason) in client.set_each(same).items():
            assert done != descriptors[name].read_only, (node, name, reason)
            assert done or "read-only" in reason, (node, name, reason)
        beyond = {
            name: limits[0].to_value * 2 + 1
            for name, item in descriptors.items()
            if (limits := [*item.floating_point_range, *item.integer_range])
            and not item.read_only
            and limits[0].to_value < 2**61
        }
        for name, (done, reason) in client.set_each(beyond).items():
            assert (done, name in reason) == (False, True), (node, name, reason)
        assert client.values() == before
    for node in NODES:
        managed.has_no_error(node)
