# SPDX-License-Identifier: Apache-2.0
"""Nodes start by themselves, survive the requests of clients, and end on request."""

import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from ema_core.quantity import Checked, quantity
from ema_ros.managed_node import ManagedNode, entities_of
from ema_ros.node_parameters import declare
from ema_ros.status import ERROR, OK, STALE, WARN, Task

from ..waiting import DEADLINE_S, started, wait_for
from .spinning import Spinning

SUCCESS = TransitionCallbackReturn.SUCCESS


class Recorded(ManagedNode):
    """A node that records its lifecycle steps; ``refuse`` has the exceptions of failing steps."""

    def __init__(
        self,
        refuse: dict[str, Exception] | None = None,
        parameters: dict[str, Any] | None = None,
        *,
        context: Context,
        **kwargs: Any,
    ) -> None:
        overrides = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        more = {"namespace": "/ema", "parameter_overrides": overrides, **kwargs}
        super().__init__("recorded", context=context, **more)
        self.steps: list[str] = []
        self.refuse = refuse or {}
        self.made: Callable[[], Any] = lambda: None

    def _step(self, name: str) -> None:
        if name in self.refuse:
            raise self.refuse[name]
        self.steps.append(name)

    def configure(self) -> None:
        self.made()
        self._step("configure")

    def activate(self) -> None:
        self._step("activate")

    def deactivate(self) -> None:
        self._step("deactivate")

    def clean_up(self) -> None:
        self._step("clean_up")

    def tasks(self) -> list[Task]:
        return [Task("work", OK, "at it", "unit 7", {"lag [s]": 0.25, "count": 3})]


@pytest.fixture
def make_recorded(make_node: Callable[..., Recorded]) -> Callable[..., Recorded]:
    """Return a function that makes a ``Recorded`` node."""
    return partial(make_node, kind=Recorded)


@pytest.mark.parametrize(
    ("step", "error", "state"),
    [
        ("configure", ValueError("no such file"), "unconfigured"),
        ("configure", KeyError("no such file"), "unconfigured"),
        ("activate", OSError("no such file"), "inactive"),
        # An unexpected exception is an error: the node releases everything.
        ("activate", KeyError("no such file"), "unconfigured"),
    ],
)
def test_refusal_leaves_the_state_and_is_reported_until_it_works(
    graph: Spinning, step: str, error: Exception, state: str
):
    node, reported = graph.add(Recorded({step: error}, context=graph.context)), graph.statuses()
    assert not node.bring_up()
    assert node.state == state

    def reported_refusal() -> Any:
        """Return the status of the refusal; earlier states may be published first."""
        status = reported.get("/ema/recorded: lifecycle")
        words = state, f"cannot {step}", "no such file"
        return status if status and all(part in status.message for part in words) else None

    assert wait_for(reported_refusal, "the refusal in the status").level[0] == ERROR
    node.refuse.clear()
    assert node.trigger_configure() == SUCCESS if state == "unconfigured" else True
    assert node.trigger_activate() == SUCCESS
    wait_for(lambda: reported["/ema/recorded: lifecycle"].message == "active", "the end of it")


def test_status_is_reported_in_every_state(graph: Spinning):
    node, reported = graph.add(Recorded(context=graph.context)), graph.statuses()

    def until(task: str, condition: Callable[[DiagnosticStatus], bool]) -> DiagnosticStatus:
        def found() -> DiagnosticStatus | None:
            status = reported.get(f"/ema/recorded: {task}")
            return status if status and condition(status) else None

        return wait_for(found, f"the status of {task}: {reported}")

    for trigger, state, level in (
        (lambda: SUCCESS, "unconfigured", WARN),
        (node.trigger_configure, "inactive", WARN),
        (node.trigger_activate, "active", OK),
        (node.trigger_deactivate, "inactive", WARN),
        (node.trigger_cleanup, "unconfigured", WARN),
    ):
        assert trigger() == SUCCESS
        status = until("lifecycle", lambda item, state=state: item.message == state)
        assert (status.level[0], status.hardware_id) == (level, "/ema/recorded")
        of_peers = OK if state == "active" else STALE
        until("peers", lambda item, level=of_peers: item.level[0] == level)
        if state == "inactive":
            until("work", lambda item: (item.level[0], item.message) == (STALE, "inactive: at it"))
        if state == "active":
            work = until("work", lambda item: item.level[0] == OK)
            assert (work.message, work.hardware_id) == ("at it", "unit 7")
            assert {item.key: item.value for item in work.values} == {
                **{"lag [s]": "0.25", "count": "3"},
                **{"fault_code": "EMA_RECORDED_WORK", "ne107": "NORMAL"},
            }


@dataclass(frozen=True)
class Limits(Checked):
    """Settings that `configure` reads."""

    share: float = quantity(0.2, "-", 0.0, 1.0, "share of a limit")


def test_parameter_that_changed_since_configure_is_reported_while_active(graph: Spinning):
    node, reported = graph.add(Recorded(context=graph.context)), graph.statuses()
    declare(node, Limits, "limits.")

    def set_share(share: float) -> None:
        [result] = node.set_parameters([Parameter("limits.share", value=share)])
        assert result.successful

    def wait_for_status(level: int, words: str) -> None:
        def is_reported() -> bool:
            status = reported.get("/ema/recorded: lifecycle")
            return status is not None and (status.level[0], status.message) == (level, words)

        wait_for(is_reported, f"{words}: {reported}")

    assert node.trigger_configure() == SUCCESS
    set_share(0.3)
    assert node.trigger_activate() == SUCCESS
    remedy = "deactivate, clean up, configure and activate"
    changed = "limits.share has changed since the node was configured, without effect"
    wait_for_status(WARN, f"active: {changed}: {remedy}")
    assert node.trigger_deactivate() == SUCCESS
    set_share(0.2)
    assert node.trigger_activate() == SUCCESS
    wait_for_status(OK, "active")
    assert node.trigger_deactivate() == SUCCESS
    set_share(0.3)
    for trigger in (node.trigger_cleanup, node.trigger_configure, node.trigger_activate):
        assert trigger() == SUCCESS
    wait_for_status(OK, "active")


@pytest.mark.parametrize("step", ["configure", "deactivate", "clean_up"])
def test_failed_step_releases_everything_and_the_node_can_restart(make_recorded, step: str):
    node = make_recorded()
    before = len(entities_of(node))
    node.made = lambda: (
        node.create_timer(1.0, lambda: None),
        node.create_subscription(DiagnosticArray, "in", lambda _: None, 1),
        node.create_service(ChangeState, "~/own", lambda _, answer: answer),
        node.create_client(ChangeState, "other"),
        node.create_guard_condition(lambda: None),
        node.add_publisher(DiagnosticArray, "out", QoSProfile(depth=1)),
    )
    node.refuse[step] = ValueError("stuck")
    triggers = (
        *(node.trigger_configure, node.trigger_activate),
        *(node.trigger_deactivate, node.trigger_cleanup),
    )
    answer = next(code for trigger in triggers if (code := trigger()) != SUCCESS)
    codes = TransitionCallbackReturn
    assert answer == (codes.FAILURE if step == "configure" else codes.ERROR)
    assert (node.state, len(entities_of(node))) == ("unconfigured", before)
    node.refuse.clear()
    assert node.bring_up()
    assert node.state == "active"


def test_each_transition_has_a_line_in_the_log(make_recorded, capfd):
    node = make_recorded()
    assert node.bring_up()
    for trigger in (node.trigger_deactivate, node.trigger_cleanup, node.trigger_shutdown):
        assert trigger() == SUCCESS
    lines = capfd.readouterr().err.splitlines()
    reported = [line.rpartition(": ")[2] for line in lines if "[ema.recorded]" in line]
    assert reported == ["configured", "active", "inactive", "unconfigured", "finalized"]


NAMED = """
import sys
import time
from ema_ros.managed_node import ManagedNode
from ema_ros.run import run

class Named(ManagedNode):
    def bring_up(self):
        steps = {"unconfigured": 0, "inactive": 1, "active": 2}[sys.argv[1]]
        for trigger in (self.trigger_configure, self.trigger_activate)[:steps]:
            trigger()
        print(self.state, flush=True)
        return True

    def deactivate(self):
        print("deactivate", flush=True)

    def clean_up(self):
        time.sleep(float(sys.argv[2]) if sys.argv[2:] else 0.0)
        print("clean_up", flush=True)

sys.exit(run(lambda: Named("named"), sys.argv[:1]))
"""


def test_signal_ends_a_node_in_each_state():
    states = {"unconfigured": [], "inactive": ["clean_up"], "active": ["deactivate", "clean_up"]}
    with contextlib.ExitStack() as opened:
        processes = {
            state: opened.enter_context(
                started([sys.executable, "-c", NAMED, state], stdout=subprocess.PIPE, text=True)
            )
            for state in states
        }
        for state, ends_with in states.items():
            process = processes[state]
            assert process.stdout is not None
            assert process.stdout.readline().strip() == state
            process.send_signal(signal.SIGTERM)
            assert process.stdout.read().split() == ends_with
            assert process.wait(DEADLINE_S) == 0


def test_shutdown_by_another_node_ends_the_process_in_each_state(graph: Spinning):
    """The answer arrives even if the node takes long to clean up, as for ``ros2 lifecycle set``."""
    shutdown = {"unconfigured": 5, "inactive": 6, "active": 7}
    for state, number in shutdown.items():
        command = [sys.executable, "-c", NAMED, state, "1.5"]
        with started(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stdout.readline().strip() == state
            transition = Transition(id=number)
            answer = graph.call(ChangeState, "/named/change_state", transition=transition)
            assert answer.success
            assert process.wait(DEADLINE_S) == 0


def test_unknown_parameter_is_reported_with_a_similar_name(make_recorded, capfd):
    node = make_recorded(parameters={"use_sim_tme": True, "use_time": "red"})
    assert node.bring_up()
    reported = capfd.readouterr().err
    assert (
        "use_sim_tme is not declared by this node and has no effect: did you mean use_sim_time?"
        in reported
    )
    assert "use_time is not declared by this node and has no effect\n" in reported


def test_status_has_the_time_of_the_machine_without_a_clock(graph: Spinning):
    node = graph.add(Recorded(parameters={"use_sim_time": True}, context=graph.context))
    seen = graph.listen(DiagnosticArray, "/diagnostics", QoSProfile(depth=100))
    wait_for(lambda: node.report() or seen, "the status")
    assert abs(seen[0].header.stamp.sec - time.time()) < 60.0


def test_namespace_of_a_node_is_the_root_by_default(make_node):
    node = make_node(kind=Recorded, namespace=None)
    assert node.get_fully_qualified_name() == "/recorded"
    node = make_node(kind=Recorded, cli_args=["--ros-args", "-r", "__ns:=/left"])
    assert node.get_fully_qualified_name() == "/left/recorded"


def test_unit_has_the_namespace_that_its_telemetry_is_remapped_to(make_recorded):
    remapped = ["--ros-args", "-r", "__ns:=/ema/flap", "-r", "telemetry:=/ema/telemetry"]
    nodes = [make_recorded(cli_args=remapped), make_recorded()]
    assert [node.unit_namespace for node in nodes] == ["/ema", "/ema"]
