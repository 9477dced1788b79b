"""How far the nodes of a command are heard: on this machine alone, unless ``--network`` is given.

``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` keeps nodes from looking elsewhere, and no more. So
peers and discovery servers that the environment names are left out, and a profile of Fast DDS,
which opens its ports on all interfaces, keeps it to loopback and shared memory.
"""

import os
import sys
from collections.abc import Mapping, MutableMapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NoReturn

import click

from ema_cli.processes.bringup import MODULES, assignments_of, localhost_profile, ros_arguments

RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILE: Final = "FASTRTPS_DEFAULT_PROFILES_FILE"
_LOCALHOST_ONLY: Final = "ROS_LOCALHOST_ONLY"
_ELSEWHERE: Final = ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
_NEAR: Final = ("LOCALHOST", "OFF")
_SHIPPED_PROFILE: Final = 'profile_name="quick_discovery"'
"""What the profiles of this repository have, and no other."""


def set_reach(network: bool, environment: MutableMapping[str, str] = os.environ) -> None:
    """Open the nodes of this process and its children to the network, or close them to it.

    Settings of the environment that are not followed are reported on stderr.
    """
    if network:
        keeping = [name for name in (RANGE,) if environment.get(name) in _NEAR]
        keeping += [_LOCALHOST_ONLY] if environment.get(_LOCALHOST_ONLY) == "1" else []
        for name in keeping:
            raise ValueError(
                f"--network: {name}={environment[name]} keeps nodes to this machine: unset it, or "
                f"set {RANGE}=SUBNET"
            )
        return
    far = [name for name in _ELSEWHERE if environment.get(name)]
    if environment.get(RANGE, "LOCALHOST") not in _NEAR:
        far.insert(0, RANGE)
    if far:
        settings = " ".join(f"{name}={environment[name]}" for name in far)
        click.echo(f"nodes keep to this machine: --network lets {settings} have effect", err=True)
    for name in _ELSEWHERE:
        environment.pop(name, None)
    if environment.get(RANGE) != "OFF":  # which is nearer still
        environment[RANGE] = "LOCALHOST"
    if _is_shipped(environment.get(PROFILE)):
        environment[PROFILE] = str(localhost_profile())


def run_node(
    node: str, parameters: Mapping[str, Any], assignments: Sequence[str], *, network: bool
) -> NoReturn:
    """Run a node in this process, which ends with it: ``assignments`` override ``parameters``."""
    set_reach(network)
    arguments = ros_arguments(node, assignments=[*assignments_of(parameters), *assignments])
    sys.exit(import_module(MODULES[node]).main(arguments))


def _is_shipped(profile: str | None) -> bool:
    """Return whether there is no profile of Fast DDS, or one of this repository."""
    if not profile:
        return True
    try:
        return _SHIPPED_PROFILE in Path(profile).read_text(encoding="utf-8", errors="replace")
    except OSError:  # Fast DDS says what is wrong
        return False
