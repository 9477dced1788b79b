# SPDX-License-Identifier: Apache-2.0
"""Contexts and nodes of tests, destroyed at the end of each test."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.node import Node

from ema_ros import managed_node

from .spinning import Spinning, end, made, ros_context

# Tests wait for reports of nodes. Nodes in real graphs report once per second.
managed_node._REPORT_S = 0.2  # pyright: ignore[reportPrivateUsage, reportConstantRedefinition]


@pytest.fixture
def context() -> Iterator[Context]:
    """Return a ROS context in the domain of this process."""
    with ros_context() as context:
        yield context


@pytest.fixture
def graph(context: Context) -> Iterator[Spinning]:
    """Return the nodes of a test with their executor."""
    graph = Spinning(context)
    yield graph
    graph.close()


@pytest.fixture
def make_node(context: Context) -> Iterator[Callable[..., Any]]:
    """Return a function that makes a node; ``kind`` is its class, ``Node`` by default."""
    with ExitStack() as nodes:

        def make(*arguments: Any, kind: type[Node] = Node, **more: Any) -> Any:
            node = made(kind, *arguments, context=context, **more)
            nodes.callback(end, node)
            return node

        yield make
