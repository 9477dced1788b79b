"""A test that leaves a DDS participant or a thread behind fails."""

import threading
from collections.abc import Iterator

import pytest
from rclpy.context import Context
from rclpy.node import Node

from ema_ros.managed_node import ManagedNode

from ..leftovers import nothing_left, participants


@pytest.fixture
def context() -> Iterator[Context]:
    context = Context()
    context.init()
    yield context
    context.shutdown()


def test_node_that_is_not_destroyed_is_found(context: Context):
    nodes = []
    with pytest.raises(AssertionError, match="left behind: DDS participant"), nothing_left(0.2):
        nodes.append(Node("forgotten", context=context))
    nodes[0].destroy_node()
    assert participants() == set()


@pytest.mark.parametrize("kind", [Node, ManagedNode])
def test_node_that_is_destroyed_leaves_nothing(context: Context, kind: type[Node]):
    """Not even while something refers to it."""
    with nothing_left(0.2):
        node = kind("tidy", context=context)
        assert len(participants()) == 1
        node.destroy_node()


def test_thread_that_goes_on_is_found():
    end = threading.Event()
    thread = threading.Thread(target=end.wait, name="forgotten")
    with pytest.raises(AssertionError, match=r"left behind: <Thread\(forgotten"), nothing_left(0.2):
        thread.start()
    end.set()
    thread.join()


def test_thread_that_ends_meanwhile_is_waited_for():
    with nothing_left():
        threading.Timer(0.1, lambda: None).start()
