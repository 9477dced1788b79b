"""The process of a monitor ends clean, or reports in a line why it does not start."""

import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action.client import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ema_interfaces.action import IdentifyFaults
from ema_interfaces.srv import Calibrate
from ema_ros.messages import description_to_message, telemetry_to_message
from ema_ros.topics import ACTUATOR_TOPICS, DESCRIPTION, TELEMETRY

from ..waiting import DEADLINE_S, wait_for
from .monitor_session import FLAP, Source
from .spinning import where_it_spins

MONITOR = Path(get_package_prefix("ema_monitor")) / "lib" / "ema_monitor" / "monitor_node"


@pytest.fixture
def bystander(context: Context, make_node: Callable[..., Node], spin: Callable[..., None]) -> Node:
    """Another node in the graph, spun in the background."""
    node = make_node("bystander")
    spin(SingleThreadedExecutor(context=context), node)
    return node


@contextmanager
def process(*parameters: str) -> Iterator[subprocess.Popen[str]]:
    """The monitor in a process of its own, killed in the end if need be."""
    arguments = [word for item in parameters for word in ("-p", item)]
    with subprocess.Popen(
        [MONITOR, "--ros-args", *arguments], stderr=subprocess.PIPE, text=True
    ) as started:
        try:
            yield started
        finally:
            started.kill()


def until_up(bystander: Node) -> None:
    client = bystander.create_client(Calibrate, "/ema/monitor/calibrate")
    wait_for(client.service_is_ready, "the monitor")


def ends_clean(running: subprocess.Popen[str], *numbers: signal.Signals) -> str:
    """Send signals in a row; return what was printed of an end that is clean."""
    for number in numbers:
        running.send_signal(number)
    _, printed = running.communicate(timeout=DEADLINE_S)
    assert running.returncode == 0, printed
    assert "Traceback" not in printed
    return printed


@pytest.mark.parametrize(
    "numbers",
    [(signal.SIGTERM,), (signal.SIGINT,) * 2],
)
def test_process_ends_clean_on_signals(bystander: Node, numbers: tuple[signal.Signals, ...]):
    with process() as running:
        until_up(bystander)
        assert "Error" not in ends_clean(running, *numbers)


def test_process_ends_clean_while_it_identifies_and_others_wait_for_it(bystander: Node):
    reported: dict[str, str] = {}

    def note(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "/ema/monitor: flap telemetry":
                reported.update({item.key: item.value for item in status.values})

    bystander.create_subscription(DiagnosticArray, "/diagnostics", note, 100)
    publishers = {
        name: bystander.create_publisher(message_class, f"/ema/{name}", qos)
        for name, (message_class, qos) in ACTUATOR_TOPICS.items()
    }
    publishers[DESCRIPTION].publish(description_to_message(FLAP))
    # At ten million evaluations it would take minutes.
    with process("algorithm:=pso", "budget:=10000000") as running:
        until_up(bystander)
        wait_for(lambda: reported, "the description")
        for block in Source().cycle():
            publishers[TELEMETRY].publish(telemetry_to_message(block, FLAP.actuator_id))
        wait_for(lambda: reported.get("windows") == "1", "the window")
        calibrate = bystander.create_client(Calibrate, "/ema/monitor/calibrate")
        calibrate.call_async(Calibrate.Request(windows=5))
        identify = ActionClient(bystander, IdentifyFaults, "/ema/monitor/identify_faults")
        wait_for(identify.server_is_ready, "the action")
        goals = [
            where_it_spins(
                bystander, partial(identify.send_goal_async, IdentifyFaults.Goal(next_window=later))
            )
            for later in (False, True)
        ]
        wait_for(lambda: all(goal.done() for goal in goals), "both goals")
        ends_clean(running, signal.SIGINT)
        identify.destroy()


def test_process_of_an_impossible_parameter_reports_it_in_one_line():
    with process("window_s:=1000.0") as running:
        _, printed = running.communicate(timeout=DEADLINE_S)
    assert running.returncode == 1
    [line] = printed.splitlines()
    assert all(text in line for text in ("window_s", "1000", "100", " s ")), line
