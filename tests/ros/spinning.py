# SPDX-License-Identifier: Apache-2.0
"""Contexts, nodes and executors in the process of the test, each destroyed when it is over."""

import contextlib
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from ema_ros.executor import NodeExecutor
from ema_ros.managed_node import ManagedNode
from ema_ros.topics import NAMESPACE

from ..waiting import DEADLINE_S, wait_for


def fail(error: Exception) -> None:
    """Let a test fail by what a callback raised in a thread."""
    raise error


def figures(status: DiagnosticStatus) -> dict[str, float]:
    """Return the figures in a status, without its codes."""
    codes = ("fault_code", "ne107")
    return {item.key: float(item.value) for item in status.values if item.key not in codes}


@contextlib.contextmanager
def ros_context(
    domain_id: int | None = None, arguments: list[str] | None = None
) -> Iterator[Context]:
    """A context in a domain, that of this process unless another one is given."""
    context = Context()
    context.init(arguments, domain_id=domain_id)
    try:
        yield context
    finally:
        context.try_shutdown()


@contextlib.contextmanager
def spinning(executor: Executor, *nodes: Node) -> Iterator[None]:
    """Serve nodes in a thread; afterwards both the thread and the executor have ended."""
    for node in nodes:
        executor.add_node(node)
    ending = threading.Event()

    def spin() -> None:
        while not ending.is_set():
            # What is destroyed while the executor looks at it raises, and is of no concern.
            with contextlib.suppress(InvalidHandle):
                executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()
        executor.shutdown()


def where_it_spins(node: Node, call: Callable[[], Any]) -> Any:
    """Call something in the thread that serves a node, and return what it returned.

    rclpy's client of an action sends a request before it notes that it waits for the answer: in
    another thread, an answer that comes between is dropped, and never comes again.
    """
    assert node.executor is not None
    task = node.executor.create_task(call)
    wait_for(task.done, "the executor of the node")
    return task.result()


def wait_for_match(node: Node, *publishers: Publisher) -> None:
    """Wait until publishers and the subscriptions of a node know of each other.

    A subscription learns of its match after the publisher; until then it loses what is not latched.
    """
    names = [item.topic_name for item in publishers]

    def is_matched() -> bool:
        return all(item.get_subscription_count() for item in publishers) and all(
            item.get_publisher_count() >= names.count(item.topic_name)
            for item in node.subscriptions
        )

    wait_for(is_matched, f"the subscriptions of {names}")


def made(kind: type[Any], *arguments: Any, **more: Any) -> Any:
    """Return a new node; one that refuses what it is given is destroyed before that is told."""
    node = object.__new__(kind)
    try:
        node.__init__(*arguments, **more)
    except ValueError:
        node.destroy_node()
        raise
    return node


def end(node: Node) -> None:
    """Stop what a node does, if it has a lifecycle, and destroy it."""
    if isinstance(node, ManagedNode):
        node.stopping.set()
        if node.state in ("active", "inactive"):
            node.trigger_shutdown()
    node.destroy_node()


class Probe:
    """A node beside the one that is tested: what it hears of it, and what it asks of it."""

    def __init__(self, context: Context, node: Any) -> None:
        self.node = node
        self._name = node.get_fully_qualified_name()
        self.failures: list[BaseException] = []
        self._received: defaultdict[str, list[Any]] = defaultdict(list)
        self._changed = threading.Condition()
        self.probe = Node("probe", context=context, namespace="/ema")
        self.subscribe(DiagnosticArray, "/diagnostics", 100)

    def close(self) -> None:
        """Do what is to be done between the end of all service and that of the nodes."""

    def fail(self, error: BaseException) -> None:
        """Note what a callback of the node raised, for `until` to report."""
        with self._changed:
            self.failures.append(error)
            self._changed.notify_all()

    def subscribe(
        self, message_class: Any, topic: str, qos: QoSProfile | int, key: str = ""
    ) -> None:
        def keep(message: Any) -> None:
            with self._changed:
                self._received[key or topic].append(message)
                self._changed.notify_all()

        self.probe.create_subscription(message_class, topic, keep, qos)

    def received(self, key: str) -> list[Any]:
        with self._changed:
            return list(self._received[key])

    def until(self, condition: Callable[[], Any], timeout_s: float = DEADLINE_S) -> Any:
        """Wait for what must come, and return it; no callback may have failed meanwhile."""
        with self._changed:
            found = self._changed.wait_for(lambda: condition() or self.failures, timeout_s)
        failures, self.failures = self.failures, []
        assert not failures, failures
        assert found, "what was waited for did not come"
        return condition()

    def statuses(self, task: str) -> list[DiagnosticStatus]:
        """What has been reported of a task so far, the latest last."""
        return [
            status
            for array in self.received("/diagnostics")
            for status in array.status
            if status.name == f"{self._name}: {task}"
        ]

    def until_status(
        self, task: str, text: str, level: bytes | None = None, *, since: int = 0
    ) -> DiagnosticStatus:
        """Wait until a status says something."""

        def matching() -> list[DiagnosticStatus]:
            return [
                item
                for item in self.statuses(task)[since:]
                if text in item.message and level in (None, item.level)
            ]

        try:
            return self.until(matching)[-1]
        except AssertionError as error:
            seen = sorted({item.message for item in self.statuses(task)[since:]})
            raise AssertionError(f"{task}: {text!r} is not among {seen}; {error}") from error

    def call(self, service: Any, name: str, request: Any, timeout_s: float = DEADLINE_S) -> Any:
        return self.result(self.start(service, name, request), timeout_s)

    def start(self, service: Any, name: str, request: Any) -> Any:
        client = self.probe.create_client(service, name)
        wait_for(client.service_is_ready, f"service {name}")
        return client.call_async(request)

    def result(self, future: Any, timeout_s: float = DEADLINE_S) -> Any:
        wait_for(future.done, "the answer", timeout_s)
        return future.result()


P = TypeVar("P", bound=Probe)


@contextlib.contextmanager
def probed(
    kind: type[ManagedNode],
    make_probe: Callable[[Context, Any], P],
    parameters: dict[str, Any],
    domain_id: int | None = None,
) -> Iterator[P]:
    """A node with parameters and a probe beside it, each served in a thread of its own."""
    with contextlib.ExitStack() as opened:
        context = opened.enter_context(ros_context(domain_id))
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = made(kind, context=context, namespace=NAMESPACE, parameter_overrides=overrides)
        opened.callback(end, node)
        probe = make_probe(context, node)
        opened.callback(end, probe.probe)
        opened.callback(probe.close)
        opened.enter_context(spinning(NodeExecutor(probe.fail, context=context), node))
        opened.enter_context(spinning(SingleThreadedExecutor(context=context), probe.probe))
        # Calls that wait have to return before the executors are shut down.
        opened.callback(node.stopping.set)
        yield probe


class Spinning:
    """Nodes of a test, and the executor that serves them."""

    def __init__(self, context: Context) -> None:
        self.context = context
        self.executor = NodeExecutor(fail, context=context)
        self.nodes: list[Node] = []
        self._open = contextlib.ExitStack()
        self._open.enter_context(spinning(self.executor))

    def node(self, name: str = "source", namespace: str = "/ema") -> Node:
        return self.add(Node(name, namespace=namespace, context=self.context))

    def add(self, node: Any) -> Any:
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def managed(self, kind: type[ManagedNode], **parameters: Any) -> Any:
        """Return a node with parameters, which is not yet brought up."""
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        return self.add(
            made(kind, context=self.context, namespace=NAMESPACE, parameter_overrides=overrides)
        )

    def listen(self, kind: type, topic: str, qos: QoSProfile) -> list[Any]:
        """Return where messages come in."""
        arrived: list[Any] = []
        self.node(f"listener_{len(self.nodes)}").create_subscription(
            kind, topic, arrived.append, qos
        )
        return arrived

    def statuses(self) -> dict[str, DiagnosticStatus]:
        """Return where the latest status of each name comes in."""
        reported: dict[str, DiagnosticStatus] = {}

        def note(message: DiagnosticArray) -> None:
            reported.update({status.name: status for status in message.status})

        self.node("observer").create_subscription(DiagnosticArray, "/diagnostics", note, 100)
        return reported

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        """Return the answer of a service."""
        client = self.node(f"client_{len(self.nodes)}").create_client(kind, name)
        wait_for(client.service_is_ready, f"service {name}")
        future = client.call_async(kind.Request(**fields))
        wait_for(future.done, f"the answer of {name}")
        return future.result()

    def close(self) -> None:
        for node in self.nodes:
            if isinstance(node, ManagedNode) and node.state in ("active", "inactive"):
                node.trigger_shutdown()
        self._open.close()
        for node in self.nodes:
            end(node)
