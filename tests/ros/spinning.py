"""Contexts, nodes and executors in the process of the test, each destroyed when it is over."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.publisher import Publisher

from ema_ros.executor import NodeExecutor
from ema_ros.managed_node import ManagedNode

from ..waiting import wait_for


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

    def close(self) -> None:
        for node in self.nodes:
            if isinstance(node, ManagedNode) and node.state in ("active", "inactive"):
                node.trigger_shutdown()
        self._open.close()
        for node in self.nodes:
            end(node)
