# SPDX-License-Identifier: Apache-2.0
"""Contexts and nodes of the tests, destroyed at their ends."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.node import Node

from ema_ros import managed_node

from .spinning import Spinning, end, made, ros_context

# Tests wait for what nodes report; those of real graphs have their second.
managed_node._REPORT_S = 0.2  # pyright: ignore[reportPrivateUsage, reportConstantRedefinition]


@pytest.fixture
def context() -> Iterator[Context]:
    """A context in the domain of this process."""
    with ros_context() as context:
        yield context


@pytest.fixture
def graph(context: Context) -> Iterator[Spinning]:
    """Nodes of a test, and what serves them."""
    graph = Spinning(context)
    yield graph
    graph.close()


@pytest.fixture
def make_node(context: Context) -> Iterator[Callable[..., Any]]:
    """Make nodes: of a name and further arguments, or of another class (``kind=``)."""
    with ExitStack() as nodes:

        def make(*arguments: Any, kind: type[Node] = Node, **more: Any) -> Any:
            node = made(kind, *arguments, context=context, **more)
            nodes.callback(end, node)
            return node

        yield make
