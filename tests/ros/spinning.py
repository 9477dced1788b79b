"""Nodes in the process of the test, served by the executor that they have in their own."""

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from ema_nodes.executor import NodeExecutor
from ema_nodes.managed_node import ManagedNode

from .graph import fail


def wait_for(condition: Callable[[], Any], what: str, deadline_s: float = 20.0) -> None:
    """Wait until a condition holds."""
    end_s = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end_s, f"not within {deadline_s} s: {what}"
        time.sleep(0.01)


class Spinning:
    """Nodes of a test, and the executor that serves them."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = NodeExecutor(fail, context=self.context)
        self.nodes: list[Node] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

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
        self._stop.set()
        self._thread.join()
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        rclpy.shutdown(context=self.context)

    def _spin(self) -> None:
        while not self._stop.is_set():
            # What is destroyed while the executor looks at it raises, and is of no concern.
            with contextlib.suppress(InvalidHandle):
                self.executor.spin_once(timeout_sec=0.1)
