# SPDX-License-Identifier: Apache-2.0
"""Nodes started by commands are reachable only on this machine, unless ``--network`` is given."""

import os
import signal
from pathlib import Path

import pytest

from ema_cli.processes.reach import PROFILE, RANGE, set_reach
from ema_core.domains import Domain

from ..waiting import DEADLINE_S, started, wait_for

PROFILES = Path(__file__).parents[2] / "tools" / "fastdds.xml"
LOOPBACK = "127.0.0.1"


def ports_of(domain: int) -> dict[int, set[str]]:
    """Return the open UDP ports of a DDS domain, with the addresses to which they are bound."""
    first = 7400 + 250 * domain
    ports: dict[int, set[str]] = {}
    for line in Path("/proc/net/udp").read_text(encoding="utf-8").splitlines()[1:]:
        number, _, port = line.split()[1].partition(":")
        if first <= int(port, 16) < first + 250:
            address = ".".join(str(byte) for byte in reversed(bytes.fromhex(number)))
            ports.setdefault(int(port, 16), set()).add(address)
    return ports


@pytest.mark.slow
def test_ports_are_open_on_loopback_alone():
    domain = Domain()
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain.number),
        # Each of these variables would make the nodes reachable from other machines.
        RANGE: "SUBNET",
        "ROS_STATIC_PEERS": "192.0.2.1",
        PROFILE: str(PROFILES),
    }
    command = ["ema", "up", "monitor", "-p", "history_folder:=memory"]
    with started(command, env=environment) as process:
        # One port for discovery and one for data; multicast discovery would open a third.
        seen = wait_for(
            lambda: (ports := ports_of(domain.number)) and len(ports) >= 2 and ports,
            "a participant in the domain",
        )
        process.send_signal(signal.SIGINT)
        process.wait(DEADLINE_S)
    domain.close()
    assert all(addresses == {LOOPBACK} for addresses in seen.values()), seen


def test_variables_that_open_the_network_are_removed_and_reported(capsys):
    environment = {
        RANGE: "SUBNET",
        "ROS_STATIC_PEERS": "192.0.2.1",
        "ROS_DISCOVERY_SERVER": "192.0.2.2:11811",
    }
    set_reach(False, environment)
    assert environment.pop(PROFILE).endswith("fastdds_localhost.xml")
    assert environment == {RANGE: "LOCALHOST"}
    reported = capsys.readouterr().err
    assert reported.count("\n") == 1
    for part in ("--network", "=SUBNET", "=192.0.2.1", "=192.0.2.2:11811"):
        assert part in reported


@pytest.mark.parametrize(
    ("variables", "reach"),
    [
        ({}, "LOCALHOST"),
        ({RANGE: "LOCALHOST"}, "LOCALHOST"),
        ({"ROS_STATIC_PEERS": ""}, "LOCALHOST"),
        ({RANGE: "OFF"}, "OFF"),
    ],
)
def test_nothing_is_reported_if_no_variable_is_removed(variables, reach, capsys):
    environment = dict(variables)
    set_reach(False, environment)
    assert environment[RANGE] == reach
    assert not capsys.readouterr().err


def test_profile_of_the_user_is_kept(tmp_path):
    profile = tmp_path / "own.xml"
    profile.write_text(PROFILES.read_text().replace("quick_discovery", "own"))
    environment = {PROFILE: str(profile)}
    set_reach(False, environment)
    assert environment[PROFILE] == str(profile)


@pytest.mark.parametrize("variables", [{}, {RANGE: "SUBNET", "ROS_STATIC_PEERS": "192.0.2.1"}])
def test_network_option_keeps_the_variables_of_ros(variables):
    environment = {**variables, PROFILE: str(PROFILES)}
    set_reach(True, environment)
    assert environment == {**variables, PROFILE: str(PROFILES)}


@pytest.mark.parametrize(
    "variables", [{RANGE: "LOCALHOST"}, {RANGE: "OFF"}, {"ROS_LOCALHOST_ONLY": "1"}]
)
def test_network_forbidden_by_the_variables_is_refused(variables):
    [(name, value)] = variables.items()
    with pytest.raises(ValueError, match=rf"--network: {name}={value} .*{RANGE}=SUBNET"):
        set_reach(True, dict(variables))
