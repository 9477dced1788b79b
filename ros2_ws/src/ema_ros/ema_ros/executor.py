# SPDX-License-Identifier: Apache-2.0
"""Executor for nodes with blocking callbacks."""

import threading
import time
from collections.abc import Callable
from typing import Any, Final

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.subscription import Subscription
from rclpy.task import Task

from ema_ros.rclpy_private import next_message

_MOST_IN_A_ROW: Final = 100
_REST_S: Final = 0.005


class WaitingCallbackGroup(MutuallyExclusiveCallbackGroup):
    """Group of blocking callbacks, run one at a time in a separate thread."""


class SeparateCallbackGroup(ReentrantCallbackGroup, WaitingCallbackGroup):
    """Group of blocking callbacks, each run in a separate thread."""


class NodeExecutor(SingleThreadedExecutor):
    """Runs callbacks one at a time, and blocking callbacks in separate threads.

    Separate threads run the callbacks of a ``WaitingCallbackGroup`` and the goals of actions.
    rclpy's executor with a thread pool dispatches a callback repeatedly until its thread has
    started; at hundreds of messages per second this blocks the callbacks.

    If a subscription has a message, up to a hundred more queued messages are taken, followed by a
    pause of 5 ms, because waiting on all entities takes longer than handling a message.

    ``on_failure`` is called with the exception of a callback.
    """

    def __init__(self, on_failure: Callable[[Exception], None], **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._on_failure = on_failure

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait up to ``timeout_sec`` for a callback (None for no limit), and run it."""
        try:
            handler, entity, _ = self.wait_for_ready_callbacks(timeout_sec)
        except (ShutdownException, TimeoutException):
            return
        if entity is None or isinstance(entity.callback_group, WaitingCallbackGroup):
            threading.Thread(target=self._run, args=(handler,), daemon=True).start()
            while not (handler.executing() or handler.done()):
                time.sleep(1e-4)  # it would be dispatched again otherwise
        else:
            self._run(handler)
            if isinstance(entity, Subscription):
                self._empty(entity)
                time.sleep(_REST_S)

    def _empty(self, subscription: Subscription) -> None:
        for _ in range(_MOST_IN_A_ROW - 1):
            callback = next_message(self, subscription)
            if callback is None:
                return
            self._run(Task(callback, executor=self))

    def _run(self, handler: Any) -> None:
        handler()
        if handler.done() and handler.exception() is not None:
            self._on_failure(handler.exception())
