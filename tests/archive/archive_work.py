# SPDX-License-Identifier: Apache-2.0
"""Task functions that worker processes of the tests import by module name."""

import os
import signal

from ema_archive.bag_task import BagResult, BagTask


def end_the_worker(task: BagTask) -> BagResult:
    """Kill this process with SIGKILL, as the kernel does when memory runs out."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError(task.url)
