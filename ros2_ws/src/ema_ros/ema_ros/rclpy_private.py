# SPDX-License-Identifier: Apache-2.0
"""All uses of private parts of rclpy.

These are the queued messages of a subscription, the lifecycle state within the process, the end of
a state machine, errors of ``change_state``, and parameter overrides. Checked with 7.1 (Jazzy).
"""

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription


def next_message(executor: Executor, subscription: Subscription) -> Callable[[], Any] | None:
    """Take a subscription's next message. Return a coroutine function that delivers it."""
    return executor._take_subscription(subscription)


def lifecycle_state(node: Any) -> str:
    """Return the label of the lifecycle state of a node."""
    return node._state_machine.current_state[1]


def release_state_machine(node: Any) -> None:
    """Release a destroyed node's state machine, and with it the DDS participant.

    Otherwise both remain until garbage collection.
    """
    node._state_machine = None


def wrap_change_state(node: Any, wrap: Callable[[Any], Any]) -> None:
    """Wrap the callback of the service ``change_state`` with ``wrap``."""
    service = node._service_change_state
    service.callback = wrap(service.callback)


def parameter_overrides(node: Node) -> Mapping[str, Parameter]:
    """Return the parameter overrides of a node by name, declared or not."""
    return node._parameter_overrides
