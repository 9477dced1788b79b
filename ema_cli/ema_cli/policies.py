"""Policies of SROS2, a file for each node, from what the nodes have in the graph.

python -m ema_cli.policies [--namespace /left] [--mapping mapping.yaml] [-o FOLDER]
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import click

from ema_bags.inputs.bridging import Bridge, BridgeSettings
from ema_bags.inputs.mapping import load_mapping
from ema_cli.access import GraphNames, node_access
from ema_cli.errors import one_clear_line
from ema_core.description import ActuatorDescription
from ema_ros.topics import NAMESPACE

FOLDER: Final = Path("ros2_ws/src/ema_bringup/policies")
_VERSION: Final = "0.2.0"  # of the schema


def policy(access: GraphNames) -> str:
    """Return the policy of a node: an enclave that permits what it has in the graph, no more."""
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


def policy_files(namespace: str, bridged: Iterable[str] = ()) -> Iterator[tuple[str, str]]:
    """Yield name and text of the policy file of each node; arguments as of ``node_access``."""
    for name, access in node_access(namespace, bridged).items():
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
    with one_clear_line():
        bridged: list[str] = []
        if mapping is not None:
            bridge = Bridge(load_mapping(mapping), ActuatorDescription(), BridgeSettings())
            bridged = bridge.collector.topics
        output.mkdir(parents=True, exist_ok=True)
        for name, text in policy_files(namespace, bridged):
            (output / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
