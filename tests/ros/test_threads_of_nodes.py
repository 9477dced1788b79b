# SPDX-License-Identifier: Apache-2.0
"""If a thread of a node ends by itself, the status is ERROR and the thread is restarted."""

import threading
import urllib.request
from collections.abc import Callable
from typing import Any

import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from ema_bags.reader import Bag
from ema_bags.recorder_node import RecorderNode
from ema_bags.writer import BagWriter
from ema_core import steady_thread
from ema_dashboard.dashboard_node import DashboardNode
from ema_monitor.node.monitor_node import MonitorNode
from ema_monitor.node.work.follow_ups import FollowUps
from ema_ros import run as running
from ema_ros.executor import NodeExecutor
from ema_ros.managed_node import ManagedNode
from ema_ros.status import ERROR, OK, Task
from ema_sim.actuator_node import ActuatorNode
from ema_sim.bench import ActuatorBench

from ..waiting import DEADLINE_S, wait_for
from .spinning import Spinning, made, wait_for_match


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steady_thread, "_FIRST_WAIT_S", 0.05)
    monkeypatch.setattr(steady_thread, "_SETTLED_S", 0.2)


def up(graph: Spinning, kind: type[ManagedNode], **parameters: Any) -> Any:
    node = graph.managed(kind, **parameters)
    assert node.bring_up()
    return node


def fails_once(monkeypatch: pytest.MonkeyPatch, kind: type, method: str) -> Callable[[], None]:
    """Patch a method. Return a function that makes the next call of the method raise."""
    usual, due = getattr(kind, method), threading.Event()

    def fail_if_due(self: Any, *arguments: Any) -> Any:
        if due.is_set():
            due.clear()
            raise ZeroDivisionError("made up")
        return usual(self, *arguments)

    monkeypatch.setattr(kind, method, fail_if_due)
    return due.set


def task(node: ManagedNode, name: str) -> Task:
    return next(item for item in node.tasks() if item.name == name)


def wait_for_restart(node: ManagedNode, name: str, reason: str) -> None:
    def ends() -> int:
        return int(task(node, name).values["ends of threads"])

    wait_for(ends, f"the end of a thread of {name}")
    wait_for(lambda: task(node, name).level != ERROR, "the end of the error")
    assert ends() == 1


def reported(capfd: pytest.CaptureFixture[str], reason: str) -> bool:
    return reason in "".join(capfd.readouterr())


def test_recorder_continues_flushing_after_its_thread_ended(graph, tmp_path, monkeypatch, capfd):
    fail = fails_once(monkeypatch, BagWriter, "flush")
    publisher = graph.node().create_publisher(String, "text", QoSProfile(depth=10))
    node = up(graph, RecorderNode, output=str(tmp_path / "flight"), topics=["text"], flush_s=0.05)
    wait_for_match(node, publisher)
    fail()
    wait_for_restart(node, "recording", "made up")
    publisher.publish(String(data="after"))
    wait_for(lambda: len(list(Bag(tmp_path / "flight").raw_messages())) == 1, "the message on disk")
    assert reported(capfd, "the bag flusher thread has ended: ZeroDivisionError('made up')")


def test_simulation_begins_a_new_cycle_after_its_thread_ended(graph, monkeypatch, capfd):
    fail = fails_once(monkeypatch, ActuatorBench, "begin_cycle")
    fail()
    node = up(graph, ActuatorNode, **{"command.shape": "step", "command.duration": 0.02})
    wait_for_restart(node, "simulation", "made up")
    # A busy machine may not keep up.
    assert task(node, "simulation").message.startswith(("running", "cannot keep up"))
    assert node.exit_code == 0
    assert reported(capfd, "the simulation thread has ended: ZeroDivisionError('made up')")


def test_dashboard_serves_again_after_its_thread_ended(graph, capfd):
    node = up(graph, DashboardNode, port=0)
    node._web._loop.call_soon_threadsafe(node._web._loop.stop)
    wait_for_restart(node, "dashboard", "it returned")
    with urllib.request.urlopen(node.address, timeout=DEADLINE_S) as answer:
        assert answer.status == 200
    assert reported(capfd, "the dashboard thread has ended: it returned")


def test_follow_ups_continue_after_their_thread_ended(graph, monkeypatch, capfd):
    fail = fails_once(monkeypatch, FollowUps, "_next")
    fail()
    node = up(graph, MonitorNode, history_folder="")
    wait_for_restart(node, "identification", "made up")
    assert task(node, "identification").level == OK
    assert reported(capfd, "the follow-ups thread has ended: ZeroDivisionError('made up')")


def test_failure_of_the_executor_does_not_end_the_node(context, monkeypatch, capfd):
    fail = fails_once(monkeypatch, NodeExecutor, "spin_once")
    node = made(ManagedNode, "plain", context=context)
    try:
        executor = NodeExecutor(node.log_failure, context=context)
        executor.add_node(node)
        fail()
        thread = threading.Thread(target=running._spin, args=(executor, node))
        thread.start()
        wait_for(lambda: node.failed_callbacks, "the failure")
        assert thread.is_alive()
        assert node._lifecycle_task().values == {"failed callbacks": node.failed_callbacks}
        node.stopping.set()
        thread.join()
        executor.shutdown()
    finally:
        node.destroy_node()
    assert reported(capfd, "a callback failed:\nTraceback")


def test_failures_of_a_kind_are_logged_once_and_counted(context, capfd):
    node = made(ManagedNode, "plain", context=context)

    def fail(number: int) -> None:
        raise ValueError(f"index {number}")

    try:
        for number in range(100):
            try:
                fail(number)
            except ValueError as error:
                node.log_failure(error)
        assert node.failed_callbacks == 100
    finally:
        node.destroy_node()
    assert "".join(capfd.readouterr()).count("Traceback") == 1
