# SPDX-License-Identifier: Apache-2.0
"""Start of a program: no traceback on Ctrl-C during imports, single-threaded linear algebra."""

import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from ema_core.array_environment import array_environment


@contextmanager
def quiet_imports() -> Iterator[None]:
    """End the process immediately on SIGINT within a context, without KeyboardInterrupt.

    This changes nothing outside the main thread, or if the program has set a handler of SIGINT.
    """
    before = signal.getsignal(signal.SIGINT)
    is_main = threading.current_thread() is threading.main_thread()
    if is_default := is_main and before is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        if is_default:
            signal.signal(signal.SIGINT, before)


def write_any_text() -> None:
    """Make standard output and standard error accept any string in any locale.

    Files and pipes use UTF-8, terminals their own encoding. Undecodable bytes of file names are
    written as escape sequences.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            encoding = stream.encoding if stream.isatty() else "utf-8"
            stream.reconfigure(encoding=encoding, errors="backslashreplace")


def program(module: str) -> Callable[[], Any]:
    """Return an entry point that imports a module (which may be slow) and calls its ``main``."""

    def main() -> Any:
        os.environ.update(array_environment())  # before numpy is imported
        write_any_text()
        with quiet_imports():
            run = import_module(module).main
        return run()

    return main
