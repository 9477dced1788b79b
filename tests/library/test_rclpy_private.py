"""The private attributes of rclpy that the nodes use do what they are used for."""

import asyncio
import gc
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter
from std_msgs.msg import Int64

from ema_ros import rclpy_private

from ..ros.spinning import ros_context, wait_for_match
from ..waiting import wait_for


@pytest.fixture
def context() -> Iterator[Context]:
    with ros_context() as context:
        yield context


@pytest.fixture
def node(context):
    given = [Parameter("unknown", value=1)]
    node = LifecycleNode("private", context=context, parameter_overrides=given)
    yield node
    node.destroy_node()
    rclpy_private.release_state_machine(node)


def test_state_is_that_of_the_lifecycle(node):
    assert rclpy_private.lifecycle_state(node) == "unconfigured"
    node.trigger_configure()
    assert rclpy_private.lifecycle_state(node) == "inactive"


def test_given_parameters_are_listed_though_not_declared(node):
    assert "unknown" in rclpy_private.given_parameters(node)
    assert not node.has_parameter("unknown")


def test_message_is_taken_once_and_delivered_by_what_is_returned(node, context):
    received: list[int] = []
    subscription = node.create_subscription(Int64, "n", lambda m: received.append(m.data), 10)
    publisher = node.create_publisher(Int64, "n", 10)
    executor = SingleThreadedExecutor(context=context)
    try:
        assert rclpy_private.next_message(executor, subscription) is None
        wait_for_match(node, publisher)
        publisher.publish(Int64(data=7))
        deliver = wait_for(
            lambda: rclpy_private.next_message(executor, subscription), "the message"
        )
        asyncio.run(deliver())
        assert received == [7]
        assert rclpy_private.next_message(executor, subscription) is None
    finally:
        executor.shutdown()


def test_callback_of_change_state_is_the_one_that_is_replaced(node):
    request, response = ChangeState.Request(), ChangeState.Response()
    request.transition.id = Transition.TRANSITION_ACTIVATE
    wrapped: list[Callable[..., Any]] = []

    def wrap(callback):
        wrapped.append(callback)
        return callback

    rclpy_private.wrap_change_state(node, wrap)
    # What it is wrapped for: a transition that is not possible raises.
    with pytest.raises(RuntimeError):
        wrapped[0](request, response)


def test_state_machine_goes_with_its_node(context):
    node = LifecycleNode("gone", context=context)
    machine = weakref.finalize(node._state_machine, lambda: None)
    node.destroy_node()
    gc.disable()
    try:
        rclpy_private.release_state_machine(node)
        assert not machine.alive
    finally:
        gc.enable()
