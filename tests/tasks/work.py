"""What the workers of the tests do; other processes import it."""

import os
import signal
import time
from pathlib import Path


def square(number: int) -> int:
    return number * number


def environment_of(name: str) -> str | None:
    return os.environ.get(name)


def fail(number: int) -> None:
    raise ValueError(f"{number} is refused")


def kill_once(mark: Path) -> str:
    """End this process by a signal the first time it is called."""
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def kill_always(mark: Path) -> None:
    with mark.open("a") as file:
        file.write("x")
    os.kill(os.getpid(), signal.SIGKILL)


def own_pid(_: int) -> int:
    return os.getpid()


def sleep(seconds: float) -> None:
    # What it does is to take longer than its limit.
    time.sleep(seconds)


def note(folder: Path, name: str) -> None:
    (folder / name).touch()
