# SPDX-License-Identifier: Apache-2.0
"""Contexts, nodes and executors in the test process, which are destroyed after use."""

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
    """Raise an exception of a callback, so that the test fails."""
    raise error


def figures(status: DiagnosticStatus) -> dict[str, float]:
    """Return the numbers in a status by key, without its codes."""
    codes = ("fault_code", "ne107")
    return {item.key: float(item.value) for item in status.values if item.key not in codes}


@contextlib.contextmanager
def ros_context(
    domain_id: int | None = None, arguments: list[str] | None = None
) -> Iterator[Context]:
    """Yield a ROS context in a domain, by default the domain of this process."""
    context = Context()
    context.init(arguments, domain_id=domain_id)
    try:
        yield context
    finally:
        context.try_shutdown()


@contextlib.contextmanager
def spinning(executor: Executor, *nodes: Node) -> Iterator[None]:
    """Spin nodes in a thread. On exit, stop the thread and shut the executor down."""
    for node in nodes:
        executor.add_node(node)
    ending = threading.Event()

    def spin() -> None:
        while not ending.is_set():
            # An entity that is destroyed during the call raises, which is harmless.
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
    """Call a function in the thread that spins a node, and return its result.

    The action client of rclpy sends a request before it registers that it waits for the answer. If
    another thread sends the request, an answer that arrives in between is lost.
    """
    assert node.executor is not None
    task = node.executor.create_task(call)
    wait_for(task.done, "the executor of the node")
    return task.result()


def wait_for_match(node: Node, *publishers: Publisher) -> None:
    """Wait until publishers and the subscriptions of a node are matched.

    A subscription is matched after its publisher; before, it loses messages that are not latched.
    """
    names = [item.topic_name for item in publishers]

    def is_matched() -> bool:
        return all(item.get_subscription_count() for item in publishers) and all(
            item.get_publisher_count() >= names.count(item.topic_name)
            for item in node.subscriptions
        )

    wait_for(is_matched, f"the subscriptions of {names}")


def made(kind: type[Any], *arguments: Any, **more: Any) -> Any:
    """Return a new node. If its constructor raises ValueError, destroy it before raising."""
    node = object.__new__(kind)
    try:
        node.__init__(*arguments, **more)
    except ValueError:
        node.destroy_node()
        raise
    return node


def end(node: Node) -> None:
    """Shut a node down, if it has a lifecycle, and destroy it."""
    if isinstance(node, ManagedNode):
        node.stopping.set()
        if node.state in ("active", "inactive"):
            node.trigger_shutdown()
    node.destroy_node()


class Probe:
    """A node that receives messages of the tested node and calls its services."""

    def __init__(self, context: Context, node: Any) -> None:
        self.node = node
        self._name = node.get_fully_qualified_name()
        self.failures: list[BaseException] = []
        self._received: defaultdict[str, list[Any]] = defaultdict(list)
        self._changed = threading.Condition()
        self.probe = Node("probe", context=context, namespace="/ema")
        self.subscribe(DiagnosticArray, "/diagnostics", 100)

    def close(self) -> None:
        """Clean up after all spinning has stopped and before the nodes are destroyed."""

    def fail(self, error: BaseException) -> None:
        """Record an exception of a callback of the node, which ``until`` reports."""
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
        """Wait until a condition is true, and return its value. Fail if a callback fails."""
        with self._changed:
            has_come = self._changed.wait_for(lambda: condition() or self.failures, timeout_s)
        failures, self.failures = self.failures, []
        assert not failures, failures
        assert has_come, "what was waited for did not come"
        return condition()

    def statuses(self, task: str) -> list[DiagnosticStatus]:
        """Return all statuses of a task so far, in order."""
        return [
            status
            for array in self.received("/diagnostics")
            for status in array.status
            if status.name == f"{self._name}: {task}"
        ]

    def until_status(
        self, task: str, text: str, level: bytes | None = None, *, since: int = 0
    ) -> DiagnosticStatus:
        """Wait until a task has a status with a text and, if given, a level; return it."""

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
    """Yield the probe of a new node with parameters; each is spun in a separate thread."""
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
        # Waiting calls have to return before the executors are shut down.
        opened.callback(node.stopping.set)
        yield probe


class Spinning:
    """Nodes of a test, and the executor that spins them."""

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
        """Return a new lifecycle node with parameters, not yet configured."""
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        return self.add(
            made(kind, context=self.context, namespace=NAMESPACE, parameter_overrides=overrides)
        )

    def listen(self, kind: type, topic: str, qos: QoSProfile) -> list[Any]:
        """Subscribe to a topic. Return the list to which received messages are appended."""
        arrived: list[Any] = []
        self.node(f"listener_{len(self.nodes)}").create_subscription(
            kind, topic, arrived.append, qos
        )
        return arrived

    def statuses(self) -> dict[str, DiagnosticStatus]:
        """Subscribe to /diagnostics. Return a mapping that receives the latest status by name."""
        reported: dict[str, DiagnosticStatus] = {}

        def note(message: DiagnosticArray) -> None:
            reported.update({status.name: status for status in message.status})

        self.node("observer").create_subscription(DiagnosticArray, "/diagnostics", note, 100)
        return reported

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        """Call a service and return its answer."""
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
