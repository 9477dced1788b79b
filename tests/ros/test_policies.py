# SPDX-License-Identifier: Apache-2.0
"""The policies of SROS2 permit exactly the topics, services and actions of each node."""

import os
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, cast

import pytest
import yaml
from click.testing import CliRunner
from rclpy.node import Node, NodeNameNonExistentError
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64

from ema_cli.policies import FOLDER, GraphNames, main, node_access, policy_files
from ema_cli.processes.bringup import NODES, node_class

from ..waiting import DEADLINE_S, wait_for
from .graph import Graph
from .spinning import Spinning

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "bags" / "faulty_flap.mcap"
MAPPING = {
    "joint": "flap_joint",
    "position": {"topic": "/joint_states", "source": "position"},
    "speed": {"topic": "/joint_states", "source": "velocity", "shaft": "user"},
    "current": {"topic": "/joint_states", "source": "effort"},
    "command": {"topic": "command", "source": "data"},
    "temperature": {"topic": "temperature", "source": "temperature"},
}
NOT_ALWAYS = {"/clock", "/ema/baseline", "/ema/friction_curve"}
"""Topics published only at a rate other than 1, or for an unknown drive."""


def names(pairs: list[tuple[str, list[str]]]) -> set[str]:
    return {name for name, _ in pairs}


class Seen:
    """Topics, services and actions that a node has in the graph, by rule of a policy."""

    def __init__(self, observer: Node, access: GraphNames) -> None:
        queries = (
            observer.get_publisher_names_and_types_by_node,
            observer.get_subscriber_names_and_types_by_node,
            observer.get_service_names_and_types_by_node,
            observer.get_client_names_and_types_by_node,
        )
        sets: list[set[str]] = [set() for _ in queries]
        with suppress(NodeNameNonExistentError):  # it has not come yet
            sets = [names(query(access.name, access.namespace)) for query in queries]
        self.publishes, self.subscribes, self.replies, self.requests = sets
        # An action consists of three services and two topics; a policy names only the action.
        ends = [
            {name for name in group if "/_action/" in name}
            for group in (self.publishes, self.replies)
        ]
        self.executes = {name.partition("/_action/")[0] for group in ends for name in group}
        self.publishes -= ends[0]
        self.replies -= ends[1]


def check(observer: Node, access: GraphNames) -> None:
    """Fail if a node has something that is not permitted, or lacks something that is."""
    seen = Seen(observer, access)
    for rule in ("publishes", "subscribes", "replies", "requests", "executes"):
        permitted = getattr(access, rule)
        strangers = {
            name
            for name in getattr(seen, rule)
            if not any(fnmatchcase(name, pattern) for pattern in permitted)
        }
        assert not strangers, f"{access.name} {rule} {strangers}, which its policy does not permit"
    assert seen.replies == set(access.replies)
    assert seen.executes == set(access.executes)
    idle = {name for name in access.publishes if not name.endswith("*")} - seen.publishes
    assert idle <= NOT_ALWAYS, f"{access.name} may publish {idle}, and does not"


def has_subscription(observer: Node, access: GraphNames, topic: str) -> bool:
    return topic in Seen(observer, access).subscribes


def up(graph: Spinning, **nodes: dict[str, Any]) -> None:
    """Bring nodes up, each with its parameters."""
    for name, parameters in nodes.items():
        assert graph.managed(cast(Any, node_class(name)), **parameters).bring_up()


@pytest.mark.slow
def test_policies_permit_the_nodes_around_an_actuator(graph: Spinning, tmp_path):
    access, observer = node_access(), graph.node("observer", "/test")
    recorder, monitor = {"output": str(tmp_path / "bag")}, {"history_folder": "memory"}
    up(graph, dashboard={"port": 0}, recorder=recorder, monitor=monitor, actuator={})
    # Publishers of an actuator's estimates come first, publishers of the follow-ups last.
    for name, topic in (("recorder", "window_fit"), ("dashboard", "advice")):
        wait_for(
            lambda name=name, topic=topic: has_subscription(
                observer, access[name], f"/ema/{topic}"
            ),
            f"{name} listens to {topic}",
        )
    for name in ("dashboard", "recorder", "monitor", "actuator"):
        check(observer, access[name])


@pytest.mark.slow
def test_policies_permit_player_and_bridge(graph: Spinning, tmp_path):
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(yaml.safe_dump(MAPPING))
    access = node_access(
        bridged=["/joint_states", "command", "temperature"], bridges_temperature=True
    )
    observer = graph.node("observer", "/test")
    observer.create_publisher(JointState, "/joint_states", 10)
    observer.create_publisher(Float64, "/ema/command", 10)
    observer.create_publisher(Temperature, "/ema/temperature", 10)
    player = {"bag": str(SAMPLE), "stay": True}
    up(graph, dashboard={"port": 0}, player=player, bridge={"mapping_file": str(mapping)})
    wait_for(lambda: Seen(observer, access["dashboard"]).requests, "a dashboard that steers")
    for topic in ("/joint_states", "/ema/command", "/ema/temperature"):
        wait_for(
            lambda topic=topic: has_subscription(observer, access["bridge"], topic),
            f"a bridge that listens to {topic}",
        )
    for name in ("dashboard", "player", "bridge"):
        check(observer, access[name])


@pytest.mark.parametrize("name", ["watch", "demo", "baseline"])
def test_policy_permits_the_topics_of_a_listener(name):
    from ema_cli.processes.baseline_client import BaselineClient
    from ema_cli.processes.health_listener import HealthListener
    from ema_cli.processes.listener import Listener
    from ema_cli.processes.observer import _TOPICS

    listened = {
        "watch": HealthListener(["/ema"], "watch")._topics,
        "demo": _TOPICS,
        "baseline": BaselineClient("/ema/monitor")._topics,
    }[name]
    access = node_access()[name]
    with Listener(name, listened, lambda *_: None) as listener:
        node = listener._node
        wait_for(lambda: Seen(node, access).replies, "its services")
        check(node, access)
        assert Seen(node, access).subscribes == set(access.subscribes)


def test_every_node_has_an_up_to_date_policy_file():
    made = dict(policy_files("/ema"))
    assert {f"{name}.policy.xml" for name in (*NODES, "watch", "demo", "baseline")} == set(made)
    kept = {path.name: path.read_text() for path in (ROOT / FOLDER).iterdir()}
    assert kept == made, "run `make policies`"


def test_policy_of_a_bridge_permits_the_topics_of_its_mapping(tmp_path):
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(yaml.safe_dump(MAPPING))
    arguments = ["--namespace", "/left", "--mapping", str(mapping), "-o", str(tmp_path)]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    profile = ElementTree.parse(tmp_path / "bridge.policy.xml").find(".//profile")
    assert profile is not None
    received = [item.text for item in profile.findall("topics[@subscribe]/topic")]
    assert received == ["/clock", "/joint_states", "/left/command", "/left/temperature"]
    published = [item.text for item in profile.findall("topics[@publish]/topic")]
    assert "/left/measured_causes" in published


def obstacles() -> Iterator[str]:
    """Yield the reason why SROS2 cannot be tested here, if any."""
    if shutil.which("ros2") is None:
        yield "no command ros2"
        return
    tried = subprocess.run(["ros2", "security", "--help"], capture_output=True, check=False)
    if tried.returncode:
        yield "no package sros2"
    elif os.environ.get("_ROS_WHEELS_BOOTSTRAP_COMPLETE"):
        yield "the Fast DDS of the wheels is built without security"


@pytest.mark.slow
@pytest.mark.skipif(bool(list(obstacles())), reason=", ".join(obstacles()))
def test_secured_graph_works_and_excludes_other_nodes(tmp_path, monkeypatch):
    """With the policies the graph works, and other nodes cannot publish (native ROS 2 only)."""
    keys = tmp_path / "keys"

    def security(*arguments: object) -> None:
        command = ["ros2", "security", *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr

    with Graph(tmp_path) as graph:
        # Permissions are valid for the domain in which they are created.
        monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain_id))
        security("create_keystore", keys)
        for name in ("actuator", "monitor", "recorder", "watch"):
            enclave = node_access()[name].enclave
            security("create_enclave", keys, enclave)
            security("create_permission", keys, enclave, ROOT / FOLDER / f"{name}.policy.xml")
        monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(keys))
        monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
        monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
        up = ["ema", "up", "actuator", "monitor"]
        graph.start_other("up", up)
        graph.start_other("watch", ["ema", "watch"])
        graph.wait_for(lambda: "flap" in graph.log("watch").read_text(), "a received health")
        # The observer of this graph has no key, so it receives nothing.
        assert not graph.healths
        stranger = subprocess.run(
            ["ros2", "topic", "pub", "--once", "/ema/usage", "ema_interfaces/msg/Usage", "{}"],
            env={**os.environ, "ROS_SECURITY_ENCLAVE_OVERRIDE": node_access()["watch"].enclave},
            capture_output=True,
            text=True,
            check=False,
            timeout=DEADLINE_S,
        )
        assert stranger.returncode != 0, stranger.stdout
