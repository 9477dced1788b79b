# SPDX-License-Identifier: Apache-2.0
"""A monitor counts as silent when its process ends or is paused, for any other messages."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from ema_interfaces.msg import Health, NodeStatus, PlaybackState
from ema_ros.liveliness import MonitorLiveliness
from ema_ros.topics import ALIVE, ALIVE_BY_MANY, HEALTH, LATCHED, STATE

from ..waiting import started, wait_for
from .spinning import Spinning

MONITOR = """
import sys
import rclpy
from ema_interfaces.msg import Health
from ema_ros.topics import ALIVE, HEALTH

rclpy.init()
node = rclpy.create_node(sys.argv[1], namespace="/ema")
outputs = [node.create_publisher(Health, HEALTH, ALIVE) for _ in range(2)]
print("published", flush=True)
sys.stdin.read()
"""
FIRST, SECOND = "/ema/monitor", "/ema/monitor_1"
Start = Callable[[str], subprocess.Popen[str]]


@pytest.fixture
def start() -> Iterator[Start]:
    """Return a function that starts a process with the health publishers of two actuators."""
    with ExitStack() as opened:

        def start_one(full_name: str) -> subprocess.Popen[str]:
            command = [sys.executable, "-c", MONITOR, full_name.rpartition("/")[2]]
            pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
            process = opened.enter_context(started(command, text=True, **pipes))
            assert process.stdout is not None
            assert process.stdout.readline() == "published\n"
            return process

        yield start_one


def listening(graph: Spinning) -> MonitorLiveliness:
    """Return the liveliness of the monitors, as observed by a node in this process."""
    liveliness, node = MonitorLiveliness("/ema"), graph.node("listener")
    node.create_subscription(
        Health, HEALTH, lambda _: None, ALIVE_BY_MANY, event_callbacks=liveliness.events
    )
    node.create_timer(0.05, lambda: liveliness.update(node))
    return liveliness


def until_silent(liveliness: MonitorLiveliness, *silent: str) -> None:
    def are_silent() -> bool:
        return {name for name in (FIRST, SECOND) if liveliness.is_silent(name)} == set(silent)

    wait_for(are_silent, f"the silence of {silent}")


def until_seen(liveliness: MonitorLiveliness, *names: str) -> None:
    wait_for(lambda: set(names) <= liveliness._seen, f"{names} in the graph")


@pytest.mark.slow
def test_paused_or_killed_monitor_is_silent_despite_forged_statuses(graph: Spinning, start: Start):
    liveliness = listening(graph)
    process = start(FIRST)
    until_seen(liveliness, FIRST)
    # Any node may publish a status on both topics.
    forger = graph.node("forger")
    status = forger.create_publisher(NodeStatus, "node_status", STATE)
    diagnostics = forger.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def forge() -> None:
        status.publish(NodeStatus(node=FIRST, kind=NodeStatus.MONITOR))
        diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(name=f"{FIRST}: peers")]))

    forger.create_timer(0.2, forge)
    process.send_signal(signal.SIGSTOP)
    until_silent(liveliness, FIRST, SECOND)
    process.kill()
    process = start(FIRST)
    until_silent(liveliness)
    process.kill()
    until_silent(liveliness, FIRST, SECOND)


@pytest.mark.slow
def test_only_the_killed_monitor_of_several_is_silent(graph: Spinning, start: Start):
    liveliness = listening(graph)
    first, second = start(FIRST), start(SECOND)
    until_seen(liveliness, FIRST, SECOND)
    first.kill()
    until_silent(liveliness, FIRST)
    second.kill()
    until_silent(liveliness, FIRST, SECOND)


def test_player_keeps_every_monitor_alive_while_it_plays(graph: Spinning):
    liveliness = listening(graph)
    monitor, player = graph.node("monitor"), graph.node("player")
    published = monitor.create_publisher(Health, HEALTH, ALIVE)
    played = player.create_publisher(Health, HEALTH, ALIVE)
    state = player.create_publisher(PlaybackState, "playback_state", LATCHED)
    until_seen(liveliness, FIRST, "/ema/player")
    monitor.destroy_publisher(published)
    wait_for(lambda: FIRST not in liveliness._present, "the end of the monitor")
    assert not liveliness.is_silent(FIRST)
    player.destroy_publisher(state)
    until_silent(liveliness, FIRST)
    player.destroy_publisher(played)
    until_silent(liveliness, FIRST, SECOND)
