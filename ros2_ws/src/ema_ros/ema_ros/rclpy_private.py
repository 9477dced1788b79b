"""Private parts of rclpy that the nodes use; only this module uses any.

Receiving the waiting messages of a subscription, the state of a lifecycle in its own process, the
end of a state machine, errors of ``change_state``, and given parameters. Checked with 7.1 (Jazzy).
"""

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription


def next_message(executor: Executor, subscription: Subscription) -> Callable[[], Any] | None:
    """Take the next message of a subscription; return the coroutine function that delivers it."""
    return executor._take_subscription(subscription)


def lifecycle_state(node: Any) -> str:
    """Return the label of the state of a node's lifecycle."""
    return node._state_machine.current_state[1]


def release_state_machine(node: Any) -> None:
    """Release the state machine of a destroyed node, and with it the participant of DDS.

    Otherwise both are left to the garbage collector.
    """
    node._state_machine = None


def wrap_change_state(node: Any, wrap: Callable[[Any], Any]) -> None:
    """Wrap the callback of the service ``change_state`` with ``wrap``."""
    service = node._service_change_state
    service.callback = wrap(service.callback)


def given_parameters(node: Node) -> Mapping[str, Parameter]:
    """Return the parameters that a node was given by name, declared or not."""
    return node._parameter_overrides
