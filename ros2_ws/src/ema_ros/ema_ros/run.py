# SPDX-License-Identifier: Apache-2.0
"""Main function of nodes: bring-up, and orderly shutdown on SIGINT or SIGTERM."""

import ctypes
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from ema_ros.executor import NodeExecutor
from ema_ros.managed_node import ManagedNode

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
_PATIENCE_S: Final = 1.0
_POLL_S: Final = 0.05
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
_MAPPED_ALONE_BYTES: Final = 4 << 20


def run(make_node: Callable[[], ManagedNode], args: list[str] | None = None) -> int:
    """Run a node until SIGINT, SIGTERM or the end of its work.

    Parameters
    ----------
    args
        Command line; None for the command line of the process.

    Returns
    -------
    int
        Exit code of the process: 0, or 1 if bring-up or the node failed.
    """
    _give_memory_back()
    stop_signals: list[int] = []
    for number in _SIGNALS:
        # Not an event: a wait may hold its lock here.
        signal.signal(number, lambda number, _: stop_signals.append(number))
    # rclpy's handlers would close the context at once, and nothing could be published at the end.
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = make_node()
    except (ValueError, RuntimeError) as error:
        get_logger(Path(sys.argv[0]).stem).fatal(str(error))
        try_shutdown()
        return 1
    node.is_interrupted = lambda: bool(stop_signals)
    if node.bring_up():
        _serve(node, stop_signals)
    else:
        node.exit_code = int(not stop_signals)
    for number in _SIGNALS:
        # A launcher may send signals twice, and the interpreter removes its handlers as it ends.
        signal.signal(number, signal.SIG_IGN)
    node.destroy_node()
    rclpy.shutdown()
    _end_if_stuck(node.exit_code)
    return node.exit_code


def _give_memory_back() -> None:
    """Make the allocator return the memory of large messages to the system."""
    with suppress(OSError, UnicodeDecodeError):
        # rmw_fastrtps ignores the memory policies of a profile by default.
        profile = Path(os.environ.get("FASTRTPS_DEFAULT_PROFILES_FILE", "")).read_text("utf-8")
        if 'profile_name="memory_given_back"' in profile:
            os.environ.setdefault("RMW_FASTRTPS_USE_QOS_FROM_XML", "1")
    # glibc would raise these limits when the first large block is freed, and keep later blocks.
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(_M_MMAP_THRESHOLD, _MAPPED_ALONE_BYTES)
        set_option(_M_TRIM_THRESHOLD, 2 * _MAPPED_ALONE_BYTES)


def _serve(node: ManagedNode, stop_signals: list[int]) -> None:
    """Run a node in a thread until it finishes or a signal arrives, then shut it down."""
    executor = NodeExecutor(node.log_failure)
    executor.add_node(node)
    name = f"executor of {node.get_name()}"
    thread = threading.Thread(target=_spin, args=(executor, node), name=name, daemon=True)
    thread.start()
    while not stop_signals and not node.finished.is_set():
        time.sleep(_POLL_S)
    node.stopping.set()
    thread.join(_PATIENCE_S)
    executor.shutdown(_PATIENCE_S)
    if node.state != "finalized":
        node.trigger_shutdown()


def _spin(executor: NodeExecutor, node: ManagedNode) -> None:
    while not node.stopping.is_set():
        try:
            executor.spin_once(timeout_sec=0.2)
        except ExternalShutdownException:
            return
        except Exception as error:
            # Without this thread the node would not respond, but seem to run.
            node.log_failure(error)
            node.stopping.wait(_POLL_S)


def _end_if_stuck(exit_code: int) -> None:
    """Force the process to exit if a thread hangs; the interpreter would wait forever."""
    threads = [item for item in threading.enumerate() if item is not threading.main_thread()]
    for item in threads:
        item.join(_PATIENCE_S / len(threads))
    if any(item.is_alive() for item in threads):
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(exit_code)
