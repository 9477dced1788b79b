# SPDX-License-Identifier: Apache-2.0
"""Access to private parts of rclpy, all in one module.

These are the queued messages of a subscription, the lifecycle state within the process, the end of
a state machine, errors of ``change_state``, parameter overrides, and the goals of an action server.
Checked with 7.1 (Jazzy).
"""

import threading
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.action.server import ActionServer
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription


def next_message(executor: Executor, subscription: Subscription) -> Callable[[], Any] | None:
    """Take a subscription's next message. Return a coroutine function that delivers it, or None."""
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


class GoalServer(ActionServer):
    """Action server that sends each result in the thread of its goal, and counts running goals.

    rclpy's server leaves a result to the executor, which sends none during a lifecycle transition.
    Parameters are as in ``rclpy.action.ActionServer``.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._running = 0
        self._changed = threading.Condition()
        super().__init__(*args, **kwargs)

    def wait(self, timeout_s: float) -> bool:
        """Wait until the results of all running goals are sent. Return False at the timeout [s]."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._running, timeout_s)

    def add_future(self, future: Any) -> None:
        """Do nothing, so that the goal itself, not the executor, sends the result."""

    def remove_future(self, future: Any) -> None:
        """Do nothing: ``add_future`` gave the executor no result."""

    async def _execute_goal(self, execute_callback: Callable[..., Any], goal_handle: Any) -> None:
        with self._changed:
            self._running += 1
        try:
            await super()._execute_goal(execute_callback, goal_handle)
        finally:
            with self._changed:
                self._running -= 1
                self._changed.notify_all()
