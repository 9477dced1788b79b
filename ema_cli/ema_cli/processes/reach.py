# SPDX-License-Identifier: Apache-2.0
"""Network reach of a command's nodes: only this machine, unless ``--network`` is set.

``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` only limits the discovery by a node. Therefore peers and
discovery servers in the environment are ignored, and a profile limits Fast DDS, which otherwise
opens ports on all interfaces, to loopback and shared memory.
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
"""Text that only the Fast DDS profiles of this repository contain."""


def set_reach(network: bool, environment: MutableMapping[str, str] = os.environ) -> None:
    """Limit nodes of this process and its children to this machine, or allow the network.

    Without ``network``, ignored settings of the environment are reported on stderr.

    Raises
    ------
    ValueError
        If ``network`` is set but the environment limits nodes to this machine.
    """
    if network:
        keeping = [name for name in (RANGE,) if environment.get(name) in _NEAR]
        keeping += [_LOCALHOST_ONLY] if environment.get(_LOCALHOST_ONLY) == "1" else []
        for name in keeping:
            raise ValueError(
                f"--network: {name}={environment[name]} limits nodes to this machine: unset it, "
                f"or set {RANGE}=SUBNET"
            )
        return
    far = [name for name in _ELSEWHERE if environment.get(name)]
    if environment.get(RANGE, "LOCALHOST") not in _NEAR:
        far.insert(0, RANGE)
    if far:
        settings = " ".join(f"{name}={environment[name]}" for name in far)
        click.echo(
            f"nodes communicate only on this machine: use --network to apply {settings}", err=True
        )
    for name in _ELSEWHERE:
        environment.pop(name, None)
    if environment.get(RANGE) != "OFF":  # OFF is narrower than LOCALHOST
        environment[RANGE] = "LOCALHOST"
    if _is_shipped(environment.get(PROFILE)):
        environment[PROFILE] = str(localhost_profile())


def run_node(
    node: str, parameters: Mapping[str, Any], assignments: Sequence[str], *, network: bool
) -> NoReturn:
    """Run a node in this process, then exit; ``assignments`` override ``parameters``."""
    set_reach(network)
    arguments = ros_arguments(node, assignments=[*assignments_of(parameters), *assignments])
    sys.exit(import_module(MODULES[node]).main(arguments))


def _is_shipped(profile: str | None) -> bool:
    """Return whether the Fast DDS profile is unset or shipped with this repository."""
    if not profile:
        return True
    try:
        return _SHIPPED_PROFILE in Path(profile).read_text(encoding="utf-8", errors="replace")
    except OSError:  # Fast DDS reports the error
        return False
