"""Nodes bring themselves up, survive what clients ask of them, and end when they are told to."""

import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from ema_ros.managed_node import ManagedNode, entities_of
from ema_ros.status import ERROR, OK, WARN, Task

from ..waiting import DEADLINE_S, wait_for

SUCCESS = TransitionCallbackReturn.SUCCESS


class Recorded(ManagedNode):
    """A node that notes what is asked of it, and refuses what it is told to."""

    def __init__(
        self,
        refuse: dict[str, Exception] | None = None,
        parameters: dict[str, Any] | None = None,
        *,
        context: Context,
        **kwargs: Any,
    ) -> None:
        overrides = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        super().__init__("recorded", context=context, parameter_overrides=overrides, **kwargs)
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


@contextmanager
def observed(context: Context, *nodes: Node) -> Iterator[tuple[Node, Callable[..., Any]]]:
    """Serve nodes and an observer; give the latter, and a way to wait for what it is told."""
    observer = Node("observer", context=context)
    told: dict[str, DiagnosticStatus] = {}

    def note(message: DiagnosticArray) -> None:
        told.update({status.name: status for status in message.status})

    observer.create_subscription(DiagnosticArray, "/diagnostics", note, 100)
    executor = SingleThreadedExecutor(context=context)
    for node in (*nodes, observer):
        executor.add_node(node)

    def until(found: Callable[[dict[str, DiagnosticStatus]], Any]) -> Any:
        def spun() -> Any:
            executor.spin_once(timeout_sec=0.05)
            return found(told)

        return wait_for(spun, f"what was waited for; {told}")

    try:
        yield observer, until
    finally:
        executor.shutdown()
        observer.destroy_node()


@pytest.fixture
def make_recorded(make_node: Callable[..., Recorded]) -> Callable[..., Recorded]:
    """Make a node that notes what is asked of it; of what it refuses, and parameters."""
    return partial(make_node, kind=Recorded)


def test_node_brings_itself_up_in_its_namespace(make_recorded, context: Context):
    node = make_recorded()
    assert node.bring_up()
    assert (node.state, node.steps) == ("active", ["configure", "activate"])
    assert node.get_fully_qualified_name() == "/ema/recorded"


@pytest.mark.parametrize(
    ("step", "error", "state"),
    [
        ("configure", ValueError("no such file"), "unconfigured"),
        ("configure", KeyError("no such file"), "unconfigured"),
        ("activate", OSError("no such file"), "inactive"),
        # What nobody thought of is an error: the node lets go of all that it has.
        ("activate", KeyError("no such file"), "unconfigured"),
    ],
)
def test_refusal_leaves_the_state_and_is_told_until_it_works(
    make_recorded, context: Context, step: str, error: Exception, state: str
):
    node = make_recorded({step: error})
    assert not node.bring_up()
    assert node.state == state
    with observed(context, node) as (_, until):
        status = until(lambda told: told.get("/ema/recorded: lifecycle"))
        assert status.level[0] == ERROR
        assert all(part in status.message for part in (state, f"cannot {step}", "no such file"))
        node.refuse.clear()
        assert node.trigger_configure() == SUCCESS if state == "unconfigured" else True
        assert node.trigger_activate() == SUCCESS
        until(lambda told: told["/ema/recorded: lifecycle"].message == "active")


def test_status_is_told_in_every_state(make_recorded, context: Context):
    node = make_recorded()
    with observed(context, node) as (_, until):
        for trigger, state, level in (
            (lambda: SUCCESS, "unconfigured", WARN),
            (node.trigger_configure, "inactive", WARN),
            (node.trigger_activate, "active", OK),
            (node.trigger_deactivate, "inactive", WARN),
            (node.trigger_cleanup, "unconfigured", WARN),
        ):
            assert trigger() == SUCCESS
            until(
                lambda told, state=state: (
                    "/ema/recorded: lifecycle" in told
                    and told["/ema/recorded: lifecycle"].message == state
                )
            )
            status = until(lambda told: told.get("/ema/recorded: lifecycle"))
            assert (status.level[0], status.hardware_id) == (level, "/ema/recorded")
            if state == "active":
                work = until(lambda told: told.get("/ema/recorded: work"))
                assert (work.level[0], work.message, work.hardware_id) == (OK, "at it", "unit 7")
                values = {item.key: item.value for item in work.values}
                assert values == {
                    **{"lag [s]": "0.25", "count": "3"},
                    **{"fault_code": "EMA_RECORDED_WORK", "ne107": "NORMAL"},
                }


def test_transition_that_is_impossible_is_refused_and_the_node_lives(
    make_recorded, context: Context
):
    node = make_recorded()
    assert node.bring_up()
    with observed(context, node) as (observer, until):
        client = observer.create_client(ChangeState, "/ema/recorded/change_state")
        until(lambda _: client.service_is_ready())

        def change(number: int) -> bool:
            request = ChangeState.Request(transition=Transition(id=number))
            future = client.call_async(request)
            until(lambda _: future.done())
            answer = future.result()
            return answer is not None and answer.success

        assert not change(Transition.TRANSITION_CONFIGURE)
        assert not change(200)
        assert change(Transition.TRANSITION_DEACTIVATE)
        assert not change(Transition.TRANSITION_DEACTIVATE)
        assert change(Transition.TRANSITION_CLEANUP)
        assert not change(Transition.TRANSITION_ACTIVATE)
        node.refuse["configure"] = ValueError("not now")
        assert not change(Transition.TRANSITION_CONFIGURE)
        node.refuse.clear()
        assert change(Transition.TRANSITION_CONFIGURE)
        assert change(Transition.TRANSITION_INACTIVE_SHUTDOWN)
        assert node.finished.is_set()
        assert not change(Transition.TRANSITION_CONFIGURE)
    assert node.steps == [
        *("configure", "activate", "deactivate", "clean_up", "configure", "clean_up")
    ]


@pytest.mark.parametrize("step", ["deactivate", "clean_up"])
def test_error_at_the_end_lets_go_of_all_and_the_node_can_begin_anew(make_recorded, step: str):
    node = make_recorded()
    before = len(entities_of(node))
    assert node.bring_up()
    node.add_publisher(DiagnosticArray, "left_over", QoSProfile(depth=1))
    node.refuse[step] = OSError("stuck")
    failing = {"deactivate": node.trigger_deactivate, "clean_up": node.trigger_cleanup}
    if step == "clean_up":
        assert node.trigger_deactivate() == SUCCESS
    assert failing[step]() == TransitionCallbackReturn.ERROR
    assert (node.state, len(entities_of(node))) == ("unconfigured", before)
    node.refuse.clear()
    assert node.bring_up()
    assert node.state == "active"


def test_refused_configuration_leaves_nothing_behind(make_recorded):
    node = make_recorded()
    before = len(entities_of(node))
    node.made = lambda: (
        node.create_timer(1.0, lambda: None),
        node.create_subscription(DiagnosticArray, "in", lambda _: None, 1),
        node.create_service(ChangeState, "~/own", lambda _, answer: answer),
        node.create_guard_condition(lambda: None),
        node.add_publisher(DiagnosticArray, "out", QoSProfile(depth=1)),
    )
    node.refuse["configure"] = ValueError("not now")
    assert not node.bring_up()
    assert len(entities_of(node)) == before


def test_node_without_autostart_waits_for_its_manager(make_recorded):
    node = make_recorded(parameters={"autostart": False})
    assert node.bring_up()
    assert (node.state, node.steps) == ("unconfigured", [])
    assert node.trigger_configure() == SUCCESS
    assert node.state == "inactive"


def test_each_transition_has_a_line_in_the_log(make_recorded, capfd):
    node = make_recorded()
    assert node.bring_up()
    for trigger in (node.trigger_deactivate, node.trigger_cleanup, node.trigger_shutdown):
        assert trigger() == SUCCESS
    lines = capfd.readouterr().err.splitlines()
    told = [line.rpartition(": ")[2] for line in lines if "[ema.recorded]" in line]
    assert told == ["configured", "active", "inactive", "unconfigured", "finalized"]


def test_signal_ends_a_node_in_each_state():
    script = Path(__file__).with_name("lifecycle_process.py")
    command = [sys.executable, "-m", "tests.ros.lifecycle_process"]
    states = {"unconfigured": [], "inactive": ["clean_up"], "active": ["deactivate", "clean_up"]}
    processes = {
        state: subprocess.Popen(
            [*command, state], stdout=subprocess.PIPE, text=True, cwd=script.parents[2]
        )
        for state in states
    }
    for state, ends_with in states.items():
        process = processes[state]
        with process, contextlib.ExitStack() as killed:
            killed.callback(process.kill)
            assert process.stdout is not None
            assert process.stdout.readline().strip() == state
            process.send_signal(signal.SIGTERM)
            assert process.stdout.read().split() == ends_with
            assert process.wait(DEADLINE_S) == 0


def test_parameter_of_another_name_is_told_with_the_one_that_may_be_meant(make_recorded, capfd):
    node = make_recorded(parameters={"use_sim_tme": True, "colour": "red"})
    assert node.bring_up()
    told = capfd.readouterr().err
    assert "use_sim_tme is not one of this node and has no effect: is use_sim_time meant?" in told
    assert "colour is not one of this node" in told


def test_status_has_the_time_of_the_machine_as_long_as_there_is_no_clock(
    make_recorded, context: Context
):
    node = make_recorded(parameters={"use_sim_time": True})
    observer, seen = Node("observer", context=context), list[DiagnosticArray]()
    observer.create_subscription(DiagnosticArray, "/diagnostics", seen.append, 100)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(observer)

    def told() -> bool:
        node.report()
        executor.spin_once(timeout_sec=0.05)
        return bool(seen)

    try:
        wait_for(told, "the status")
    finally:
        executor.shutdown()
        observer.destroy_node()
    assert abs(seen[0].header.stamp.sec - time.time()) < 60.0


def test_unit_has_one_name_in_every_namespace_that_its_telemetry_is_remapped_from(make_recorded):
    remapped = ["--ros-args", "-r", "__ns:=/ema/flap", "-r", "telemetry:=/ema/telemetry"]
    nodes = [make_recorded(cli_args=remapped), make_recorded()]
    assert [node.unit_namespace for node in nodes] == ["/ema", "/ema"]
