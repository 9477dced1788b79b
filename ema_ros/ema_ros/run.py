"""The main of a node: it brings itself up, and ends in an orderly way when it is asked to."""

import logging
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from functools import partial
from typing import Final

import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from ema_ros.executor import NodeExecutor
from ema_ros.managed_node import ManagedNode

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
_PATIENCE_S: Final = 1.0
_POLL_S: Final = 0.05


def run(make_node: Callable[[], ManagedNode], args: list[str] | None = None) -> int:
    """Run a node until it is asked to stop by SIGINT or SIGTERM, or has done its work.

    Parameters
    ----------
    args
        Command line; that of the process when None.

    Returns
    -------
    int
        Exit code of the process: 0, or 1 when the node did not come up.
    """
    stop_signals: list[int] = []
    for number in _SIGNALS:
        # An event could be in the middle of a wait here, and its lock taken.
        signal.signal(number, lambda number, _: stop_signals.append(number))
    # rclpy's own handlers would close the context at once: nothing could be published at the end.
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = make_node()
    except (ValueError, RuntimeError) as error:
        sys.stderr.write(f"{error}\n")
        try_shutdown()
        return 1
    exit_code = _serve(node, stop_signals) if node.bring_up() else 1
    for number in _SIGNALS:
        # A launcher may send them twice, and the interpreter gives up its handlers as it ends.
        signal.signal(number, signal.SIG_IGN)
    node.destroy_node()
    rclpy.shutdown()
    _end_if_stuck(exit_code)
    return exit_code


def _serve(node: ManagedNode, stop_signals: list[int]) -> int:
    """Serve a node that is up until it is asked to stop or has finished; return its exit code."""
    executor = NodeExecutor(partial(_log_failure, node))
    executor.add_node(node)
    spinning = threading.Thread(target=_spin, args=(executor, node), name="executor", daemon=True)
    spinning.start()
    while not stop_signals and not node.finished.wait(_POLL_S):
        pass
    node.stopping.set()
    spinning.join(_PATIENCE_S)
    executor.shutdown(_PATIENCE_S)
    if node.state != "finalized":
        node.trigger_shutdown()
    return node.exit_code


def _spin(executor: NodeExecutor, node: ManagedNode) -> None:
    while not node.stopping.is_set():
        try:
            executor.spin_once(timeout_sec=0.2)
        except ExternalShutdownException:
            return
        except InvalidHandle:
            continue  # what was to be served has just been destroyed


def _log_failure(node: ManagedNode, error: Exception) -> None:
    """Log that a callback failed; the others go on."""
    if not isinstance(error, InvalidHandle):
        trace = "".join(traceback.format_exception(error))
        node.get_logger().error(f"a callback failed:\n{trace}")


def _end_if_stuck(exit_code: int) -> None:
    """End without further ado if a thread is stuck; the interpreter would wait for it for ever."""
    others = [item for item in threading.enumerate() if item is not threading.main_thread()]
    for item in others:
        item.join(_PATIENCE_S / len(others))
    if any(item.is_alive() for item in others):
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(exit_code)
