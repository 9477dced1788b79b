"""Two systems with the same names in two namespaces of one graph, live."""

from pathlib import Path
from typing import Any

import pytest

from ema_cli.processes.bringup import parameter_file, program
from ema_interfaces.msg import FaultEstimate

from .graph import Graph

FRICTION = {"left": 0.9, "right": 0.0}


class Sides(Graph):
    """Nodes in namespaces of their own."""

    def start_in(self, namespace: str, node: str, *remaps: str, **parameters: Any) -> None:
        given = [f"{key.replace('__', '.')}:={value}" for key, value in parameters.items()]
        arguments = [word for item in given for word in ("-p", item)]
        remapped = [word for item in (f"__ns:={namespace}", *remaps) for word in ("-r", item)]
        file = ["--params-file", parameter_file(node)]
        name = f"{namespace.strip('/')}_{node}"
        self.start_other(name, [program(node), "--ros-args", *remapped, *file, *arguments])


@pytest.mark.slow
def test_two_namespaces_do_not_collide_and_peers_count_what_data_flow_from(tmp_path: Path):
    with Sides() as graph:
        estimates: dict[str, list[FaultEstimate]] = {"left": [], "right": []}
        for side, friction in FRICTION.items():
            graph.node.create_subscription(
                FaultEstimate, f"/{side}/fault_estimate", estimates[side].append, 100
            )
            graph.start_in(f"/{side}", "monitor", history_folder=tmp_path / side)
            graph.start_in(f"/{side}", "actuator", faults__friction=friction)
        graph.wait_for(lambda: all(len(found) > 2 for found in estimates.values()), "estimates")
        for side, friction in FRICTION.items():
            for estimate in estimates[side]:
                assert estimate.valid, estimate.reason
                assert abs(estimate.faults.friction - friction) < 0.02

        def level(side: str) -> int:
            return graph.status.get(f"/{side}/monitor: flap health", (-1, "", {}))[0]

        graph.wait_for(lambda: (level("left"), level("right")) == (2, 0), "both levels")
        both = [graph.status[f"/{side}/monitor: flap health"] for side in FRICTION]
        codes = [values["fault_code"] for _, _, values in both]
        assert codes == ["LEFT_MONITOR_FLAP_HEALTH", "RIGHT_MONITOR_FLAP_HEALTH"]
        # Neither ever took the level of the other: no OK after the error, no error on the right.
        assert all("friction" not in text for text in graph.told["/right/monitor: flap health"])

        def peers(node: str) -> set[str]:
            _, _, values = graph.status.get(f"{node}: peers", (0, "", {"present": ""}))
            return set(values["present"].split(", "))

        for side in FRICTION:
            graph.wait_for(lambda s=side: peers(f"/{s}/monitor") == {f"/{s}/actuator"}, "peers")
        assert peers("/left/actuator") == {"/left/monitor"}
