# SPDX-License-Identifier: Apache-2.0
"""SROS2 policies of all nodes, with the topics, services and actions that each node may use.

python -m ema_cli.policies [--namespace /left] [--mapping mapping.yaml] [-o FOLDER]
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import click

from ema_bags.inputs.bridging import Bridge, BridgeSettings
from ema_bags.inputs.mapping import load_mapping
from ema_cli.options import errors_as_one_line
from ema_core.description import ActuatorDescription
from ema_dashboard.known_topics import CLOCK, DIAGNOSTICS, known_topics
from ema_ros import topics
from ema_ros.topics import NAMESPACE

FOLDER: Final = Path("ros2_ws/src/ema_bringup/policies")
_VERSION: Final = "0.2.0"  # of the schema


_OF_ALL: Final = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
    "get_type_description",
)
_OF_LIFECYCLES: Final = (
    "change_state",
    "get_available_states",
    "get_available_transitions",
    "get_state",
    "get_transition_graph",
)
_PUBLISHED_BY_ALL: Final = ("/rosout", "/parameter_events")
_STEERED_BY_DASHBOARD: Final = ("pause", "resume", "seek", "set_rate")
_HISTORY: Final = ("get_history", "note_event")
_ASKED_OF_MONITOR: Final = (
    *("calibrate", "change_baseline", "forget_actuator", *_HISTORY, "predict_remaining_life"),
)
_ASKED_BY_DASHBOARD: Final = (
    *(f"monitor/{name}" for name in ("change_baseline", *_HISTORY)),
    *(f"player/{name}" for name in _STEERED_BY_DASHBOARD),
)
_STEERING: Final = (
    *_STEERED_BY_DASHBOARD,
    "burst",
    "get_rate",
    "is_paused",
    "play_next",
    "toggle_paused",
)
_WATCHED: Final = (
    topics.HEALTH,
    topics.BASELINE,
    topics.FAULT_ESTIMATE,
    topics.PLAYBACK_STATE,
    topics.NODE_STATUS,
    CLOCK,
)
_WATCHED_BY_DEMO: Final = (
    topics.HEALTH,
    topics.FAULT_ESTIMATE,
    topics.SIMULATED_FAULTS,
    topics.TELEMETRY,
    topics.NODE_STATUS,
)


@dataclass(frozen=True)
class GraphNames:
    """Full names of a node's topics, services and actions, sorted."""

    namespace: str
    name: str
    """Namespace and name of the node."""
    publishes: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    """Topics that the node publishes and subscribes to; a trailing ``*`` matches any suffix."""
    replies: tuple[str, ...] = ()
    requests: tuple[str, ...] = ()
    """Services that the node offers, and services that it calls."""
    executes: tuple[str, ...] = ()
    """Actions that the node offers."""

    @property
    def enclave(self) -> str:
        """Path of the enclave in which ``ema`` and the launch files start the node."""
        return f"{self.namespace.rstrip('/')}/{self.name}"


def node_access(
    namespace: str = topics.NAMESPACE,
    bridged: Iterable[str] = (),
    *,
    bridges_temperature: bool = False,
) -> Mapping[str, GraphNames]:
    """Return the topics, services and actions of each node, keyed by the name of the node.

    Parameters
    ----------
    namespace
        Namespace of the nodes.
    bridged
        Topics to which the bridge may subscribe.
    bridges_temperature
        Whether the bridge may publish measured causes, because its mapping has a temperature.
    """
    prefix = namespace.rstrip("/")

    def full(names: Iterable[str]) -> tuple[str, ...]:
        return tuple(name if name.startswith("/") else f"{prefix}/{name}" for name in names)

    everything = f"{prefix}/*"
    shown = [topic.name for topic in known_topics([namespace]) if topic.request is not None]
    monitor_inputs = (topics.TELEMETRY, topics.DESCRIPTION, topics.USAGE, *topics.SYSTEM_TOPICS)
    measured = (topics.MEASURED_CAUSES,) if bridges_temperature else ()
    policies = [
        _node(
            prefix,
            "actuator",
            publishes=(*full(topics.ACTUATOR_TOPICS), CLOCK),
            replies=("set_command", "set_faults"),
        ),
        _node(prefix, "robot", publishes=(*full(topics.ROBOT_TOPICS), CLOCK)),
        _node(
            prefix,
            "bridge",
            publishes=full((topics.TELEMETRY, topics.DESCRIPTION, *measured)),
            subscribes=full(bridged),
        ),
        _node(
            prefix,
            "monitor",
            publishes=full(topics.MONITOR_TOPICS),
            subscribes=full(monitor_inputs),
            replies=_ASKED_OF_MONITOR,
            executes=("calibrate", "identify_faults"),
        ),
        _node(prefix, "recorder", subscribes=(everything, DIAGNOSTICS), replies=("snapshot",)),
        # A bag may contain any topic to which a recorder subscribes.
        _node(prefix, "player", publishes=(everything, CLOCK), replies=_STEERING),
        _node(prefix, "dashboard", subscribes=shown, requests=full(_ASKED_BY_DASHBOARD)),
        # Nodes of commands publish nothing; the namespace of each equals its name.
        _node("/watch", "watch", subscribes=full(_WATCHED), is_managed=False),
        _node(
            "/baseline",
            "baseline",
            subscribes=full((topics.BASELINE,)),
            requests=full(("monitor/change_baseline",)),
            is_managed=False,
        ),
        _node(
            "/demo",
            "demo",
            subscribes=full(_WATCHED_BY_DEMO),
            requests=full(("actuator/set_faults",)),
            is_managed=False,
        ),
    ]
    return {item.name: item for item in policies}


def _node(
    prefix: str,
    name: str,
    *,
    publishes: Iterable[str] = (),
    subscribes: Iterable[str] = (),
    replies: Iterable[str] = (),
    requests: Iterable[str] = (),
    executes: Iterable[str] = (),
    is_managed: bool = True,
) -> GraphNames:
    """Return the names of a node, including the names common to all nodes or lifecycle nodes."""
    local = f"{prefix}/{name}/"
    services = (*_OF_ALL, *(_OF_LIFECYCLES if is_managed else ()), *replies)
    status = (DIAGNOSTICS, f"{prefix}/{topics.NODE_STATUS}", f"{local}transition_event")
    return GraphNames(
        prefix or "/",
        name,
        _sorted(*_PUBLISHED_BY_ALL, *(status if is_managed else ()), *publishes),
        _sorted(*((CLOCK,) if is_managed else ()), *subscribes),
        _sorted(*(local + item for item in services)),
        _sorted(*requests),
        _sorted(*(local + item for item in executes)),
    )


def _sorted(*names: str) -> tuple[str, ...]:
    return tuple(sorted(set(names)))


def policy(access: GraphNames) -> str:
    """Return the XML of a node's policy, which permits only its topics, services and actions."""
    root = ElementTree.Element("policy", version=_VERSION)
    enclaves = ElementTree.SubElement(root, "enclaves")
    enclave = ElementTree.SubElement(enclaves, "enclave", path=access.enclave)
    profiles = ElementTree.SubElement(enclave, "profiles")
    profile = ElementTree.SubElement(profiles, "profile", ns=access.namespace, node=access.name)
    for tag, verb, names in (
        ("topics", "publish", access.publishes),
        ("topics", "subscribe", access.subscribes),
        ("services", "reply", access.replies),
        ("services", "request", access.requests),
        ("actions", "execute", access.executes),
    ):
        if names:
            rule = ElementTree.SubElement(profile, tag, {verb: "ALLOW"})
            for name in names:
                ElementTree.SubElement(rule, tag.removesuffix("s")).text = name
    ElementTree.indent(root)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    return head + ElementTree.tostring(root, encoding="unicode") + "\n"


def policy_files(
    namespace: str, bridged: Iterable[str] = (), *, bridges_temperature: bool = False
) -> Iterator[tuple[str, str]]:
    """Yield name and text of the policy file of each node.

    Parameters
    ----------
    namespace
        Namespace of the nodes.
    bridged
        Topics to which the bridge may subscribe.
    bridges_temperature
        Whether the bridge may publish measured causes, because its mapping has a temperature.
    """
    for name, access in node_access(
        namespace, bridged, bridges_temperature=bridges_temperature
    ).items():
        yield f"{name}.policy.xml", policy(access)


@click.command()
@click.option("--namespace", default=NAMESPACE, help="Namespace of the nodes.", show_default=True)
@click.option(
    "--mapping",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Mapping of the bridge, which may then subscribe to its topics.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=FOLDER,
    show_default=True,
    help="Folder for the files.",
)
def main(namespace: str, mapping: Path | None, output: Path) -> None:
    """Write the policy of each node."""
    with errors_as_one_line():
        bridged: list[str] = []
        bridges_temperature = False
        if mapping is not None:
            loaded = load_mapping(mapping)
            bridge = Bridge(loaded, ActuatorDescription(), BridgeSettings())
            bridged = bridge.collector.topics
            bridges_temperature = loaded.temperature is not None
        output.mkdir(parents=True, exist_ok=True)
        for name, text in policy_files(namespace, bridged, bridges_temperature=bridges_temperature):
            (output / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
