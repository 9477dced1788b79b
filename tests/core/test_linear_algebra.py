"""Processes that compute keep to one thread of the libraries below numpy."""

import os
import subprocess
import sys

import pytest

from ema_core.linear_algebra import one_thread

# Large enough for several threads, where there are several processors.
MULTIPLY = """
import os
{before}
import numpy as np
a = np.ones((400, 400))
a @ a
print(len(os.listdir("/proc/self/task")))
"""


def threads(before: str, environment: dict[str, str]) -> int:
    """Return how many threads a process has that multiplied two matrices."""
    words = [sys.executable, "-c", MULTIPLY.format(before=before)]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.fixture
def unsaid() -> dict[str, str]:
    """The environment, without what it may say of threads."""
    return {name: value for name, value in os.environ.items() if "_NUM_THREADS" not in name}


def test_process_that_asks_for_one_thread_has_one(unsaid: dict[str, str]):
    asking = "from ema_core.linear_algebra import one_thread; os.environ.update(one_thread())"
    assert threads(asking, unsaid) == 1
    assert threads("", unsaid | one_thread(unsaid)) == 1
