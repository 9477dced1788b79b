"""The start of a program: SIGINT ends its imports without a traceback; arrays have one thread."""

import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from ema_core.linear_algebra import array_environment


@contextmanager
def quiet_imports() -> Iterator[None]:
    """Let SIGINT end the process at once, where Python would raise KeyboardInterrupt."""
    before = signal.getsignal(signal.SIGINT)
    is_main = threading.current_thread() is threading.main_thread()
    if is_own := is_main and before is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        if is_own:
            signal.signal(signal.SIGINT, before)


def write_any_text() -> None:
    """Let standard output and error take any text, whatever the locale is.

    Files and pipes get UTF-8, a terminal its own encoding. A byte of a file name that is not
    text is written as an escape.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            encoding = stream.encoding if stream.isatty() else "utf-8"
            stream.reconfigure(encoding=encoding, errors="backslashreplace")


def program(module: str) -> Callable[[], Any]:
    """Return the program whose ``main`` is in a module that takes long to import."""

    def main() -> Any:
        os.environ.update(array_environment())  # before numpy is imported
        write_any_text()
        with quiet_imports():
            run = import_module(module).main
        return run()

    return main
