"""What the nodes use of rclpy that has no public name; nothing else in the repository does.

rclpy has no public way to receive what waits for one subscription without waiting for all, to read
the state of a lifecycle in its own process, to destroy a state machine with its node, to catch what
the service ``change_state`` raises, or to list the parameters that were given to a node.
Checked with 7.1 (Jazzy).
"""

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.executors import Executor
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription


def next_message(executor: Executor, subscription: Subscription) -> Callable[[], Any] | None:
    """Take the next message of a subscription; return the coroutine function that delivers it.

    Parameters
    ----------
    subscription
        Which one; None is returned when no message waits for it.
    """
    return executor._take_subscription(subscription)


def lifecycle_state(node: LifecycleNode) -> str:
    """Return the label of the state of a node's lifecycle."""
    return _any(node)._state_machine.current_state[1]


def release_state_machine(node: LifecycleNode) -> None:
    """Release the state machine of a destroyed node, and with it the participant of DDS.

    Otherwise both are left to the garbage collector.
    """
    _any(node)._state_machine = None


def wrap_change_state(node: LifecycleNode, wrap: Callable[[Any], Any]) -> None:
    """Replace the callback of the service ``change_state``.

    Parameters
    ----------
    wrap
        Called with the callback; returns the one to use.
    """
    service = _any(node)._service_change_state
    service.callback = wrap(service.callback)


def given_parameters(node: Node) -> Mapping[str, Parameter]:
    """Return the parameters that a node was given by name, declared or not."""
    return node._parameter_overrides


def _any(node: Any) -> Any:
    """Return the node; type checkers do not know the attributes of a lifecycle."""
    return node
